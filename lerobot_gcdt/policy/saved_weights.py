"""Whether the weights of a checkpoint, also an older one, are those of a policy."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, cast

from safetensors import safe_open
from torch import nn

from lerobot_gcdt.averaging import without_resting
from lerobot_gcdt.policy.objectives import OBJECTIVES
from lerobot_gcdt.policy.tokens import TaskModules

if TYPE_CHECKING:
    from lerobot_gcdt.policy.modeling_gcdt import GCDTPolicy


def prepare_for_weights(policy: "GCDTPolicy", file: str | Path) -> None:
    """Makes a new policy one that a checkpoint's weights can be loaded into.

    What a checkpoint does not know keeps its new modules: tasks, and objectives that are not the paper's. Older
    checkpoints do not count steps.

    Args:
        policy: The policy, made from the checkpoint's configuration.
        file: The weights; the configuration lies beside them.

    Raises:
        ValueError: The checkpoint lacks other weights of the policy, or holds further ones.
    """
    if "one_token" not in json.loads(Path(file).with_name("config.json").read_text()):
        _become_older(policy)
    with safe_open(file, "pt") as stream:
        saved = without_resting(stream.keys())
    own = without_resting(policy.state_dict())
    known_tasks, known_modules = ({key.split(".")[i] for key in saved if key.startswith("tasks.")} for i in (1, 2))
    further = {name for objective in policy.config.objectives for name in OBJECTIVES[objective].heads([1, 1, 1], 1)}
    new = {"training_step"} - saved
    for key in own:
        if key.startswith("tasks."):
            _, task, module, *_ = key.split(".")
            if task not in known_tasks or module in further - known_modules:
                new.add(key)
    if problem := sorted(saved ^ (own - new)):
        raise misfit(policy, file, problem)


def misfit(policy: "GCDTPolicy", file: str | Path, problem: object) -> ValueError:
    """Returns the error of weights that do not fit."""
    config = policy.config
    return ValueError(
        f"The weights in {file} do not fit their configuration (layers={config.layers}, width={config.width}, "
        f"task_dims={config.task_dims}): {problem}"
    )


def _become_older(policy: "GCDTPolicy") -> None:
    """Turns a policy that was just made into one from before a step could be one token."""
    config = policy.config
    config.one_token, config.time_to_goal_dropout = False, 0.0
    policy.transformer.norm = nn.LayerNorm(config.width)
    for modules in policy.tasks.values():
        for tokenizer in cast(TaskModules, modules).tokenizers.values():
            tokenizer.norm = nn.LayerNorm(config.width)
    policy.keep_average(config.average_steps)
