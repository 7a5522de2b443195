"""Configuration of real arms."""

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig

from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.robot.config_psm import PSMConfig


@RobotConfig.register_subclass("dvrk_psm")
@dataclass(kw_only=True)
class DVRKPSMConfig(PSMConfig):
    """Robot type ``dvrk_psm``: ``--robot.type=dvrk_psm --robot.task=PegTransfer --robot.dry_run=true``.

    Attributes:
        dry_run: Whether to print what would be sent, to no arm; needs no ROS.
        speed: How fast motions are, in units of the simulated arm's speed.
        base_frame: JSON file of where the arms really stand (docs/dvrk.md#base-frames); by default as in the simulator.
        tracker: ``module:function`` that tells what arms do not measure: it is given the numbers that they do, by name,
            and returns all others of the task's observation and goals. Without, only the arms' numbers are observed.
        cameras: Cameras of LeRobot's, by name.

    Raises:
        OptionError: The speed is out of range.
    """

    dry_run: bool = False
    speed: float = 0.25
    base_frame: str = ""
    tracker: str = ""
    cameras: dict[str, CameraConfig] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        RobotConfig.__post_init__(self)  # checks the cameras
        if not 0 < self.speed <= 1:
            raise OptionError(f"robot.speed must lie in (0, 1], got {self.speed}.")
