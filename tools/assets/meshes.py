"""Triangle meshes for the generated assets: a few shapes, and the OBJ writer.

A mesh is a pair `(vertices (n, 3), triangles (m, 3))`, counter-clockwise seen from outside. Lengths are real metres.

No trimesh: it orders faces and weighs normals in another way, so it would write other bytes than the committed ones.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

Mesh = tuple[np.ndarray, np.ndarray]

# Faces meeting at less than this angle share a normal; wide enough to smooth a bevel of two facets.
CREASE = np.cos(np.radians(50))


def loft(rings: ArrayLike, caps: bool = True) -> Mesh:
    """Joins rings of points into a skin.

    Args:
        rings: (rings, points, 3); convex, counter-clockwise seen from the far end of the loft.
        caps: Whether to close the first and the last ring.
    """
    rings = np.asarray(rings, float)
    count, points, _ = rings.shape
    corner = np.arange(points)
    following = np.roll(corner, -1)
    faces = []
    for start in points * np.arange(count - 1):
        low, low_next = start + corner, start + following
        faces += [np.c_[low, low_next, low_next + points], np.c_[low, low_next + points, low + points]]
    if caps:
        fan = np.c_[np.zeros(points - 2, int), corner[1:-1], corner[2:]]
        faces += [fan[:, ::-1], fan + points * (count - 1)]
    return rings.reshape(-1, 3), np.concatenate(faces)


def circle(radius: float, z: float, sides: int) -> np.ndarray:
    """A ring (sides, 3) around the z axis."""
    angle = 2 * np.pi * np.arange(sides) / sides
    return np.c_[radius * np.cos(angle), radius * np.sin(angle), np.full(sides, z)]


def rectangle(x: float, y: float, z: float, radius: float, corner_points: int = 3) -> np.ndarray:
    """A ring (4 * corner_points, 3): the rectangle |x|, |y| <= half sizes, its corners rounded by `radius`."""
    quarter = np.linspace(0, np.pi / 2, corner_points)
    corners = []
    for turn, (sign_x, sign_y) in enumerate([(1, 1), (-1, 1), (-1, -1), (1, -1)]):
        angle = quarter + turn * np.pi / 2
        corners.append(
            np.c_[
                sign_x * (x - radius) + radius * np.cos(angle),
                sign_y * (y - radius) + radius * np.sin(angle),
                np.full(corner_points, z),
            ]
        )
    return np.concatenate(corners)


def lathe(profile: Iterable[tuple[float, float]] | np.ndarray, sides: int = 18) -> Mesh:
    """Turns a profile of (radius, z) points, z rising, around the z axis."""
    return loft([circle(radius, z, sides) for radius, z in profile])


def box(low: ArrayLike, high: ArrayLike, bevel: float) -> Mesh:
    """The box between two corners, all its edges rounded by `bevel`."""
    low, high = np.array(low, float), np.array(high, float)
    x, y, z = (high - low) / 2
    turn = np.radians([0, 45, 90])
    profile = [(bevel * (1 - np.sin(t)), -z + bevel * (1 - np.cos(t))) for t in turn]
    profile += [(inset, -height) for inset, height in reversed(profile)]
    rings = [rectangle(x - inset, y - inset, height, bevel - inset) for inset, height in profile]
    return place(loft(rings), (low + high) / 2)


def tongue(length: float, radius: float, low: float, high: float) -> Mesh:
    """A flat lug across z from `low` to `high`: rounded about the origin, reaching to x = -length."""
    angle = np.radians(np.linspace(-90, 90, 9))
    outline = np.r_[np.c_[radius * np.cos(angle), radius * np.sin(angle)], [(-length, radius), (-length, -radius)]]
    return loft([np.c_[outline, np.full(len(outline), z)] for z in (low, high)])


def tube(path: ArrayLike, radii: ArrayLike, up: tuple[float, float, float], sides: int = 8) -> Mesh:
    """A round tube along a path (points, 3) that never runs parallel to `up`."""
    path = np.asarray(path, float)
    forward = np.gradient(path, axis=0)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    side = np.cross(up, forward)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    angle = 2 * np.pi * np.arange(sides) / sides
    section = np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * np.cross(forward, side)[:, None]
    return loft(path[:, None] + np.reshape(radii, (-1, 1, 1)) * section)


def place(mesh: Mesh, xyz: ArrayLike, rpy: ArrayLike = (0, 0, 0)) -> Mesh:
    """Turns a mesh about fixed axes x, y, z (as URDF does), then moves it."""
    rotation = Rotation.from_euler("xyz", rpy).as_matrix()
    return mesh[0] @ rotation.T + np.asarray(xyz, float), mesh[1]


def merge(*meshes: Mesh) -> Mesh:
    """One mesh from several."""
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in meshes])
    return (
        np.concatenate([vertices for vertices, _ in meshes]),
        np.concatenate([faces + offset for (_, faces), offset in zip(meshes, offsets[:-1], strict=True)]),
    )


def corner_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Normals (m, 3, 3) of the corners: the area-weighted mean of the faces at the vertex that are within CREASE."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    area = np.cross(b - a, c - a)
    unit = area / np.linalg.norm(area, axis=1, keepdims=True)
    around: list[list[int]] = [[] for _ in vertices]
    for face, corners in enumerate(faces):
        for vertex in corners:
            around[vertex].append(face)
    normals = np.empty((len(faces), 3, 3))
    for face, corners in enumerate(faces):
        for corner, vertex in enumerate(corners):
            near = np.array(around[vertex])
            near = near[unit[near] @ unit[face] > CREASE]
            normals[face, corner] = area[near].sum(axis=0)
    return normals / np.linalg.norm(normals, axis=2, keepdims=True)


def write_obj(path: Path, mesh: Mesh) -> None:
    """Writes an OBJ with normals: fixed decimals (1 um), equal points welded, faces without area dropped."""
    points, index = np.unique(np.round(mesh[0], 6) + 0.0, axis=0, return_inverse=True)
    faces = index.ravel()[mesh[1]]
    a, b, c = points[faces].transpose(1, 0, 2)
    faces = faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-14]
    normals, normal_index = np.unique(
        np.round(corner_normals(points, faces), 3).reshape(-1, 3) + 0.0, axis=0, return_inverse=True
    )
    corners = np.stack([faces, normal_index.reshape(-1, 3)], axis=2) + 1
    lines = ["# Written by tools.assets.generate; do not edit."]
    lines += ["v {:.6f} {:.6f} {:.6f}".format(*point) for point in points]
    lines += ["vn {:.3f} {:.3f} {:.3f}".format(*normal) for normal in normals]
    lines += ["f " + " ".join(f"{v}//{n}" for v, n in face) for face in corners]
    path.write_text("\n".join(lines) + "\n", newline="\n")
