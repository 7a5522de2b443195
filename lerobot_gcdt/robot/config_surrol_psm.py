"""Configuration of the simulated arms."""

from dataclasses import dataclass

from lerobot.robots import RobotConfig

from lerobot_gcdt.errors import OptionError
from surrol_gym.registry import env_class


@RobotConfig.register_subclass("surrol_psm")
@dataclass(kw_only=True)
class SurRoLPSMConfig(RobotConfig):
    """Robot type ``surrol_psm``: ``--robot.type=surrol_psm --robot.task=PegTransfer --robot.seed=3``.

    Attributes:
        task: Name of a task; see ``surrol_gym.find_task``.
        seed: Seed of the first episode.
        recording: Folder of a dataset of ``gcdt record``: its episode ``episode`` gives task and seed, and what was
            added to its actions is added again.
        episode: Which of them.
        cameras: Cameras that are observed, separated by commas, such as ``closeup,overview``.
        camera_size: Width and height of their pictures, pixels.
        window: Whether a window shows the scene.
        deltas: Whether ``lerobot-record`` keeps ``delta_x``, ``delta_y``, ``delta_z`` and ``gripper``, of a
            teleoperator that says these, as the action.
        away: Which way such deltas lead away from the person: ``-y`` of ``keyboard_ee``, ``+x`` of ``gamepad``.
        delta_scale: Size of a delta of 1, in units of a full action, which is 10 mm.

    Raises:
        OptionError: The task or a camera is unknown, or a number is out of range.
    """

    task: str = "NeedlePick"
    seed: int = 0
    recording: str = ""
    episode: int = 0
    cameras: str = ""
    camera_size: int = 128
    window: bool = False
    deltas: bool = False
    away: str = "-y"
    delta_scale: float = 0.2

    def __post_init__(self) -> None:
        # Not the base class's, which expects cameras of LeRobot's.
        try:
            task = env_class(self.task)
        except ValueError as error:
            raise OptionError(f"robot.task: {error}") from None
        if self.seed < 0 or self.episode < 0:
            raise OptionError(f"Seeds and episodes count from 0, got {self.seed} and {self.episode}.")
        if not set(self.camera_names()) <= set(task.cameras):
            raise OptionError(
                f"{self.task} has the cameras {', '.join(sorted(task.cameras))}; got robot.cameras={self.cameras}."
            )
        if self.camera_size < 1:
            raise OptionError(f"robot.camera_size must be positive, got {self.camera_size}.")
        if self.window and "human" not in task.metadata["render_modes"]:
            raise OptionError("robot.window needs a display: DISPLAY is not set.")
        if self.deltas and len(task.mounts) > 1:
            raise OptionError(f"robot.deltas move a single arm; {self.task} has {len(task.mounts)}.")

    def camera_names(self) -> list[str]:
        """Returns the names of the observed cameras."""
        return [name.strip() for name in self.cameras.split(",") if name.strip()]
