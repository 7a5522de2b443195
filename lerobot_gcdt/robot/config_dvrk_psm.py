"""Configuration of real arms."""

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig

from lerobot_gcdt.errors import OptionError
from surrol_gym.registry import env_class


@RobotConfig.register_subclass("dvrk_psm")
@dataclass(kw_only=True)
class DVRKPSMConfig(RobotConfig):
    """Robot type ``dvrk_psm``: ``--robot.type=dvrk_psm --robot.task=PegTransfer --robot.dry_run=true``.

    Attributes:
        task: Name of a task, which says what actions mean and where arms may go; see ``surrol_gym.find_task``.
        dry_run: Whether to print what would be sent, to no arm; needs no ROS.
        speed: How fast motions are, in units of the simulated arm's speed.
        base_frame: JSON file of where the arms really stand (docs/dvrk.md#base-frames); by default as in the simulator.
        tracker: ``module:function`` that tells what arms do not measure: it is given the numbers that they do, by name,
            and returns all others of the task's observation and goals. Without, only the arms' numbers are observed.
        cameras: Cameras of LeRobot's, by name.
        deltas: As ``surrol_psm`` has it.
        away: As ``surrol_psm`` has it.
        delta_scale: As ``surrol_psm`` has it.

    Raises:
        OptionError: The task is unknown, or the speed is out of range.
    """

    task: str = "NeedlePick"
    dry_run: bool = False
    speed: float = 0.25
    base_frame: str = ""
    tracker: str = ""
    cameras: dict[str, CameraConfig] = field(default_factory=dict)
    deltas: bool = False
    away: str = "-y"
    delta_scale: float = 0.2

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            task = env_class(self.task)
        except ValueError as error:
            raise OptionError(f"robot.task: {error}") from None
        if not 0 < self.speed <= 1:
            raise OptionError(f"robot.speed must lie in (0, 1], got {self.speed}.")
        if self.deltas and len(task.mounts) > 1:
            raise OptionError(f"robot.deltas move a single arm; {self.task} has {len(task.mounts)}.")
