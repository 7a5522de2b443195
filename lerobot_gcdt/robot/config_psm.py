"""What the configurations of simulated and of real arms share."""

from dataclasses import dataclass

from lerobot.robots import RobotConfig

from lerobot_gcdt.errors import OptionError
from surrol_gym.registry import env_class


@dataclass(kw_only=True)
class PSMConfig(RobotConfig):
    """Which task the arms do, and how they take deltas of an end effector.

    Attributes:
        task: Name of a task, which says what actions mean and where arms may go; see ``surrol_gym.find_task``.
        deltas: Whether ``lerobot-record`` keeps ``delta_x``, ``delta_y``, ``delta_z`` and ``gripper``, of a
            teleoperator that says these, as the action.
        away: Which way such deltas lead away from the person: ``-y`` of ``keyboard_ee``, ``+x`` of ``gamepad``.
        delta_scale: Size of a delta of 1, in units of a full action, which is 10 mm.

    Raises:
        OptionError: The task is unknown, or it has two arms and ``deltas`` are wanted.
    """

    task: str = "NeedlePick"
    deltas: bool = False
    away: str = "-y"
    delta_scale: float = 0.2

    def __post_init__(self) -> None:
        # Not the base class's, which expects cameras of LeRobot's.
        try:
            arms = len(env_class(self.task).mounts)
        except ValueError as error:
            raise OptionError(f"robot.task: {error}") from None
        if self.deltas and arms > 1:
            raise OptionError(f"robot.deltas move a single arm; {self.task} has {arms}.")
