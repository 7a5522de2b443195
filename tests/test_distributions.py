"""The two distributions: the simulator by itself, and the plugin, which holds the simulator, too."""

import ast
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
import yaml

import surrol_gym

TESTS = Path(__file__).parent
ROOT = TESTS.parent
PLUGIN, SIMULATOR = ROOT, ROOT / "surrol_gym"
CONTENTS = {PLUGIN: ("surrol_gym", "lerobot_gcdt", "gcdt_cli", "lerobot_policy_gcdt.py"), SIMULATOR: ("surrol_gym",)}
"""What is installed from each folder."""

NOT_INSTALLED = {SIMULATOR / name for name in ("pyproject.toml", "README.md", "LICENSE")}
FROM_ROS = {"crtk", "dvrk", "PyKDL"}
"""What only a ROS workspace has; it is imported when a real arm is moved."""

BUILD = "import sys, setuptools.build_meta; print(getattr(setuptools.build_meta, sys.argv[1])(sys.argv[2]))"
IDS = {"argvalues": (PLUGIN, SIMULATOR), "ids": ("plugin", "simulator")}


def build(project: Path, kind: str, folder: Path) -> Path:
    """Builds a distribution as pip does, but with the setuptools that is installed, which needs no network."""
    command = [sys.executable, "-c", BUILD, f"build_{kind}", folder]
    output = subprocess.run(command, cwd=project, capture_output=True, text=True, check=True).stdout
    return folder / output.splitlines()[-1]


@pytest.fixture(scope="module")
def wheels(tmp_path_factory) -> dict[Path, zipfile.ZipFile]:
    """The wheel of each folder, built from its source distribution, without leaving anything in the folder."""
    folder = tmp_path_factory.mktemp("distributions")
    source = folder / "source"
    ignored = shutil.ignore_patterns("__pycache__", "build", "dist", "*.egg-info", ".venv")
    for name in ("surrol_gym", "lerobot_gcdt", "gcdt_cli", "tests", "tools"):
        shutil.copytree(ROOT / name, source / name, ignore=ignored)
    for path in (*ROOT.glob("*.py"), *(ROOT / name for name in ("pyproject.toml", "README.md", "LICENSE"))):
        shutil.copy(path, source)
    wheels = {}
    for project in (PLUGIN, SIMULATOR):
        sdist = build(source / project.relative_to(ROOT), "sdist", folder)
        with tarfile.open(sdist) as archive:
            archive.extractall(folder, filter="data")
        wheels[project] = zipfile.ZipFile(build(folder / sdist.name.removesuffix(".tar.gz"), "wheel", folder))
    return wheels


@pytest.fixture(scope="module")
def distributions() -> dict[str, list[str]]:
    """The names of distributions that bring an importable name."""
    return packages_distributions()


def metadata(wheel: zipfile.ZipFile) -> str:
    return wheel.read(next(name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))).decode()


def settings(project: Path) -> dict:
    return tomllib.loads((project / "pyproject.toml").read_text())


def requirements(project: Path, *extras: str) -> list[str]:
    """Names that a project requires, as an index spells them."""
    table = settings(project)["project"]
    lines = table["dependencies"] + [line for extra in extras for line in table["optional-dependencies"][extra]]
    return [canonical(re.match(r"[\w.-]+", line)[0]) for line in lines]


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def imported(*roots: Path) -> Iterator[str]:
    """Top-level names that the sources import, also inside of functions."""
    for path in (path for root in roots for path in ([root] if root.is_file() else root.rglob("*.py"))):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                yield from (alias.name.partition(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                yield node.module.partition(".")[0]


@pytest.mark.parametrize("project", **IDS)
def test_a_wheel_holds_every_file_of_its_packages_and_nothing_else(wheels, project):
    held = {name for name in wheels[project].namelist() if ".dist-info/" not in name}
    roots = [ROOT / name for name in CONTENTS[project]]
    files = {path for root in roots for path in ([root] if root.is_file() else root.rglob("*")) if path.is_file()}
    files = {path for path in files - NOT_INSTALLED if not re.search(r"__pycache__|\.egg-info|/build/", str(path))}
    assert held == {str(path.relative_to(ROOT)) for path in files}
    assert {f"{name}/py.typed" for name in CONTENTS[project] if "." not in name} | {"surrol_gym/assets/psm.urdf"} < held


@pytest.mark.parametrize("project", **IDS)
def test_a_wheel_holds_the_licence(wheels, project):
    licence = next(name for name in wheels[project].namelist() if name.endswith(".dist-info/licenses/LICENSE"))
    assert wheels[project].read(licence) == (ROOT / "LICENSE").read_bytes()
    assert "License-Expression: Apache-2.0" in metadata(wheels[project])


def test_the_version_stands_in_one_place(wheels):
    for wheel in wheels.values():
        assert f"\nVersion: {surrol_gym.__version__}\n" in metadata(wheel)


def test_the_citation_names_the_version():
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == surrol_gym.__version__


def test_lerobot_finds_the_plugin_by_its_raw_name(wheels):
    assert "\nName: lerobot_policy_gcdt\n" in metadata(wheels[PLUGIN])


def test_the_simulator_requires_three_packages_as_the_plugin_does():
    assert sorted(requirements(SIMULATOR)) == ["gymnasium", "numpy", "pybullet"]
    assert set(settings(SIMULATOR)["project"]["dependencies"]) < set(settings(PLUGIN)["project"]["dependencies"])


def test_both_compile_pybullet_with_numpy():
    builds = [settings(project)["tool"]["uv"]["extra-build-dependencies"] for project in (PLUGIN, SIMULATOR)]
    assert builds[0] == builds[1]


@pytest.mark.parametrize(
    ("project", "extras", "names"),
    [
        (PLUGIN, ("dvrk", "robots", "executors", "iql"), (*CONTENTS[PLUGIN], "examples")),
        (PLUGIN, ("test",), ("tests", "tools")),
        (SIMULATOR, ("window",), CONTENTS[SIMULATOR]),
    ],
    ids=["plugin and examples", "tests and tools", "simulator"],
)
def test_what_is_imported_is_required(distributions, project, extras, names):
    scripts = {path.stem for folder in (TESTS, ROOT / "examples") for path in folder.rglob("*.py")}
    ours = {Path(name).stem for name in (*CONTENTS[PLUGIN], "tools")} | scripts
    others = set(imported(*(ROOT / name for name in names))) - sys.stdlib_module_names - ours - FROM_ROS
    required = set(requirements(project, *extras))
    assert {name for name in others if not required & set(map(canonical, distributions[name]))} == set()
    assert others


@pytest.mark.study
def test_the_simulator_installs_and_runs_without_pytorch(wheels, tmp_path):
    """In a virtual environment of its own; fetches three packages and compiles PyBullet, which takes minutes."""
    python = tmp_path / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", tmp_path], check=True)
    subprocess.run([python, "-m", "pip", "install", wheels[SIMULATOR].filename], check=True)
    code = (
        "import gymnasium, surrol_gym\n"
        "env = gymnasium.make('surrol/NeedlePick-v0')\n"
        "env.reset(seed=0)\n"
        "print(env.step(env.action_space.sample())[1], surrol_gym.__file__)"
    )
    output = subprocess.run([python, "-I", "-c", code], capture_output=True, text=True, check=True).stdout
    assert output.splitlines()[-1].startswith("-1.0 " + str(tmp_path))
    listed = subprocess.run([python, "-m", "pip", "list"], capture_output=True, text=True, check=True).stdout
    assert "torch" not in listed and "lerobot" not in listed
