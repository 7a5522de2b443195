"""The documentation holds together: its links, the citations of it, and the commands that it shows."""

import argparse
import ast
import re
import shlex
import subprocess
import sys
import tomllib
from itertools import chain
from pathlib import Path
from pkgutil import resolve_name
from textwrap import dedent

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [*ROOT.glob("*.md"), *sorted(ROOT.glob("docs/**/*.md")), *ROOT.glob("examples/**/*.md")]
SHOWN = [page for page in PAGES if page.name not in ("CHANGELOG.md", "notes.md")]
"""Pages that show commands of now."""
CODE = [
    path
    for folder in ("surrol_gym", "lerobot_gcdt", "examples", "tests", "tools")
    for path in (ROOT / folder).rglob("*.py")
]

QUICKSTART = "python3 -m pip install uv && python3 -m uv run examples/quickstart.py"
TESTS = "python3 -m pip install uv && python3 -m uv run --extra test pytest"

LEROBOTS = ("type", "path", "device", "push_to_hub", "repo_id", "discover_packages_path")
"""Options of every policy of LeRobot's."""


def name_of(path):
    return path.relative_to(ROOT).as_posix()


def blocks(page, language):
    """The fenced blocks of a page in one language."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)


def commands(page):
    """The commands that a page shows, without comments."""
    lines = "".join(blocks(page, "bash")).replace("\\\n", " ").splitlines()
    return [" ".join(line.partition(" #")[0].split()) for line in lines if line.strip()]


def anchors(page):
    """What links to headings of a page end in, on the site as on GitHub."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", title).strip().lower()) for title in titles}


def missing(target, anchor):
    """Whether a page, or a heading on it, does not exist."""
    return not target.exists() or bool(anchor and anchor not in anchors(target))


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_relative_link_leads_somewhere(page):
    links = re.findall(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]+))?\)", page.read_text())
    assert not [link for link in links if missing(page.parent / link[0] if link[0] else page, link[1])]


def test_every_page_and_heading_that_code_cites_exists():
    cited = {
        (page, anchor, name_of(file))
        for file in CODE
        for page, anchor in re.findall(r"\bdocs/([a-z_]+\.md)(?:#([a-z0-9-]+))?", file.read_text())
    }
    assert cited
    assert not [citation for citation in cited if missing(ROOT / "docs" / citation[0], citation[1])]


def test_the_front_page_is_short_and_shows_two_commands_that_are_run():
    readme = ROOT / "README.md"
    assert len(readme.read_text().splitlines()) <= 150
    assert commands(readme) == [QUICKSTART, TESTS]
    assert TESTS in (ROOT / ".ci/run").read_text()
    assert 'run_example("quickstart"' in (ROOT / "tests/examples/test_quickstart.py").read_text()


def test_what_the_front_page_shows_of_the_simulator_runs():
    [code] = blocks(ROOT / "README.md", "python")
    shown = {}
    exec(code, shown)
    shown["env"].close()
    assert shown["info"]["is_success"]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_shown_python_is_python(page):
    for code in blocks(page, "python"):
        ast.parse(dedent(code))


class Parsed(Exception):
    """Ends a command once its arguments are read."""


@pytest.fixture
def parse(monkeypatch):
    """Reads the arguments of ``gcdt`` and does nothing with them."""
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    original = argparse.ArgumentParser.parse_args

    def parse_args(parser, *arguments):
        original(parser, *arguments)
        raise Parsed

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse_args)
    return resolve_name(scripts["gcdt"])


@pytest.mark.parametrize("command", [c for page in SHOWN for c in commands(page) if c.startswith("gcdt ")])
def test_every_command_of_ours_that_is_shown_can_be_given(parse, command):
    with pytest.raises(Parsed):
        parse(shlex.split(command)[1:])


@pytest.mark.parametrize("command", [c for page in SHOWN for c in commands(page) if "examples/" in c])
def test_every_example_that_is_shown_takes_its_options(command):
    script, *arguments = shlex.split(command[command.index("examples/") :])
    source = (ROOT / script).read_text()
    arguments = arguments[: arguments.index("--")] if "--" in arguments else arguments
    assert not [option for option in arguments if option.startswith("--") and f'"{option}"' not in source]


def test_every_option_of_a_policy_that_is_shown_exists():
    files = [ROOT / "lerobot_gcdt/averaging.py", *(ROOT / "lerobot_gcdt").rglob("configuration_*.py")]
    options = [re.findall(r"^    (\w+): ", file.read_text(), re.MULTILINE) for file in files]
    known = {*LEROBOTS, *chain(*options)}
    assert {option for page in SHOWN for option in re.findall(r"--policy\.(\w+)", page.read_text())} <= known


@pytest.mark.study
def test_the_site_is_built_without_a_warning(tmp_path):
    subprocess.run([sys.executable, "-m", "mkdocs", "build", "--site-dir", tmp_path], cwd=ROOT, check=True)
    assert "<math" in (tmp_path / "method.html").read_text()
