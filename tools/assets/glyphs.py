"""Letters and digits of the match boards: their strokes, outlines and loose pieces (docs/objects.md#pieces).

The tables are in scaled units (SU of a metre), in the frame of the piece: the top of a glyph at -x, its right at +y.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from surrol_gym.units import SCALING
from tools.assets import meshes
from tools.assets.urdf import collision, link, obj, obj_hulls, visual, write_urdf

SU = 1 / SCALING

RED = (0.78, 0.05, 0.08)
GREEN = (0.05, 0.6, 0.2)
BLUE = (0.08, 0.2, 0.75)

# PyBullet grows convex hull meshes by this much. Hulls are narrower by it, so that a piece is as wide as it looks, but
# not thinner: SurRoL's pieces, too, rest this far above what they stand on.
MARGIN = 0.001
HALF_HEIGHT = 0.0096
BEVEL = 0.0006


@dataclass(frozen=True)
class Stroke:
    """A line of some width through pieces of a path (points, 2), each starting where the last one ended.

    Every piece becomes one convex hull through its first, middle and last point. `level` cuts a straight slanted
    stroke along y instead of across.
    """

    width: float
    pieces: tuple[np.ndarray, ...]
    level: bool = False

    @property
    def path(self) -> np.ndarray:
        """All the points, once each; those of a closed path end with the first again."""
        return np.concatenate([self.pieces[0][:1], *(piece[1:] for piece in self.pieces)])


def _arc(centre: tuple, semi_axes: tuple, start: float, stop: float, hulls: int) -> tuple[np.ndarray, ...]:
    """Part of an ellipse; 0 degrees is the bottom (+x), 90 the right (+y), 180 the top."""
    turn = np.radians(np.linspace(start, stop, 8 * hulls + 1))
    points = np.array(centre) + np.c_[np.cos(turn), np.sin(turn)] * semi_axes
    return tuple(points[8 * hull : 8 * hull + 9] for hull in range(hulls))


def _line(*points: tuple) -> tuple[np.ndarray, ...]:
    """A straight piece between every two points."""
    return tuple(np.array(ends) for ends in zip(points, points[1:], strict=False))


def _end(pieces: tuple[np.ndarray, ...]) -> tuple:
    """Where a path ends, for the next one to begin."""
    return tuple(pieces[-1][-1])


_TWO = _arc((-0.0200, -0.0005), (0.0161, 0.0208), 276, 35, 3)
_SIX = (0.0180, 0.0)
_UPPER_B = _arc((-0.01768, 0.0010), (0.01768, 0.01400), 180, 0, 2)
_LOWER_B = _arc((0.01768, 0.0040), (0.01768, 0.01855), 180, 0, 2)

STROKES = {
    "0": [Stroke(0.0065, _arc((0, 0), (0.03635, 0.02075), 0, 360, 6))],
    "1": [Stroke(0.0090, _line((-0.0375, 0), (0.0375, 0)))],
    "2": [
        Stroke(0.0060, _TWO + _line(_end(_TWO), (0.0385, -0.0205))),
        Stroke(0.0060, _line((0.0385, -0.0244), (0.0385, 0.0235))),
    ],
    "4": [
        Stroke(0.0059, _line((0.0123, -0.0214), (-0.0391, 0.0127)), level=True),
        Stroke(0.0060, _line((0.0093, -0.0252), (0.0093, 0.0252))),
        Stroke(0.0068, _line((-0.0391, 0.0131), (0.0391, 0.0131))),
    ],
    "5": [
        Stroke(0.0060, _line((-0.0361, -0.0150), (-0.0361, 0.0170))),
        Stroke(0.0060, _line((-0.0391, -0.0120), (0.0008, -0.0120))),
        Stroke(0.0060, _arc((0.0156, -0.0015), (0.0205, 0.0194), 213, -68, 4)),
    ],
    "6": [
        Stroke(0.0040, _arc(_SIX, (0.0184, 0.0197), 0, 360, 6)),
        Stroke(0.0040, _arc((0.0180, 0.0100), (0.0531, 0.0297), 270, 182, 2)),
    ],
    "A": [
        Stroke(0.0062, _line((0.0388, -0.0329), (-0.0388, 0)), level=True),
        Stroke(0.0062, _line((-0.0388, 0), (0.0388, 0.0329)), level=True),
        Stroke(0.0057, _line((0.0119, -0.0210), (0.0119, 0.0210))),
    ],
    "B": [
        Stroke(0.0045, _line((-0.0373, -0.02225), (0.0373, -0.02225))),
        Stroke(0.0039, _line((-0.03536, -0.0240), (-0.03536, 0.0010)) + _UPPER_B),
        Stroke(
            0.0039,
            _line((0, -0.0240), (0, 0.0040)) + _LOWER_B + _line((0.03536, 0.0040), (0.03536, -0.0240)),
        ),
    ],
    "C": [Stroke(0.0061, _arc((0, 0.0070), (0.03655, 0.03845), 136, 404, 5))],
}
COLOURS = {"0": RED, "1": BLUE, "2": GREEN, "4": BLUE, "5": RED, "6": GREEN, "A": GREEN, "B": BLUE, "C": RED}


def edges(stroke: Stroke, grow: float = 0) -> np.ndarray:
    """The stroke's left and right edge (points, 2, 2), everywhere `grow` further out, ends included."""
    path = stroke.path
    along = np.diff(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    closed = np.allclose(path[0], path[-1])
    before, after = (along[-1:], along[:1]) if closed else (along[:1], along[-1:])
    tangent = np.concatenate([before, along]) + np.concatenate([along, after])
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    if not closed:
        path[0] -= grow * tangent[0]
        path[-1] += grow * tangent[-1]
    aside = np.c_[-tangent[:, 1], tangent[:, 0]]
    if stroke.level:
        aside = np.c_[np.zeros(len(path)), 1 / tangent[:, 0]]
    aside *= stroke.width / 2 + grow
    return np.stack([path + aside, path - aside], axis=1)


def bounds(glyph: str) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest (x, y) of a glyph."""
    points = np.concatenate([edges(stroke).reshape(-1, 2) for stroke in STROKES[glyph]])
    return points.min(axis=0), points.max(axis=0)


def solid(glyph: str, low: float, high: float, bevel: float, grow: float = 0) -> meshes.Mesh:
    """The glyph between two heights, in metres; the strokes are separate skins that overlap."""
    return meshes.merge(*(_stroke_solid(stroke, low, high, bevel, grow) for stroke in STROKES[glyph]))


def _stroke_solid(stroke: Stroke, low: float, high: float, bevel: float, grow: float) -> meshes.Mesh:
    # The bevel drops steeper than it goes in, so that it does not blend with the flat faces.
    drop = 1.3 * bevel
    heights = [low, low + drop, high - drop, high] if bevel else [low, high]
    skins = [edges(stroke, grow - (bevel if z in (low, high) else 0)) for z in heights]
    left, right = (
        SU * np.stack([np.c_[skin[:, side], np.full(len(skin), z)] for skin, z in zip(skins, heights, strict=True)])
        for side in (0, 1)
    )
    if np.allclose(left[:, 0], left[:, -1]):
        walls = [meshes.loft(right[:, :-1], caps=False), meshes.loft(left[:, :0:-1], caps=False)]
    else:
        walls = [meshes.loft(np.concatenate([right, left[:, ::-1]], axis=1), caps=False)]
    return meshes.merge(*walls, _ribbon(right[-1], left[-1]), _ribbon(left[0], right[0]))


def _ribbon(right: np.ndarray, left: np.ndarray) -> meshes.Mesh:
    """The sheet between two edges, seen from the side where it runs on with `left` to the left."""
    count = len(left)
    here = np.arange(count - 1)
    faces = [np.c_[here, here + 1, here + 1 + count], np.c_[here, here + 1 + count, here + count]]
    return np.concatenate([right, left]), np.concatenate(faces)


def hulls(glyph: str) -> list[np.ndarray]:
    """The convex pieces of a glyph, as points (n, 2) in scaled units; with PyBullet's margin they fill its outline."""
    pieces = []
    for stroke in STROKES[glyph]:
        skin = edges(stroke, -MARGIN)
        start = 0
        for piece in stroke.pieces:
            stop = start + len(piece) - 1
            corners = skin[sorted({start, (start + stop) // 2, stop})].reshape(-1, 2)
            pieces.append(_convex(corners))
            start = stop
    return pieces


def _convex(points: np.ndarray) -> np.ndarray:
    """The convex hull, counter-clockwise from its lowest x."""
    points = np.round(points, 7)
    corners = points[ConvexHull(points).vertices]
    return np.roll(corners, -np.lexsort(corners.T[::-1])[0], axis=0)


def _write_piece(folder: Path, name: str, glyph: str, mass: float, scale: float) -> None:
    """A loose piece, its link origin and centre of mass the glyph's origin."""
    height = 0.003 if glyph == "1" else HALF_HEIGHT
    low, high = bounds(glyph)
    size = SU * np.array([*(high - low), 2 * height])
    look = solid(glyph, -height, height, BEVEL)
    # The 1 is a plain bar, yet no box: in PyBullet jaws turn a box over, and hold a hull with its margin. It rests no
    # higher than a box would, as SurRoL's.
    felt = height - MARGIN if glyph == "1" else height
    # The margin does not scale with the piece: a smaller piece is 0.1 mm wider than it looks, which does no harm.
    flat = [np.array([np.c_[hull, np.full(len(hull), z)] for z in (-felt, felt)]) for hull in hulls(glyph)]
    shape = obj_hulls(folder, f"{name}_hulls", [meshes.loft(SU * scale * rings) for rings in flat])
    shapes = [visual(obj(folder, name, (scale * look[0], look[1])), COLOURS[glyph]), collision(shape)]
    write_urdf(folder, name, link(name, *shapes, mass=mass, size=scale * size, friction=1))


def write_glyphs(folder: Path) -> None:
    """The nine pieces of MatchBoard, and the letter of MatchBoardPanel, a smaller C."""
    for glyph in STROKES:
        _write_piece(folder, f"glyph_{glyph}", glyph, mass=0.05, scale=1)
    _write_piece(folder, "letter_C", "C", mass=0.1, scale=0.75)
