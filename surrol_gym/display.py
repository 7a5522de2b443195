"""Whether a window can be opened here, and what says that it was closed."""

import os
import sys
from importlib.util import find_spec


class WindowClosed(RuntimeError):
    """The window of an environment was closed, by Esc or the mouse."""


def check_display() -> None:
    """Raises ValueError, with the reason, where no window can be opened; opens none."""
    # SDL, which pygame is made of, also draws where SDL_VIDEODRIVER says.
    if sys.platform.startswith("linux") and not os.environ.keys() & {"DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"}:
        raise ValueError("The scene is shown in a window, which needs a display: DISPLAY is not set.")
    if not find_spec("pygame"):
        raise ValueError("The scene is shown in a window, which needs pygame: `pip install pygame`.")
