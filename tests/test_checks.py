"""What is checked here and on a hosted machine is what the README tells."""

from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
TESTS = "python3 -m pip install uv && python3 -m uv run --extra test pytest"


@pytest.fixture(scope="module")
def jobs() -> dict:
    return yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text())["jobs"]


def commands(job: dict) -> list[str]:
    return [step["run"] for step in job["steps"] if "run" in step]


def test_the_checks_run_the_readmes_test_command():
    for name in ("README.md", ".ci/run"):
        assert TESTS in (ROOT / name).read_text().splitlines()


def test_the_checks_run_every_command_that_contributors_are_told():
    block = (ROOT / "CONTRIBUTING.md").read_text().split("```")[1].removeprefix("bash\n")
    told = {command for line in block.splitlines() for command in line.partition("#")[0].strip().split(" && ")}
    assert told <= {c for line in (ROOT / ".ci/run").read_text().splitlines() for c in line.split(" && ")}


def test_hosted_machines_run_the_checks_on_every_python_that_lerobot_supports(jobs):
    assert commands(jobs["checks"]) == [".ci/run"]
    assert jobs["checks"]["strategy"]["matrix"]["python"] == ["3.12", "3.13"]


def test_hosted_machines_build_both_distributions_and_the_documentation(jobs):
    assert commands(jobs["packages"])[:2] == [
        "uv build && uv build surrol_gym --out-dir dist",
        "uvx twine check --strict dist/*",
    ]
    assert "uv run --extra docs mkdocs build --strict" in commands(jobs["docs"])
