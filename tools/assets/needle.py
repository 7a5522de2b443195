"""The surgical needle."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from tools.assets import meshes
from tools.assets.urdf import QUARTER, STEEL, collision, link, node, obj, visual, write_urdf


def write_needle(folder: Path) -> None:
    """Half-circle needle of radius 20 mm; the link origin is the centre of the arc (docs/objects.md#needle)."""
    turn = np.radians(np.r_[np.linspace(90, 262.5, 36), np.linspace(264, 270, 5)])
    path = 0.02 * np.c_[np.cos(turn), np.sin(turn), np.zeros(len(turn))]
    # The last 7.5 degrees run out into the point.
    radii = np.r_[np.full(36, 0.0005), np.linspace(0.00042, 0.00002, 5)]
    shapes = [visual(obj(folder, "needle", meshes.tube(path, radii, up=(0, 0, 1))), STEEL)]
    # Seven straight capsules, the cheapest shape to collide; one lies across the middle and one 60 degrees to either
    # side, where experts grasp. They are as thick as SurRoL's hulls with their margin, so that the needle rests and
    # opens the jaws as it does there.
    ends, radius = np.radians([90, 105, 135, 165, 195, 225, 255, 270]), 0.0199
    for start, end in pairwise(ends):
        middle, length = (start + end) / 2, 2 * radius * np.tan((end - start) / 2)
        piece = node("capsule", radius=0.00082, length=length)
        shapes.append(collision(piece, (radius * np.cos(middle), radius * np.sin(middle), 0), (QUARTER, 0, middle)))
    needle = link("needle", *shapes, mass=0.05, com=(-0.0127, 0, 0), size=(0.0205, 0.041, 0.0012), friction=1)
    write_urdf(folder, "needle", needle)
