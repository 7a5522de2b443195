"""Where things are to be put: the sliding panel, the match board, the pots; and the jacks for the pots.

The tables are in scaled units (SU of a metre).
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from surrol_gym.tasks.match_board import BOARD_TOP, GLYPHS, TILE
from surrol_gym.tasks.match_board_panel import CELL_PITCH, HANDLE, LID_POSITION, PANEL_POSITION
from tools.assets import glyphs, meshes
from tools.assets.glyphs import BLUE, GREEN, RED, SU
from tools.assets.urdf import BLACK, DARK, collision, link, node, obj, visual, write_urdf

WOOD = (0.86, 0.76, 0.58)
WOOD_INSET = (0.95, 0.89, 0.76)
POT_RED = (0.72, 0.08, 0.16)
POT_GREEN = (0.05, 0.75, 0.12)

# ---- Panel (docs/objects.md#panel) ----

LID_TRAVEL = 0.375
LID_THICKNESS = 0.0125  # and of the plates
# A hair off the cells, so that neighbouring lids do not rub.
LID_WIDTH = CELL_PITCH - 0.001
LID_HEIGHT = LID_POSITION[2] - PANEL_POSITION[2]


def write_match_panel(folder: Path) -> None:
    """Nine plates under three lids that slide along +y; the origin is 0.1 mm above the middle of the plates."""
    half = np.array([CELL_PITCH - 0.002, CELL_PITCH - 0.002, LID_THICKNESS]) / 2
    plate = obj(folder, "match_panel_plate", _box_mesh(-half, half, 0.0006))
    colours = [(BLUE, RED, GREEN), (RED, GREEN, BLUE), (GREEN, BLUE, RED)]
    shapes = [collision(_box(3 * CELL_PITCH, 3 * CELL_PITCH, LID_THICKNESS), _metres(0, 0, -0.0001))]
    # The plates leave narrow gaps, and a dark sheet below shows in them.
    shapes.append(visual(_box(3 * CELL_PITCH - 0.004, 3 * CELL_PITCH - 0.004, 0.009), DARK, _metres(0, 0, -0.0001)))
    for row in range(3):
        for column in range(3):
            at = _metres(CELL_PITCH * (row - 1), CELL_PITCH * (column - 1), -0.0001)
            shapes.append(visual(plate, colours[row][column], at))
    parts = [link("plates", *shapes)]
    for row, colour in enumerate((RED, GREEN, BLUE)):
        parts += [_lid_joint(row), link(f"lid{row}", *_lid_shapes(folder, colour), mass=0.2, friction=1)]
    write_urdf(folder, "match_panel", *parts)


def _lid_joint(row: int) -> ET.Element:
    return node(
        "joint",
        node("parent", link="plates"),
        node("child", link=f"lid{row}"),
        node("origin", xyz=_metres(CELL_PITCH * (row - 1), 0, LID_HEIGHT), rpy=(0, 0, 0)),
        node("axis", xyz=(0, 1, 0)),
        node("limit", lower=0, upper=SU * LID_TRAVEL, effort=240, velocity=1),
        name=f"slide{row}",
        type="prismatic",
    )


def _lid_shapes(folder: Path, colour: tuple) -> list[ET.Element]:
    """The lid, its handle and the ball on top of the handle."""
    half = np.array([LID_WIDTH, 3 * CELL_PITCH, LID_THICKNESS]) / 2
    slab = _box_mesh(-half, half, 0.001)
    knob = [(0.003125, -0.0125), (0.003125, 0.0066)]
    turn = np.radians(np.linspace(-55, 90, 9))
    knob += list(zip(0.00625 * np.cos(turn), 0.0125 + 0.00625 * np.sin(turn), strict=True))
    handle_at, ball_at = _metres(*HANDLE), _metres(*HANDLE[:2], 2 * HANDLE[2])
    return [
        visual(obj(folder, "match_panel_lid", slab), colour),
        visual(obj(folder, "match_panel_handle", meshes.lathe(SU * np.array(knob), 16)), DARK, handle_at),
        collision(_box(*(2 * half))),
        collision(node("cylinder", radius=SU * 0.003125, length=SU * 0.025), handle_at),
        collision(node("sphere", radius=SU * 0.00625), ball_at),
    ]


# ---- Match board (docs/objects.md#match-board) ----

FLOOR, UNDERSIDE = -0.0006, -0.0105
LAYOUT = [GLYPHS[row : row + 3] for row in (0, 3, 6)]
# How much wider than its glyph a recess is, on each side.
CLEARANCE = {
    "0": 0.0096,
    "1": 0.0084,
    "2": 0.0058,
    "4": 0.0024,
    "5": 0.0063,
    "6": 0.0043,
    "A": 0.0060,
    "B": 0.0036,
    "C": 0.0048,
}


def recess(glyph: str) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest (x, y) of the recess for a glyph, about the centre of its tile, in scaled units."""
    low, high = glyphs.bounds(glyph)
    return low - CLEARANCE[glyph], high + CLEARANCE[glyph]


def write_match_board(folder: Path) -> None:
    """Nine tiles, each with a rectangular recess that has the glyph painted on its floor; they do not move."""
    half = 1.5 * TILE
    slab = (-half, -half, UNDERSIDE), (half, half, FLOOR)
    walls = [box for row in range(3) for box in _walls_of_row(row)]
    shapes = []
    for low, high in [slab, *walls]:
        shapes.append(collision(_box(*np.subtract(high, low)), _metres(*(np.add(low, high) / 2))))
    wood = meshes.merge(*(_box_mesh(low, high, 0) for low, high in walls))
    below = _box_mesh((-half, -half, UNDERSIDE), (half, half, FLOOR - 0.0005), 0)
    shapes.append(visual(obj(folder, "match_board", meshes.merge(wood, below)), WOOD))
    shapes.append(visual(obj(folder, "match_board_lines", _line_mesh(half)), BLACK))
    insets = []
    paint: dict[tuple, list[meshes.Mesh]] = {RED: [], GREEN: [], BLUE: []}
    for row, column, glyph in _tiles():
        at = np.array([TILE * (row - 1), TILE * (column - 1)])
        near, far = recess(glyph)
        insets.append(_box_mesh((*(at + near), FLOOR - 0.001), (*(at + far), FLOOR), 0))
        # Fatter than the piece, which leaves a coloured rim around it once it lies there.
        painted = glyphs.solid(glyph, FLOOR, FLOOR + 0.0005, 0, grow=0.5 * CLEARANCE[glyph])
        paint[glyphs.COLOURS[glyph]].append(meshes.place(painted, _metres(*at, 0)))
    shapes.append(visual(obj(folder, "match_board_insets", meshes.merge(*insets)), WOOD_INSET))
    for name, colour in (("red", RED), ("green", GREEN), ("blue", BLUE)):
        shapes.append(visual(obj(folder, f"match_board_{name}", meshes.merge(*paint[colour])), colour))
    write_urdf(folder, "match_board", link("match_board", *shapes, friction=1))


def _tiles() -> list[tuple[int, int, str]]:
    """(row, column, glyph) of all tiles."""
    return [(row, column, glyph) for row, line in enumerate(LAYOUT) for column, glyph in enumerate(line)]


def _walls_of_row(row: int) -> list[tuple[tuple, tuple]]:
    """Boxes (low, high) that leave a row's recesses free: four bars along x, and the two ends of each recess."""
    x = TILE * (row - 1)
    boxes, start = [], -1.5 * TILE
    for column, glyph in enumerate(LAYOUT[row]):
        low, high = np.array(recess(glyph)) + (x, TILE * (column - 1))
        boxes.append(((x - TILE / 2, start, FLOOR), (x + TILE / 2, low[1], BOARD_TOP)))
        boxes.append(((x - TILE / 2, low[1], FLOOR), (low[0], high[1], BOARD_TOP)))
        boxes.append(((high[0], low[1], FLOOR), (x + TILE / 2, high[1], BOARD_TOP)))
        start = high[1]
    boxes.append(((x - TILE / 2, start, FLOOR), (x + TILE / 2, 1.5 * TILE, BOARD_TOP)))
    return boxes


def _line_mesh(half: float) -> meshes.Mesh:
    """The thin black lines around the tiles, just proud of the wood."""
    width, low, high = 0.0022, BOARD_TOP - 0.001, BOARD_TOP + 0.0004
    bars = []
    for line in np.linspace(-half + width, half - width, 4):
        bars.append(_box_mesh((line - width, -half, low), (line + width, half, high), 0))
        bars.append(_box_mesh((-half, line - width, low), (half, line + width, high), 0))
    return meshes.merge(*bars)


# ---- Pots and jacks (docs/objects.md#pots-and-jacks) ----


def write_pots(folder: Path) -> None:
    """Two shallow dishes of the same shape; the origin is the centre, half their height up."""
    profile = [
        (0.0605, -0.0081),
        (0.0628, -0.0076),
        (0.0690, 0.0068),
        (0.0697, 0.0076),
        (0.0695, 0.0081),
        (0.0677, 0.0081),
        (0.0671, 0.0075),
        (0.0606, -0.0056),
        (0.0590, -0.00645),
    ]
    dish = obj(folder, "pot", meshes.lathe(SU * np.array(profile), 48))
    sides, tilt = 12, np.arctan2(0.0068, 0.0145)
    # The floor is felt 0.4 mm below the one seen, for the margins that PyBullet gives it and `write_jacks` the jacks:
    # a jack stands on what is seen.
    floor = node("cylinder", radius=SU * 0.0628, length=SU * 0.002)
    # Twelve flats: their middles lie inside the round rim, their corners outside.
    rim = _box(0.003, 0.0375, 0.0163)
    for name, colour in (("pot_red", POT_RED), ("pot_green", POT_GREEN)):
        shapes = [
            visual(dish, colour),
            collision(floor, _metres(0, 0, -0.00945)),
        ]
        for turn in 2 * np.pi / sides * np.arange(sides):
            at = _metres(0.0658 * np.cos(turn), 0.0658 * np.sin(turn), 0.0002)
            shapes.append(collision(rim, at, (0, tilt, turn)))
        write_urdf(folder, name, link(name, *shapes, friction=1))


HUB = np.array([0, 0.01585, 0])
BALLS = np.array([(0, 0.04474, 0), (0.02358, 0.00621, -0.01362), (-0.02358, 0.00621, -0.01362), (0, 0.00621, 0.02723)])
BALL_RADIUS, ROD_RADIUS = 0.00566, 0.00358


def write_jacks(folder: Path) -> None:
    """Two jacks: four balls on rods, three of them feet and the fourth up along y.

    Their centre of mass is the link origin, below the feet: they right themselves.
    """
    parts = [meshes.place(_ball_mesh(ROD_RADIUS), SU * HUB)]
    for ball in BALLS:
        middle, rpy, length = _rod(ball)
        rod = meshes.lathe([(SU * ROD_RADIUS, -SU * length / 2), (SU * ROD_RADIUS, SU * length / 2)], 12)
        parts += [meshes.place(_ball_mesh(BALL_RADIUS), SU * ball), meshes.place(rod, SU * middle, rpy)]
    look = obj(folder, "jack", meshes.merge(*parts))
    # As thick as SurRoL's hulls are with the margin that PyBullet gives them.
    ball_shape = node("sphere", radius=SU * (BALL_RADIUS + glyphs.MARGIN))
    for name, colour in (("jack_red", RED), ("jack_green", GREEN)):
        shapes = [visual(look, colour)]
        for ball in BALLS:
            middle, rpy, length = _rod(ball)
            rod_shape = node("capsule", radius=SU * (ROD_RADIUS + glyphs.MARGIN), length=SU * length)
            shapes += [collision(ball_shape, SU * ball), collision(rod_shape, SU * middle, rpy)]
        size = _metres(0.0585, 0.0498, 0.0521)
        write_urdf(folder, name, link(name, *shapes, mass=0.1, size=size, friction=1))


def _rod(ball: np.ndarray) -> tuple[np.ndarray, tuple, float]:
    """The middle of a ball's rod, the turn of the rod from z, and its length."""
    along = ball - HUB
    length = float(np.linalg.norm(along))
    pitch, yaw = np.arccos(along[2] / length), np.arctan2(along[1], along[0])
    return (ball + HUB) / 2, (0, pitch, yaw), length


def _ball_mesh(radius: float) -> meshes.Mesh:
    turn = np.radians(np.linspace(-90, 90, 11))
    return meshes.lathe(SU * radius * np.c_[np.cos(turn), np.sin(turn)], 16)


# ---- Helpers ----


def _metres(*su: float) -> tuple:
    return tuple(SU * np.array(su))


def _box(*size: float) -> ET.Element:
    """A box, its size in scaled units."""
    return node("box", size=_metres(*size))


def _box_mesh(low: Iterable[float], high: Iterable[float], bevel: float) -> meshes.Mesh:
    """The box between two corners in scaled units."""
    return meshes.box(_metres(*low), _metres(*high), SU * bevel)
