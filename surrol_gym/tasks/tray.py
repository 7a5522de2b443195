"""The tray of the two tasks that sort things (docs/objects.md)."""

import numpy as np

from surrol_gym.bullet import World

TRAY_POSITION = (2.75, 0.0, 3.3755)


def load_tray(world: World) -> None:
    """Loads the tray; it stands a little deeper than the table, but a picture should show its floor."""
    world.load("tray.urdf", TRAY_POSITION, drawn=False)
    world.draw("tray.urdf", np.add(TRAY_POSITION, (0.0, 0.0, 0.003)))
