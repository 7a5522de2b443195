"""The few URDF elements that the assets are made of, and the colours they share."""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tools.assets import meshes

QUARTER = np.pi / 2

WHITE = (0.88, 0.89, 0.9)
DARK = (0.13, 0.13, 0.15)
BLACK = (0.06, 0.06, 0.07)
SILVER = (0.72, 0.74, 0.8)
STEEL = (0.5, 0.52, 0.56)
YELLOW = (0.93, 0.76, 0.1)
GREEN = (0.1, 0.55, 0.2)
TRAY_GREY = (0.74, 0.76, 0.79)
SKIN = (0.93, 0.78, 0.64)
TABLE_GREY = (0.92, 0.92, 0.92)
RED = (0.9, 0.05, 0.05)
BROWN = (0.47, 0.34, 0.2)


def node(tag: str, *children: "ET.Element[Any]", **attributes: ArrayLike) -> ET.Element:
    """An XML element; numbers and sequences of numbers become attribute text."""
    text = {
        key: value if isinstance(value, str) else " ".join(f"{number + 0.0:.8g}" for number in np.atleast_1d(value))
        for key, value in attributes.items()
    }
    element = ET.Element(tag, text)
    element.extend(children)
    return element


def obj(folder: Path, name: str, mesh: meshes.Mesh) -> ET.Element:
    """Writes a mesh and returns the geometry that loads it."""
    meshes.write_obj(folder / f"{name}.obj", mesh)
    return node("mesh", filename=f"{name}.obj")


def obj_hulls(folder: Path, name: str, pieces: list[meshes.Mesh]) -> ET.Element:
    """Writes convex pieces into one OBJ, and returns the geometry in which PyBullet makes a hull of each.

    Pieces placed by the URDF instead would be boxed, turned and boxed again: PyBullet takes the inertia from such
    boxes, and tests more pairs for contact.
    """
    lines, offset = ["# Written by tools.assets.generate; do not edit."], 1
    for number, (points, faces) in enumerate(pieces):
        lines.append(f"o piece_{number}")
        lines += ["v {:z.6f} {:z.6f} {:z.6f}".format(*point) for point in points]
        lines += ["f {} {} {}".format(*face) for face in faces + offset]
        offset += len(points)
    (folder / f"{name}.obj").write_text("\n".join(lines) + "\n", newline="\n")
    return node("mesh", filename=f"{name}.obj")


def visual(geometry: ET.Element, colour: tuple, xyz: ArrayLike = (0, 0, 0), rpy: ArrayLike = (0, 0, 0)) -> ET.Element:
    """A coloured shape that is seen but not felt."""
    name = "_".join(f"{round(255 * channel):03d}" for channel in colour)
    return node(
        "visual",
        node("origin", xyz=xyz, rpy=rpy),
        node("geometry", geometry),
        node("material", node("color", rgba=(*colour, 1)), name=name),
    )


def collision(geometry: ET.Element, xyz: ArrayLike = (0, 0, 0), rpy: ArrayLike = (0, 0, 0)) -> ET.Element:
    """A shape that is felt but not seen."""
    return node("collision", node("origin", xyz=xyz, rpy=rpy), node("geometry", geometry))


def link(
    name: str,
    *shapes: ET.Element,
    mass: float = 0,
    com: ArrayLike = (0, 0, 0),
    size: ArrayLike = (0, 0, 0),
    friction: float = 0.5,
) -> ET.Element:
    """A link; its inertia is that of a solid box of `size` (PyBullet replaces it by one from the collision shapes)."""
    x, y, z = np.square(size) * mass / 12
    return node(
        "link",
        node(
            "contact",
            node("lateral_friction", value=friction),
            node("rolling_friction", value=0),
            node("spinning_friction", value=0),
        ),
        node(
            "inertial",
            node("origin", xyz=com, rpy=(0, 0, 0)),
            node("mass", value=mass),
            node("inertia", ixx=y + z, iyy=x + z, izz=x + y, ixy=0, ixz=0, iyz=0),
        ),
        *shapes,
        name=name,
    )


def joint(
    name: str, parent: str, child: str, xyz: tuple, rpy: tuple, limits: tuple, kind: str = "revolute"
) -> ET.Element:
    """A joint about or along the z axis of its child."""
    return node(
        "joint",
        node("parent", link=parent),
        node("child", link=child),
        node("origin", xyz=xyz, rpy=rpy),
        node("axis", xyz=(0, 0, 1)),
        node("limit", lower=limits[0], upper=limits[1], effort=20, velocity=1 if kind == "prismatic" else 2.1),
        name=name,
        type=kind,
    )


def write_urdf(folder: Path, name: str, *parts: ET.Element) -> None:
    """Writes a robot description."""
    robot = node("robot", ET.Comment(" Written by tools.assets.generate; do not edit. "), *parts, name=name)
    ET.indent(robot)
    (folder / f"{name}.urdf").write_text(ET.tostring(robot, encoding="unicode") + "\n", newline="\n")
