"""Configuration of the simulated arms."""

from dataclasses import dataclass
from pathlib import Path

from lerobot.robots import RobotConfig

from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.robot.config_psm import PSMConfig
from lerobot_gcdt.robot.recorded import recorded_task
from surrol_gym.display import check_display
from surrol_gym.registry import env_class


@RobotConfig.register_subclass("surrol_psm")
@dataclass(kw_only=True)
class SurRoLPSMConfig(PSMConfig):
    """Robot type ``surrol_psm``: ``--robot.type=surrol_psm --robot.task=PegTransfer --robot.seed=3``.

    Attributes:
        task: As in ``PSMConfig``. Left out, that of the recording, or NeedlePick.
        seed: Seed of the first episode.
        recording: Folder of a dataset of ``gcdt record``: its episode ``episode`` gives task and seed, and what was
            added to its actions is added again.
        episode: Which of them.
        cameras: Cameras that are observed, separated by commas, such as ``closeup,overview``.
        camera_size: Width and height of their pictures, pixels.
        window: Whether a window shows the scene.

    Raises:
        OptionError: A camera is unknown, a number is out of range, no window can be opened, or the recording is none,
            does not tell its seeds, or is of another task.
    """

    task: str = ""
    seed: int = 0
    recording: str = ""
    episode: int = 0
    cameras: str = ""
    camera_size: int = 128
    window: bool = False

    def __post_init__(self) -> None:
        given, self.task = self.task, self.task or PSMConfig.task
        super().__post_init__()
        if self.recording:
            self.task = recorded_task(Path(self.recording))
            if given and env_class(given) is not env_class(self.task):
                raise OptionError(f"{self.recording} is of {self.task}, not of {given}; leave out robot.task.")
        if self.seed < 0 or self.episode < 0:
            raise OptionError(f"Seeds and episodes count from 0, got {self.seed} and {self.episode}.")
        known = env_class(self.task).cameras
        if not set(self.camera_names()) <= set(known):
            raise OptionError(
                f"{self.task} has the cameras {', '.join(sorted(known))}; got robot.cameras={self.cameras}."
            )
        if self.camera_size < 1:
            raise OptionError(f"robot.camera_size must be positive, got {self.camera_size}.")
        if self.window:
            try:
                check_display()
            except ValueError as error:
                raise OptionError(f"robot.window: {error}") from None

    def camera_names(self) -> list[str]:
        """Returns the names of the observed cameras."""
        return [name.strip() for name in self.cameras.split(",") if name.strip()]
