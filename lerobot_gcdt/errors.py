"""Errors that LeRobot's commands print as they are."""

from draccus.utils import DecodingError


class OptionError(DecodingError):
    """An option of a command has a bad value.

    Draccus, which reads the options of `lerobot-train` and `lerobot-eval`, hides the message of a ``ValueError``; this
    one ends the command with its message as the last line.
    """

    def __init__(self, message: str):
        super().__init__((), message)
