"""Writes every URDF and OBJ file of this folder: `python -m surrol_gym.assets.generate`.

Running it again gives the same bytes. Everything is in real metres; load with `globalScaling=5`. The dimensions are
those measured on SurRoL's scenes ("facts" and a section number below mean the project's notes, surrol-facts.md); the
shapes are our own.
"""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from surrol_gym.assets import meshes

HERE = Path(__file__).parent
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
BROWN = (0.47, 0.34, 0.2)


# ---------------------------------------------------------------------------------------------------------------- URDF


def node(tag: str, *children: ET.Element, **attributes) -> ET.Element:
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


def visual(geometry: ET.Element, colour: tuple, xyz: tuple = (0, 0, 0), rpy: tuple = (0, 0, 0)) -> ET.Element:
    """A coloured shape that is seen but not felt."""
    name = "_".join(f"{round(255 * channel):03d}" for channel in colour)
    return node(
        "visual",
        node("origin", xyz=xyz, rpy=rpy),
        node("geometry", geometry),
        node("material", node("color", rgba=(*colour, 1)), name=name),
    )


def collision(geometry: ET.Element, xyz: tuple = (0, 0, 0), rpy: tuple = (0, 0, 0)) -> ET.Element:
    """A shape that is felt but not seen."""
    return node("collision", node("origin", xyz=xyz, rpy=rpy), node("geometry", geometry))


def link(
    name: str,
    *shapes: ET.Element,
    mass: float = 0,
    com: tuple = (0, 0, 0),
    size: tuple = (0, 0, 0),
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
    name: str, parent: str, child: str, xyz: tuple, rpy: tuple, limits: tuple, effort: float, kind: str = "revolute"
) -> ET.Element:
    """A joint about or along the z axis of its child."""
    return node(
        "joint",
        node("parent", link=parent),
        node("child", link=child),
        node("origin", xyz=xyz, rpy=rpy),
        node("axis", xyz=(0, 0, 1)),
        node("limit", lower=limits[0], upper=limits[1], effort=effort, velocity=1 if kind == "prismatic" else 2.1),
        name=name,
        type=kind,
    )


def write_urdf(folder: Path, name: str, *parts: ET.Element) -> None:
    """Writes a robot description."""
    robot = node("robot", ET.Comment(" Written by surrol_gym.assets.generate; do not edit. "), *parts, name=name)
    ET.indent(robot)
    (folder / f"{name}.urdf").write_text(ET.tostring(robot, encoding="unicode") + "\n", newline="\n")


# ----------------------------------------------------------------------------------------------------------------- PSM


def write_psm(folder: Path, name: str, accent: tuple) -> None:
    """The Patient Side Manipulator: a base and eight joints (facts 1.2), the accent colour telling the arms apart.

    SurRoL's parallel linkage is cosmetic. Its bars hang motionless on the yaw link here, level as they are whenever the
    pitch joint is near zero, so the arm keeps exactly the joints that move the tool.
    """
    turned = (-QUARTER, -QUARTER, 0)
    write_urdf(
        folder,
        name,
        link("base_link", *_base_look(folder), mass=2.0161, size=(0.134, 0.407, 0.219)),
        joint("yaw", "base_link", "yaw_link", (0, 0.4864, 0), (QUARTER, -QUARTER, 0), (-1.5883, 1.5883), 100),
        link("yaw_link", *_yaw_look(folder, accent), mass=1.4705, com=(-0.0388, 0, 0.528), size=(0.145, 0.163, 0.296)),
        joint("pitch_end", "yaw_link", "pitch_end_link", (0, 0, 0), turned, (-0.9251, 0.9251), 100),
        link(
            "pitch_end_link",
            *_pitch_look(folder, accent),
            mass=2.091,
            com=(0.0442, 0.27985, 0),
            size=(0.08, 0.575, 0.078),
        ),
        joint(
            "main_insertion",
            "pitch_end_link",
            "main_insertion_link",
            (0, 0.4318, 0),
            (QUARTER, 0, 0),
            (0, 0.24),
            100,
            "prismatic",
        ),
        link(
            "main_insertion_link",
            *_insertion_look(folder),
            mass=0.22491,
            com=(-0.0001, -0.0041, 0.0099),
            size=(0.044, 0.083, 0.122),
        ),
        joint("tool_roll", "main_insertion_link", "tool_roll_link", (0, 0, 0.4162), (0, 0, 0), (-4.5379, 4.5379), 100),
        # The roll and wrist collision shapes have the bounding boxes of SurRoL's hulls (facts 1.3).
        link(
            "tool_roll_link",
            *_roll_look(folder),
            collision(node("cylinder", radius=0.00416, length=0.011), (0, 0, -0.0036)),
            mass=0.00033225,
            com=(0, 0, -0.0058),
            size=(0.0083, 0.0083, 0.011),
        ),
        joint("tool_pitch", "tool_roll_link", "tool_pitch_link", (0, 0, 0), turned, (-1.3963, 1.3963), 100),
        link(
            "tool_pitch_link",
            *_wrist_look(folder),
            collision(_wrist_hull(folder), (0, 0, 0.0001)),
            mass=0.00025784,
            com=(0.0036, 0, 0),
            size=(0.013, 0.0064, 0.008),
        ),
        joint("tool_yaw", "tool_pitch_link", "tool_yaw_link", (0.0091, 0, 0), turned, (-1.3963, 1.3963), 100),
        link(
            "tool_yaw_link",
            visual(node("cylinder", radius=0.0008, length=0.0068), STEEL),
            # SurRoL splits this mass over the hinge and a tip link 10.2 mm ahead. Put where it keeps their moment about
            # the hinge: without that inertia PyBullet's solver no longer holds the jaws.
            mass=0.2,
            com=(0, 0.0102 / np.sqrt(2), 0),
            size=(0.0013, 0.0013, 0.005),
        ),
        *_jaw(folder, "gripper1", side=1),
        *_jaw(folder, "gripper2", side=-1),
    )


def _base_look(folder: Path) -> list[ET.Element]:
    """The set-up arm's last housing, behind the yaw axis (which is y here, through the origin)."""
    body = meshes.box((-0.067, -0.36, -0.075), (0.067, -0.16, 0.075), 0.02)
    column = meshes.place(meshes.lathe([(0.052, 0.05), (0.052, 0.26), (0.045, 0.268)]), (0, -0.27, 0))
    collar = meshes.place(meshes.lathe([(0.058, 0), (0.064, 0.006), (0.064, 0.03)], 24), (0, -0.13, 0), (QUARTER, 0, 0))
    return [
        visual(obj(folder, "psm_base", meshes.merge(body, column)), WHITE),
        visual(obj(folder, "psm_base_collar", collar), DARK),
    ]


def _yaw_look(folder: Path, accent: tuple) -> list[ET.Element]:
    """Housing on the yaw axis (z, pointing away from the tool; x is up) and the linkage reaching for the carriage."""
    housing = meshes.box((-0.1, -0.0815, 0.45), (0.045, 0.0815, 0.6164), 0.02)
    plate = meshes.place(meshes.tongue(0.19, 0.026, -0.012, 0.012), (0, 0, 0), (QUARTER, np.pi, 0))
    plates = [meshes.place(plate, (0, y, z)) for y in (-0.055, 0.055) for z in (0.47, 0.566)]
    lower = meshes.box((0.115, -0.03, 0.045), (0.152, 0.03, 0.61), 0.008)
    upper = meshes.box((0.172, -0.022, 0.045), (0.2, 0.022, 0.61), 0.008)
    return [
        visual(obj(folder, "psm_yaw", housing), WHITE),
        visual(obj(folder, "psm_yaw_plates", meshes.merge(*plates)), DARK),
        visual(obj(folder, "psm_yaw_bar", lower), WHITE),
        visual(obj(folder, "psm_yaw_bar_accent", upper), accent),
    ]


def _pitch_look(folder: Path, accent: tuple) -> list[ET.Element]:
    """Beam of the carriage (y is up along the tool, x points back from it), rail, and cannula at the remote centre."""
    beam = meshes.box((0.03, 0.05, -0.039), (0.1, 0.6, 0.039), 0.012)
    rail = meshes.box((0.018, 0.075, -0.016), (0.034, 0.585, 0.016), 0.003)
    foot = meshes.box((-0.004, 0.03, -0.022), (0.085, 0.062, 0.022), 0.008)
    cannula = [(0.0085, -0.055), (0.0085, 0.012), (0.014, 0.03), (0.014, 0.07), (0.0075, 0.07)]
    return [
        visual(obj(folder, "psm_beam", beam), accent),
        visual(obj(folder, "psm_beam_rail", rail), BLACK),
        visual(obj(folder, "psm_beam_foot", foot), WHITE),
        visual(obj(folder, "psm_cannula", meshes.place(meshes.lathe(cannula), (0, 0, 0), (-QUARTER, 0, 0))), SILVER),
    ]


def _insertion_look(folder: Path) -> list[ET.Element]:
    """Sterile adapter, instrument housing and shaft (z points down the tool)."""
    adapter = meshes.box((0.001, -0.0415, -0.061), (0.02, 0.0415, 0.061), 0.006)
    housing = meshes.box((-0.03, -0.033, -0.05), (0.001, 0.033, 0.045), 0.008)
    # 11.4 mm across, drawn in to the wrist's 8.3 mm (facts 1.3).
    shaft = meshes.lathe([(0.0075, 0.04), (0.0075, 0.055), (0.0057, 0.06), (0.0057, 0.393), (0.00416, 0.4072)])
    return [
        visual(obj(folder, "psm_adapter", adapter), WHITE),
        visual(obj(folder, "psm_housing", housing), DARK),
        visual(obj(folder, "psm_shaft", shaft), BLACK),
    ]


def _roll_look(folder: Path) -> list[ET.Element]:
    """End of the shaft with the two ears that hold the wrist pin (along y)."""
    stub = meshes.lathe([(0.00416, -0.0091), (0.00416, -0.0042), (0.0036, -0.0030)], 20)
    ear = meshes.place(meshes.tongue(0.005, 0.0027, 0.0027, 0.0041), (0, 0, -0.0006), (-QUARTER, -QUARTER, 0))
    other = meshes.place(ear, (0, 0, 0), (0, 0, np.pi))
    return [
        visual(obj(folder, "psm_roll", meshes.merge(stub, ear, other)), SILVER),
        visual(node("cylinder", radius=0.0009, length=0.0087), STEEL, rpy=(QUARTER, 0, 0)),
    ]


def _wrist_look(folder: Path) -> list[ET.Element]:
    """Wrist between the pitch pin (z, at the origin) and the yaw pin (y, 9.1 mm along x)."""
    root = meshes.place(meshes.tongue(0.003, 0.0024, -0.0026, 0.0026), (0, 0, 0), (0, 0, np.pi))
    body = meshes.box((0.0016, -0.0032, -0.0037), (0.0066, 0.0032, 0.0037), 0.0009)
    ear = meshes.place(meshes.tongue(0.004, 0.0024, 0.0021, 0.0032), (0.0091, 0, 0), (-QUARTER, 0, 0))
    other = meshes.place(ear, (0, 0, 0), (np.pi, 0, 0))
    return [visual(obj(folder, "psm_wrist", meshes.merge(root, body, ear, other)), SILVER)]


def _wrist_hull(folder: Path) -> ET.Element:
    """Collision of the wrist, narrowing to both pins.

    A plain box would be 1.6 times too big: BiPegBoard starts with both wrists against its board (facts 1.7), and the
    corners of a box push the instruments 4 mm out.
    """
    stations = [(-0.0024, 0.0008, 0.0026), (0, 0.0024, 0.0032), (0.002, 0.0032, 0.004), (0.006, 0.0032, 0.004)]
    stations.append((0.0106, 0.0026, 0.0009))
    rings = []
    for x, y, z in stations:
        ring = meshes.rectangle(y, z, 0, min(y, z) / 2, 2)
        rings.append(np.c_[np.full(len(ring), x), ring[:, :2]])
    return obj(folder, "psm_wrist_hull", meshes.loft(rings))


def _jaw(folder: Path, name: str, side: int) -> tuple[ET.Element, ET.Element]:
    """One jaw, pointing along y from its hinge; shut, the inner faces of the two meet in x = 0 (facts 1.3)."""
    hub = meshes.lathe([(0.0023, -0.00195), (0.0023, -0.00005)], 20)
    # Stations along the blade: y, width in x, half height in z. The collision box is 1.4 x 10.2 x 1.8 mm.
    stations = [(0.0005, 0.0019, 0.0009), (0.003, 0.0017, 0.0009), (0.007, 0.0014, 0.0009), (0.0097, 0.001, 0.00065)]
    stations.append((0.0102, 0.0007, 0.00045))
    blade = []
    for y, width, height in stations:
        ring = meshes.rectangle(width / 2, height, 0, width / 4)
        blade.append(np.c_[width / 2 - ring[:, 0], np.full(len(ring), y), ring[:, 1]])
    jaw = obj(folder, "psm_jaw", meshes.merge(hub, meshes.loft(blade)))
    # Half a turn about y makes the second jaw: it mirrors x and puts its hub on the other half of the pin.
    return (
        joint(name, "tool_yaw_link", f"{name}_link", (0, 0, 0), (0, 0, 0), (-1, 1), 20),
        link(
            f"{name}_link",
            visual(jaw, SILVER, rpy=(0, 0 if side > 0 else np.pi, 0)),
            collision(node("box", size=(0.0014, 0.0102, 0.0018)), (side * 0.0007, 0.0051, 0)),
            # A compromise: peg transfer wants lighter jaws, pure friction grasps want heavier ones (facts 1.3).
            mass=0.1,
            com=(side * 0.000196, 0.001435, side * -0.000885),
            size=(0.0014, 0.0102, 0.0018),
            friction=1,
        ),
    )


# --------------------------------------------------------------------------------------------------------------- scene


def write_floor(folder: Path) -> None:
    """Brown ground, its top at z = 0."""
    slab, below = node("box", size=(6, 6, 0.02)), (0, 0, -0.01)
    write_urdf(folder, "floor", link("floor", visual(slab, BROWN, below), collision(slab, below)))


def write_table(folder: Path) -> None:
    """Table whose top is at z = 0.675; on its base at z = 0.001 that makes 3.380 scaled units (facts 1.1, 4)."""
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
    """Instrument tray, with or without the skin pad (facts 4.0); the link origin is its underside.

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


def main(folder: Path = HERE) -> None:
    """Writes all assets into a folder."""
    write_psm(folder, "psm", YELLOW)
    write_psm(folder, "psm2", GREEN)
    write_floor(folder)
    write_table(folder)
    write_tray(folder, "tray", pad=False)
    write_tray(folder, "tray_pad", pad=True)
    write_needle(folder)


if __name__ == "__main__":
    main()
