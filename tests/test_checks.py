"""What is checked here and on a hosted machine is what the README tells."""

import os
import subprocess
import sys
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


def test_the_contract_is_tested_for_a_task_of_ones_own(tmp_path):
    (tmp_path / "own_task.py").write_text(
        "import surrol_gym\n"
        "from new_task import PushBlockEnv, law\n"
        "class PushAwayEnv(PushBlockEnv):\n"
        "    __doc__ = PushBlockEnv.__doc__\n"
        "surrol_gym.register_task(PushAwayEnv, 50, law)\n"
    )
    command = "-m pytest -q -n0 tests/surrol_gym/envs/test_goal_env.py --task own_task:PushAway -k"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path)])}
    done = subprocess.run(
        [sys.executable, *command.split(), "PushAway and number"],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout
    assert "3 passed" in done.stdout
