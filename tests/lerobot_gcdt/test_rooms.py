"""Dependencies point one way: a room imports rooms below it, never above or beside.

Read from the sources, with the imports inside of functions.
"""

import ast
import re
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

MAY_IMPORT = {
    "surrol_gym": set(),
    "keys": set(),
    "errors": set(),
    "locking": set(),
    "precision": set(),
    "averaging": {"errors"},
    "executors": set(),
    "data": {"keys"},
    "policy": {"data", "keys", "errors", "precision", "averaging"},
    "baselines": {"data", "keys", "errors", "precision", "averaging"},
    "environment": {"surrol_gym", "keys", "errors"},
    "recording": {"environment", "surrol_gym", "data", "keys", "errors", "locking"},
    "evaluation": {"environment", "surrol_gym", "keys", "errors"},
    "training": {"locking"},
    "robot": {"recording", "evaluation", "environment", "data", "surrol_gym", "keys", "errors"},
    "benchmark": {
        *("policy", "baselines", "recording", "evaluation", "training", "environment", "data", "surrol_gym", "keys"),
        "precision",
    },
    "hub": {"recording", "evaluation", "training", "environment", "surrol_gym", "keys", "errors", "averaging"},
    "lerobot_gcdt": {"policy", "baselines", "environment", "robot"},
    "gcdt_cli": {
        *("lerobot_gcdt", "recording", "evaluation", "training", "hub", "benchmark", "robot", "executors"),
        "surrol_gym",
    },
    "lerobot_policy_gcdt": {"lerobot_gcdt"},
}
"""What each room may import beside itself. ``lerobot_gcdt`` stands for the package's own ``__init__.py``."""


def room_of(module: str) -> str:
    """The room of a module, or the top-level name of a package that is not ours."""
    parts = module.split(".")
    return parts[1] if parts[0] == "lerobot_gcdt" and len(parts) > 1 else parts[0]


def imported(tree: ast.AST) -> Iterator[str]:
    """The names of modules that a source imports; of ``from a import b`` also ``a.b``, where ``a`` is our package."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            if node.module == "lerobot_gcdt":
                rooms = {alias.name for alias in node.names if alias.name in MAY_IMPORT}
                yield from (f"lerobot_gcdt.{room}" for room in rooms)
                if len(rooms) == len(node.names):
                    continue
            yield node.module


def sources() -> Iterator[Path]:
    for name in ("surrol_gym", "lerobot_gcdt", "gcdt_cli"):
        yield from sorted((ROOT / name).rglob("*.py"))
    yield ROOT / "lerobot_policy_gcdt.py"


@pytest.fixture(scope="module")
def arrows():
    """The rooms and packages that each room imports, each with the files that do."""
    found: dict[str, dict[str, list[str]]] = {}
    for file in sources():
        path = file.relative_to(ROOT)
        room = room_of(".".join(path.with_suffix("").parts).removesuffix(".__init__"))
        for module in imported(ast.parse(file.read_text())):
            found.setdefault(room, {}).setdefault(room_of(module), []).append(str(path))
    return found


def test_every_room_has_a_place(arrows):
    assert set(arrows) <= set(MAY_IMPORT)
    folders = {file.parent.name for file in (ROOT / "lerobot_gcdt").glob("*/__init__.py")}
    assert folders <= set(MAY_IMPORT)


@pytest.mark.parametrize("room", MAY_IMPORT)
def test_a_room_imports_only_what_it_may(arrows, room):
    wrong = {
        other: files
        for other, files in arrows.get(room, {}).items()
        if other in MAY_IMPORT and other != room and other not in MAY_IMPORT[room]
    }
    assert not wrong


def test_the_drawing_for_contributors_shows_these_arrows(arrows):
    drawn = re.findall(r"^ +(\w+) --> (\w+)$", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE)
    ours = {(room, other) for room in arrows for other in arrows[room] if other in MAY_IMPORT and other != room}
    # What every room may use is left out of the drawing, and so are the two doors.
    left_out = {
        "keys",
        "errors",
        "locking",
        "precision",
        "averaging",
        "gcdt_cli",
        "lerobot_gcdt",
        "lerobot_policy_gcdt",
    }
    assert sorted(drawn) == sorted(arrow for arrow in ours if not left_out & set(arrow))


def test_the_rooms_stand_on_each_other_without_a_circle():
    assert list(TopologicalSorter(MAY_IMPORT).static_order())


@pytest.mark.parametrize("room", ["data", "policy", "baselines"])
def test_policies_stand_without_the_simulator(room):
    below, waiting = set(), [room]
    while waiting:
        below.add(here := waiting.pop())
        waiting += MAY_IMPORT[here] - below
    assert "surrol_gym" not in below


@pytest.mark.parametrize("room", ["data", "policy", "baselines", "environment", "evaluation", "robot", "hub"])
def test_only_the_simulator_knows_pybullet(arrows, room):
    assert "pybullet" not in arrows[room]


def test_the_simulator_knows_neither_torch_nor_lerobot(arrows):
    assert not {"torch", "lerobot", "datasets", "lerobot_gcdt"} & set(arrows["surrol_gym"])


@pytest.mark.parametrize("name", [name for name in MAY_IMPORT if (ROOT / "lerobot_gcdt" / name).is_dir()])
def test_every_room_says_what_lives_there(name):
    said = ast.get_docstring(ast.parse((ROOT / "lerobot_gcdt" / name / "__init__.py").read_text()))
    assert said and "imports" in said.lower()
