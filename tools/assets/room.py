"""What the tasks share: floor, table, tray, skin pad and the mark of a goal."""

from pathlib import Path

import numpy as np

from tools.assets import meshes
from tools.assets.urdf import (
    BROWN,
    DARK,
    QUARTER,
    RED,
    SKIN,
    TABLE_GREY,
    TRAY_GREY,
    collision,
    link,
    node,
    obj,
    visual,
    write_urdf,
)


def write_floor(folder: Path) -> None:
    """Brown ground, its top at z = 0."""
    slab, below = node("box", size=(6, 6, 0.02)), (0, 0, -0.01)
    write_urdf(folder, "floor", link("floor", visual(slab, BROWN, below), collision(slab, below)))


def write_goal(folder: Path) -> None:
    """Red sphere that marks a goal in pictures (docs/scenes.md#what-all-scenes-share)."""
    write_urdf(folder, "goal", link("goal", visual(node("sphere", radius=0.003), RED)))


def write_table(folder: Path) -> None:
    """Table whose top is at z = 0.675; on its base at z = 0.001 that makes 3.380 scaled units.

    See docs/scenes.md#what-all-scenes-share.
    """
    profile = [(0, 0.6606), (0.004, 0.664), (0.004, 0.6733), (0.003, 0.675)]
    rings = [meshes.rectangle(0.1835 + wider, 0.2645 + wider, z, 0.012 + wider, 5) for wider, z in profile]
    top = meshes.place(meshes.loft(rings), (0.0025, 0, 0))
    legs, feet = [], []
    for x in (-1, 1):
        for y in (-1, 1):
            knee, toe = np.array([0.15 * x, 0.235 * y, 0.661]), np.array([0.185 * x, 0.262 * y, 0.0])
            legs.append(meshes.tube([knee, toe + [0, 0, 0.01]], [0.0055, 0.0055], up=(1, 0, 0)))
            feet.append(meshes.place(meshes.lathe([(0.009, 0), (0.009, 0.012), (0.007, 0.016)], 10), toe))
    write_urdf(
        folder,
        "table",
        link(
            "table",
            visual(obj(folder, "table_top", top), TABLE_GREY),
            visual(obj(folder, "table_legs", meshes.merge(*legs)), TRAY_GREY),
            visual(obj(folder, "table_feet", meshes.merge(*feet)), DARK),
            collision(node("box", size=(0.416, 0.538, 0.05)), (0, 0, 0.65)),
        ),
    )


def write_tray(folder: Path, name: str, pad: bool) -> None:
    """Instrument tray, with or without the skin pad (docs/objects.md#tray); the link origin is its underside.

    Support heights above the origin: floor 0.362 mm, pad 6.2 mm.
    """
    # Half sizes x, y, height and corner radius: up the inside, over the rim and down the outside.
    profile = [
        (0.0480, 0.0861, 0.00036, 0.012),
        (0.0510, 0.0891, 0.00110, 0.014),
        (0.0528, 0.0909, 0.00320, 0.016),
        (0.0570, 0.0951, 0.02060, 0.019),
        (0.0580, 0.0961, 0.02220, 0.020),
        (0.0592, 0.0973, 0.02275, 0.021),
        (0.0600, 0.0981, 0.02220, 0.022),
        (0.0600, 0.0981, 0.02050, 0.022),
        (0.0588, 0.0969, 0.02040, 0.021),
        (0.0540, 0.0921, 0.00220, 0.017),
        (0.0510, 0.0891, 0.00000, 0.014),
    ]
    bowl = meshes.loft([meshes.rectangle(x, y, z, radius, 6) for x, y, z, radius in reversed(profile)])
    shapes = [
        visual(obj(folder, "tray", bowl), TRAY_GREY),
        collision(node("box", size=(0.12, 0.196, 0.000362)), (0, 0, 0.000181)),
    ]
    height, tilt = (0.025, 0.3) if pad else (0.022, 0)
    for side in (-1, 1):
        along_x, along_y = node("box", size=(0.12, 0.003, height)), node("box", size=(0.003, 0.196, height))
        shapes.append(collision(along_x, (0, side * 0.095, 0.011), (-side * tilt, 0, 0)))
        shapes.append(collision(along_y, (side * 0.058, 0, 0.011), (0, side * tilt, 0)))
    if pad:
        shapes.append(visual(obj(folder, "pad", _pad_mesh()), SKIN))
        shapes.append(collision(node("box", size=(0.101, 0.17, 0.0052)), (0, 0, 0.0036)))
    write_urdf(folder, name, link(name, *shapes, friction=1))


def _pad_mesh() -> meshes.Mesh:
    """Skin pad: a closed, gently wavy sheet whose mean height is the top of its collision box.

    The waves stay below 0.3 mm, so that they never swallow the needle (radius 0.5 mm, resting 0.8 mm up).
    """
    columns, rows = 33, 47
    u, v = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows), indexing="ij")
    # Vertices crowd towards the rim, where the sheet rounds off.
    u, v = np.sin(u * QUARTER * 0.82) / np.sin(QUARTER * 0.82), np.sin(v * QUARTER * 0.82) / np.sin(QUARTER * 0.82)
    x = 0.0505 * u + 0.0004 * np.sin(9 * v + 1)
    y = 0.085 * v + 0.0005 * np.sin(7 * u + 2)
    waves = sum(
        np.sin(along_x * x + along_y * y + phase)
        for along_x, along_y, phase in [(430, 90, 0), (-290, 150, 1), (360, -260, 2), (130, 330, 4)]
    )
    edge = np.maximum(np.abs(u), np.abs(v))
    z = 0.0062 + 0.00007 * waves - 0.0012 * np.clip((edge - 0.93) / 0.07, 0, 1) ** 2
    index = np.arange(columns * rows).reshape(columns, rows)
    a, b, c, d = index[:-1, :-1].ravel(), index[1:, :-1].ravel(), index[1:, 1:].ravel(), index[:-1, 1:].ravel()
    top = np.c_[x.ravel(), y.ravel(), z.ravel()], np.concatenate([np.c_[a, b, c], np.c_[a, c, d]])
    rim = np.r_[index[:-1, 0], index[-1, :-1], index[:0:-1, -1], index[0, :0:-1]]
    outline = top[0][rim]
    skirt = meshes.loft([outline * (1, 1, 0) + (0, 0, 0.001), outline], caps=False)
    return meshes.merge(top, skirt)
