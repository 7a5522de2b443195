"""A baseline of one's own, in one file: the action of the frame whose observation and goal are nearest."""

from dataclasses import dataclass, field

import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.optim.optimizers import AdamWConfig
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.processor.factory import make_default_pre_post_processors as make_nearest_frame_pre_post_processors
from torch import nn

from lerobot_gcdt.data.single_frames import SingleFrames
from lerobot_gcdt.data.task_layouts import task_layouts
from lerobot_gcdt.data.trajectories import TrajectoryBank
from lerobot_gcdt.keys import ACTION, GOAL, STATE

__all__ = ["NearestFrameConfig", "NearestFramePolicy", "make_nearest_frame_pre_post_processors"]


@PreTrainedConfig.register_subclass("nearest_frame")
@dataclass
class NearestFrameConfig(SingleFrames):
    task_dims: dict[str, list[int]] = field(default_factory=dict)
    frames: int = 0

    def get_optimizer_preset(self):
        return AdamWConfig(lr=0.0)  # LeRobot's trainer wants one

    def get_scheduler_preset(self):
        return None


class NearestFramePolicy(PreTrainedPolicy):
    """A look-up of the nearest frame."""

    config_class = NearestFrameConfig
    name = "nearest_frame"

    def __init__(self, config, dataset_stats=None, dataset_meta=None):
        super().__init__(config)
        if dataset_meta is not None:
            bank = TrajectoryBank.of(dataset_meta, config.device)
            config.task_dims = {task: layout.sizes for task, layout in task_layouts(dataset_meta).items()}
            config.frames = len(bank)
        [(state, goal, action)] = config.task_dims.values()
        self.seen = nn.Parameter(torch.zeros(config.frames, state + goal))
        self.done = nn.Parameter(torch.zeros(config.frames, action))
        if dataset_meta is not None:
            self.seen.data.copy_(torch.cat([bank.items[STATE], bank.items[GOAL]], dim=1))
            self.done.data.copy_(bank.items[ACTION])

    def forward(self, batch):
        return (self.done[batch["index"]] - batch[ACTION]).square().mean(), {}  # 0: each frame is nearest to itself

    @torch.no_grad()
    def select_action(self, batch):
        seen = torch.cat([batch[STATE], batch[GOAL]], dim=1)
        return self.done[torch.cdist(seen, self.seen).argmin(dim=1)]

    def predict_action_chunk(self, batch):
        return self.select_action(batch)[:, None]

    def reset(self):
        pass

    def get_optim_params(self):
        return self.parameters()
