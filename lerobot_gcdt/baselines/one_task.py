"""What the baselines have in common: each learns one task, from its observations and goals."""

import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.optim.schedulers import CosineDecayWithWarmupSchedulerConfig
from torch import Tensor

from lerobot_gcdt.data.task_layouts import task_layouts
from lerobot_gcdt.data.trajectories import TrajectoryBank
from lerobot_gcdt.keys import ACHIEVED_GOAL, ACTION, GOAL, STATE


def open_one_task(meta: LeRobotDatasetMetadata, config: PreTrainedConfig) -> TrajectoryBank:
    """Reads the dataset of one task, whose sizes it notes in ``config.task_dims``.

    Raises:
        ValueError: The dataset holds several tasks; and what ``TrajectoryBank.of`` raises.
    """
    if len(meta.tasks) > 1:
        raise ValueError(f"{config.type} learns one task; {meta.repo_id} holds {len(meta.tasks)}.")
    bank = TrajectoryBank.of(meta, config.device)
    config.task_dims = {task: layout.sizes for task, layout in task_layouts(meta).items()}
    [(state, goal, action)] = config.task_dims.values()
    # One task that LeRobot split off a merged dataset is still padded.
    for key, size in ((STATE, state), (GOAL, goal), (ACHIEVED_GOAL, goal), (ACTION, action)):
        bank.items[key] = bank.items[key][:, :size]
    return bank


def to_train_on(bank: TrajectoryBank | None, device: torch.device) -> TrajectoryBank:
    """Returns the trajectories of a policy, on a device.

    Raises:
        RuntimeError: It has none.
    """
    if bank is None:
        raise RuntimeError("This policy was made for inference; to train it, pass dataset_meta to its constructor.")
    return bank.to(device)


def training_frames(bank: TrajectoryBank) -> tuple[dict[str, Tensor], Tensor]:
    """Returns all frames of the episodes that are trained on.

    Returns:
        What each frame holds, by dataset key, shape (N, size), and the first frame of its episode, shape (N,).
    """
    pieces = bank.pieces(bank.training_starts(0), 1)
    items = {key: value[:, 0] for key, value in bank.sequences(pieces).items.items()}
    return items, bank.first[pieces.first]


def state_and_goal(items: dict[str, Tensor], relative_goal: bool = True) -> Tensor:
    """Joins observation, goal and, if asked for, what is left to the goal, along the last axis."""
    left = [items[GOAL] - items[ACHIEVED_GOAL]] if relative_goal else []
    return torch.cat([items[STATE], items[GOAL], *left], dim=-1)


def whole_cosine(peak_lr: float) -> CosineDecayWithWarmupSchedulerConfig:
    """Returns a warm-up over a twentieth and a cosine decay to a hundredth, which LeRobot shrinks to any training."""
    return CosineDecayWithWarmupSchedulerConfig(
        num_warmup_steps=50_000, num_decay_steps=1_000_000, peak_lr=peak_lr, decay_lr=peak_lr / 100
    )
