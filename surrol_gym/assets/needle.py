"""The surgical needle."""

from pathlib import Path

import numpy as np

from surrol_gym.assets import meshes
from surrol_gym.assets.urdf import QUARTER, STEEL, collision, link, obj, visual, write_urdf


def write_needle(folder: Path) -> None:
    """Half-circle needle of radius 20 mm; the link origin is the centre of the arc (facts 4.0)."""
    turn = np.radians(np.r_[np.linspace(90, 262.5, 36), np.linspace(264, 270, 5)])
    path = 0.02 * np.c_[np.cos(turn), np.sin(turn), np.zeros(len(turn))]
    # The last 7.5 degrees run out into the point.
    radii = np.r_[np.full(36, 0.0005), np.linspace(0.00042, 0.00002, 5)]
    shapes = [visual(obj(folder, "needle", meshes.tube(path, radii, up=(0, 0, 1))), STEEL)]
    # Straight pieces, nine: the waypoints that experts grasp (0 and +-60 degrees) fall on middles, not on kinks.
    # Meshes rather than boxes: PyBullet adds its collision margin (0.2 mm here) only to convex hulls, and with it the
    # needle rests and opens the jaws as SurRoL's does.
    count, radius = 9, 0.0199
    step = np.pi / count
    ends = [meshes.rectangle(0.0006, radius * np.tan(step / 2), z, 0, 1) for z in (-0.00062, 0.00062)]
    piece = obj(folder, "needle_piece", meshes.loft(ends))
    for middle in QUARTER + step * (np.arange(count) + 0.5):
        at = (radius * np.cos(middle), radius * np.sin(middle), 0)
        shapes.append(collision(piece, at, (0, 0, middle)))
    needle = link("needle", *shapes, mass=0.05, com=(-0.0127, 0, 0), size=(0.0205, 0.041, 0.0012), friction=1)
    write_urdf(folder, "needle", needle)
