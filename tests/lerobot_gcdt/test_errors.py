"""A bad option ends LeRobot's commands with our sentence as the last line, and without a traceback."""

import pytest
from lerobot.scripts import lerobot_eval, lerobot_train

from lerobot_gcdt import GENERALIST

TRAIN = (lerobot_train, "--policy.type=gcdt", "--policy.push_to_hub=false", "--dataset.repo_id=local/x")
EVALUATE = (lerobot_eval, f"--policy.path={GENERALIST}", "--policy.device=cpu")
UNKNOWN_TASK = ("--env.task=NeedlePik-v0", "or name the module that registers it, as in my_module:MyTask.")


@pytest.mark.parametrize(
    ("script", "option", "sentence"),
    [
        (TRAIN, *UNKNOWN_TASK),
        (EVALUATE, *UNKNOWN_TASK),
        (TRAIN, "--policy.dtype=half", "must be 'auto', 'bfloat16' or 'float32', got 'half'."),
        (EVALUATE, "--env.cameras=top", "has the cameras closeup, overview; got env.cameras=top."),
        (EVALUATE, "--env.camera_size=0", "env.camera_size must be positive, got 0."),
    ],
    ids=["unknown task of a training", "unknown task", "unknown precision", "unknown camera", "pictures of no size"],
)
def test_a_bad_option_ends_a_command_with_its_sentence(command, script, option, sentence, capfd):
    module, *options = script
    with pytest.raises(SystemExit) as end:
        command(module.main, *options, "--env.type=surrol", option)
    assert end.value.code
    lines = [line for line in capfd.readouterr().err.splitlines() if line]
    assert lines[-1].endswith(sentence)
    assert not any("Traceback" in line for line in lines)
