"""A bad option ends LeRobot's commands with our sentence as the last line, and without a traceback of their own."""

import json
import os
import subprocess
import sys

import pytest

from lerobot_gcdt import GENERALIST

TRAIN = ["lerobot_train", "--policy.type=gcdt", "--policy.push_to_hub=false", "--dataset.repo_id=local/x"]
EVAL = ["lerobot_eval", f"--policy.path={GENERALIST}", "--policy.device=cpu"]
UNKNOWN_TASK = (["--env.task=NeedlePik-v0"], "or a comma-separated list of them, got 'NeedlePik-v0'.")
CASES = {
    "training in an unknown task": (TRAIN, *UNKNOWN_TASK),
    "evaluation in an unknown task": (EVAL, *UNKNOWN_TASK),
    "unknown precision": (TRAIN, ["--policy.dtype=half"], "must be 'auto', 'bfloat16' or 'float32', got 'half'."),
    "unknown camera": (EVAL, ["--env.cameras=top"], "has the cameras closeup, overview; got env.cameras=top."),
    "pictures of no size": (EVAL, ["--env.camera_size=0"], "env.camera_size must be positive, got 0."),
}

# Each command runs in a process of its own, forked from one that has paid for the imports.
PROGRAM = """
import importlib, json, os, sys
commands = [importlib.import_module(f"lerobot.scripts.{name}") for name in ("lerobot_train", "lerobot_eval")]
for name, *arguments in json.loads(sys.argv[1]):
    if not os.fork():
        os.dup2(os.open(os.path.join(sys.argv[2], name), os.O_CREAT | os.O_WRONLY), sys.stderr.fileno())
        sys.argv = arguments
        importlib.import_module(f"lerobot.scripts.{arguments[0]}").main()
        os._exit(0)
    os.wait()
"""


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """What each command wrote to stderr, by name."""
    if not hasattr(os, "fork"):
        pytest.skip("forks the commands")
    folder = tmp_path_factory.mktemp("errors")
    commands = [[name, *command, "--env.type=surrol", *options] for name, (command, options, _) in CASES.items()]
    program = [sys.executable, "-c", PROGRAM, json.dumps(commands), str(folder)]
    subprocess.run(program, cwd=folder, capture_output=True, check=True, timeout=300)
    return {name: (folder / name).read_text() for name in CASES}


@pytest.mark.parametrize("name", CASES)
def test_a_bad_option_ends_a_command_with_its_sentence(name, said):
    lines = [line for line in said[name].splitlines() if line]
    assert lines[-1].endswith(CASES[name][2])
    assert "SurRoLEnvConfig" not in said[name] and "GCDTConfig" not in said[name]
