"""What the arms carry and hang up: gauze, blocks and their peg boards, rings and their board.

Convex meshes get PyBullet's collision margin added outside, 0.2 mm in real units (MARGIN); boxes and capsules do not.
"""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from surrol_gym.tasks import bi_peg_board
from surrol_gym.tasks.peg_board import PEGS
from surrol_gym.units import to_metres
from tools.assets import meshes
from tools.assets.urdf import BLACK, QUARTER, SKIN, collision, link, node, obj, obj_hulls, visual, write_urdf

BLUE = (0.05, 0.4, 0.82)
RED = (0.86, 0.17, 0.14)
GAUZE_WHITE = (0.96, 0.96, 0.95)

MARGIN = 0.0002


def write_gauze(folder: Path) -> None:
    """Gauze pad; only a small box at its centre is felt (docs/objects.md#gauze)."""
    half = 0.0015
    gauze = link(
        "gauze",
        visual(obj(folder, "gauze", _gauze_mesh(-half)), GAUZE_WHITE),
        collision(node("box", size=(0.004, 0.002, 2 * half))),
        mass=0.05,
        size=(0.004, 0.002, 2 * half),
        friction=1,
    )
    write_urdf(folder, "gauze", gauze)


def write_block(folder: Path, name: str, colour: tuple) -> None:
    """Triangular prism with a hexagonal hole; the link origin is its centre (docs/objects.md)."""
    # Felt as six prisms, one behind each flat of the hole. Their walls are 0.24 mm thicker than those seen, mostly at
    # the cost of the hole: so they have the volume, inertia and height of SurRoL's hulls, and jaws as light as SurRoL's
    # close on them to the same angle.
    inner, outer, tip, half = 0.003957, 0.00504, 0.00975, 0.0075 - MARGIN
    slope = np.tan(np.radians(30))
    wall = [(inner, -inner * slope), (outer, -outer * slope), (outer, outer * slope), (inner, inner * slope)]
    corner = [*wall[:2], (tip, 0), *wall[2:]]
    pieces = []
    for azimuth in range(0, 360, 60):
        section = wall if azimuth % 120 else corner
        prism = meshes.loft([np.c_[section, np.full(len(section), z)] for z in (-half, half)])
        pieces.append(meshes.place(prism, (0, 0, 0), (0, 0, np.radians(azimuth))))
    look = visual(obj(folder, "block", _block_mesh()), colour)
    felt = collision(obj_hulls(folder, "block_hulls", pieces))
    write_urdf(folder, name, link(name, look, felt, mass=0.01, size=(0.0147, 0.0169, 0.015), friction=1))


def write_peg_board(folder: Path, name: str, top: float) -> None:
    """Board with twelve pegs whose tips are felt at height `top`; the link origin is the board's centre.

    See docs/objects.md.
    """
    rods = [meshes.place(_rod(0.0015, 0.03, 0.0007), (x, y, 0)) for x, y in PEGS]
    shapes = [
        visual(obj(folder, "peg_board", _board_mesh()), SKIN),
        # The rods end 0.8 mm above what is felt of them.
        visual(obj(folder, "peg_board_pegs", meshes.merge(*rods)), BLACK, (0, 0, top + 0.0008 - 0.015)),
        collision(node("box", size=(0.103, 0.154, 0.022))),
    ]
    # The radius is SurRoL's 1 mm with the margin. Capsules, see `_capsule`.
    shapes += [_capsule(0.001 + MARGIN, (x, y, 0.008), (x, y, top)) for x, y in PEGS]
    write_urdf(folder, name, link(name, *shapes, friction=0.5))


def write_ring_board(folder: Path) -> None:
    """Floor and wall with pegs; the link origin is the middle of the floor plate's thickness.

    See docs/objects.md#ring-and-ring-board.
    """
    floor = (-0.08196, -0.092, -0.0039), (0.0835, 0.092, 0.0039)
    wall = (-0.0898, -0.0926, -0.0045), (-0.0804, 0.0926, 0.1621)
    plates = meshes.merge(meshes.box(*floor, 0.0008), meshes.box(*wall, 0.0008))
    shapes = [visual(obj(folder, "ring_board", plates), SKIN)]
    for low, high in (floor, wall):
        shapes.append(collision(node("box", size=np.subtract(high, low)), tuple(np.add(low, high) / 2)))
    peg = obj(folder, "ring_board_peg", _rod(0.002792, 0.02186, 0.001))
    radius, half = 0.002592 + MARGIN, 0.01162 + MARGIN
    for y in to_metres(bi_peg_board.UPRIGHT_Y):
        shapes.append(visual(peg, BLACK, (0, y, 0.0148)))
        shapes.append(_capsule(radius, (0, y, 0.0148 - half), (0, y, 0.0148 + half)))
    x, _, origin_z = to_metres(np.subtract((bi_peg_board.HANGING_X, 0, 0), bi_peg_board.BOARD_POSITION))
    for z in to_metres(bi_peg_board.HANGING_Z) + origin_z:
        for y in to_metres(bi_peg_board.HANGING_Y):
            shapes.append(visual(peg, BLACK, (x, y, z), (0, QUARTER, 0)))
            shapes.append(_capsule(radius, (x - half, y, z), (x + half, y, z)))
    write_urdf(folder, "ring_board", link("ring_board", *shapes, friction=0.5))


def write_ring(folder: Path, name: str, colour: tuple) -> None:
    """Ring about the x axis; the link origin is its centre (docs/objects.md#ring-and-ring-board)."""
    major = to_metres(bi_peg_board.RING_RADIUS)
    minor, count, sides = major - to_metres(bi_peg_board.HOLE_RADIUS), 12, 8
    # Straight pieces around the ring. Their flats across x lie in two planes, so that jaws closing along x (as the
    # experts' do) meet the same tube everywhere; the waypoints are over middles of pieces.
    angle = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    reach = (minor - MARGIN) / np.cos(np.pi / sides)
    ends = np.array([-1, 1]) * np.pi / count
    pieces = [meshes.loft(_sections(major, reach, angle, ends + 2 * np.pi * turn / count)) for turn in range(count)]
    seen = _sections(major, minor, 2 * np.pi * np.arange(12) / 12, 2 * np.pi * np.arange(41) / 40)
    look = visual(obj(folder, "ring", meshes.loft(seen, caps=False)), colour)
    felt = collision(obj_hulls(folder, "ring_hulls", pieces))
    ring = link(name, look, felt, mass=0.01, size=(0.0024, 0.019, 0.019), friction=1)
    # Contacts that take back half of an overlap in a sub-step. By PyBullet's default, a fifth, the jaws sink half the
    # tube's thickness into so light a body and hold it badly; taking back more, they shoot it away.
    stiffness = 1e5
    next(ring.iter("contact")).extend(
        [node("stiffness", value=stiffness), node("damping", value=stiffness / 240 * (1 / 0.5 - 1))]
    )
    write_urdf(folder, name, ring)


def _capsule(radius: float, start: ArrayLike, end: ArrayLike) -> ET.Element:
    """A peg to be felt between two points along z or x.

    Capsules rather than cylinders: PyBullet makes a hull of 64 points from a cylinder, which costs more time and has
    edges to roll over. The ends are rounded within the length.
    """
    start, end = np.array(start), np.array(end)
    rpy = (0, 0, 0) if start[0] == end[0] else (0, QUARTER, 0)
    length = np.linalg.norm(end - start) - 2 * radius
    return collision(node("capsule", radius=radius, length=length), tuple((start + end) / 2), rpy)


def _sections(major: float, minor: float, angle: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Cross-sections of a torus about x, at some turns about it; `angle` is that of a point about its section."""
    radius = major + minor * np.cos(angle)
    return np.array([np.c_[minor * np.sin(angle), radius * np.cos(t), radius * np.sin(t)] for t in turns])


def _rod(radius: float, length: float, round_off: float) -> meshes.Mesh:
    """An upright rod about the origin, its upper end rounded off."""
    turn = np.radians([0, 30, 60, 85])
    tip = [(radius - round_off * (1 - np.cos(t)), length / 2 - round_off * (1 - np.sin(t))) for t in turn]
    return meshes.lathe([(radius, -length / 2), *tip], 14)


def _board_mesh() -> meshes.Mesh:
    """Board of 103 x 154 x 22 mm, its corners and upper edges rounded."""
    x, y, z = 0.0515, 0.077, 0.011
    profile = [(0.0008, -z), (0, -z + 0.0008)]
    profile += [(0.003 * (1 - np.cos(t)), z - 0.003 * (1 - np.sin(t))) for t in np.radians([0, 20, 40, 60, 80, 90])]
    return meshes.loft([meshes.rectangle(x - inset, y - inset, at, 0.009 - inset, 6) for inset, at in profile])


def _block_mesh() -> meshes.Mesh:
    """The block as seen: bevelled edges, rounded corners."""
    half, bevel, rounding = 0.00725, 0.00025, 0.00029

    def outline(inset: float) -> np.ndarray:
        """Per corner: a point beside the hole's, an arc, and the mirror image of that point."""
        side = 0.005 - inset
        turn = np.radians([-60, -20, 20, 60])
        arc = np.c_[np.cos(turn), np.sin(turn)] * (rounding - inset) + (2 * (0.005 - rounding), 0)
        low = (side, -side * np.tan(np.radians(30)))
        return _three_times(np.r_[[low], arc, [(low[0], -low[1])]])

    def hole(outset: float) -> np.ndarray:
        """Two of its corners and the flat between them."""
        flat = 0.004157 + outset
        y = flat * np.tan(np.radians(30)) * np.array([-1, -0.6, -0.2, 0.2, 0.6, 1])
        return _three_times(np.c_[np.full(6, flat), y])

    profile = [(outline(0), bevel - half), (outline(0), half - bevel), (outline(bevel), half)]
    profile += [(hole(bevel), half), (hole(0), half - bevel), (hole(0), bevel - half), (hole(bevel), -half)]
    profile += [(outline(bevel), -half), profile[0]]
    return meshes.loft([np.c_[points, np.full(len(points), z)] for points, z in profile], caps=False)


def _three_times(points: np.ndarray) -> np.ndarray:
    """Points (n, 2), and the same turned by 120 and 240 degrees."""
    turn = np.radians([0, 120, 240])[:, None]
    x, y = points.T
    return np.stack([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y], axis=2).reshape(-1, 2)


def _gauze_mesh(bottom: float) -> meshes.Mesh:
    """Gauze folded into layers, lying on the height `bottom`: 15.2 x 25.5 x 2.45 mm."""
    columns, rows = 19, 31
    u, v = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows), indexing="ij")
    # Vertices crowd towards the rim, where the cloth turns down.
    u, v = np.sin(u * QUARTER * 0.9) / np.sin(QUARTER * 0.9), np.sin(v * QUARTER * 0.9) / np.sin(QUARTER * 0.9)
    x = 0.0072 * u * (1 + 0.02 * np.sin(5 * v + 1))
    y = 0.0124 * v * (1 + 0.015 * np.sin(4 * u + 2))
    waves = sum(
        np.sin(along_x * x + along_y * y + phase)
        for along_x, along_y, phase in [(900, 260, 0), (-700, 500, 1), (350, -620, 2), (250, 880, 4)]
    )
    edge = np.maximum(np.abs(u), np.abs(v))
    z = 0.00205 + 0.00009 * waves - 0.0005 * np.clip((edge - 0.86) / 0.14, 0, 1) ** 2
    top = np.c_[x.ravel(), y.ravel(), z.ravel()]
    index = np.arange(columns * rows).reshape(columns, rows)
    a, b, c, d = index[:-1, :-1].ravel(), index[1:, :-1].ravel(), index[1:, 1:].ravel(), index[:-1, 1:].ravel()
    rim = top[np.r_[index[:-1, 0], index[-1, :-1], index[:0:-1, -1], index[0, :0:-1]]]
    # The side bulges once a layer.
    heights = 0.0007 * np.array([0, 0.5, 1, 1, 1.5, 2])
    sides = [rim * (wide, wide, 0) + (0, 0, z) for z, wide in zip(heights, [0.98, 1, 0.98] * 2, strict=True)]
    points, faces = meshes.merge((top, np.concatenate([np.c_[a, b, c], np.c_[a, c, d]])), meshes.loft([*sides, rim]))
    low, high = points.min(axis=0), points.max(axis=0)
    return (points - (low + high) / 2) * (0.0152, 0.0255, 0.00245) / (high - low) + (0, 0, bottom + 0.001225), faces
