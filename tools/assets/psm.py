"""The Patient Side Manipulator."""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np

from surrol_gym.psm.kinematics import INSERTION_OFFSET, JAW_LENGTH, JOINT_LIMITS, RCM_OFFSET, WRIST_OFFSET
from tools.assets import meshes
from tools.assets.urdf import (
    BLACK,
    DARK,
    QUARTER,
    SILVER,
    STEEL,
    WHITE,
    collision,
    joint,
    link,
    node,
    obj,
    visual,
    write_urdf,
)


def write_psm(folder: Path, name: str, accent: tuple) -> None:
    """The looks of the Patient Side Manipulator: a base and eight joints, the accent colour telling the arms apart.

    See docs/psm.md#kinematics. SurRoL's parallel linkage is cosmetic. Its bars hang motionless on the yaw link here,
    level as they are whenever the pitch joint is near zero, so the arm keeps exactly the joints that move the tool.
    """
    turned = (-QUARTER, -QUARTER, 0)
    yaw, pitch, insertion, roll, wrist_pitch, wrist_yaw = map(tuple, JOINT_LIMITS)
    shaft, pin = (0, 0.4318, 0), (WRIST_OFFSET, 0, 0)
    write_urdf(
        folder,
        name,
        link("base_link", *_base_look(folder)),
        joint("yaw", "base_link", "yaw_link", (0, RCM_OFFSET, 0), (QUARTER, -QUARTER, 0), yaw),
        link("yaw_link", *_yaw_look(folder, accent)),
        joint("pitch_end", "yaw_link", "pitch_end_link", (0, 0, 0), turned, pitch),
        link("pitch_end_link", *_pitch_look(folder, accent)),
        joint("main_insertion", "pitch_end_link", "insertion_link", shaft, (QUARTER, 0, 0), insertion, "prismatic"),
        link("insertion_link", *_insertion_look(folder)),
        joint("tool_roll", "insertion_link", "tool_roll_link", (0, 0, shaft[1] - INSERTION_OFFSET), (0, 0, 0), roll),
        link("tool_roll_link", *_roll_look(folder)),
        joint("tool_pitch", "tool_roll_link", "tool_pitch_link", (0, 0, 0), turned, wrist_pitch),
        link("tool_pitch_link", *_wrist_look(folder)),
        joint("tool_yaw", "tool_pitch_link", "tool_yaw_link", pin, turned, wrist_yaw),
        link("tool_yaw_link", visual(node("cylinder", radius=0.0008, length=0.0068), STEEL)),
        *_jaw("gripper1", visual(_jaw_look(folder), SILVER)),
        *_jaw("gripper2", visual(_jaw_look(folder), SILVER, rpy=(0, np.pi, 0))),
    )


def write_gripper(folder: Path) -> None:
    """What is simulated of the arm: link 5 and the two jaws, the parts that touch things (docs/psm.md#jaws)."""
    box = node("box", size=(0.0014, JAW_LENGTH, 0.0018))
    jaws: list[ET.Element] = []
    for name, side in (("gripper1", 1), ("gripper2", -1)):
        inertial = {"mass": 0.03, "com": (side * 0.000196, 0.001435, side * -0.000885), "friction": 1}
        jaws += _jaw(name, collision(box, (side * 0.0007, JAW_LENGTH / 2, 0)), **inertial)
    # A slim stand-in for the wrist: with its true width, BiPegBoard would start with both wrists in the board.
    wrist = collision(node("capsule", radius=0.0025, length=0.005), (0, -0.0065, 0), (QUARTER, 0, 0))
    write_urdf(folder, "psm_gripper", link("tool_yaw_link", wrist, mass=1), *jaws)


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
    # 11.4 mm across, drawn in to the wrist's 8.3 mm (docs/psm.md#jaws).
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
    """Wrist between the pitch pin (z, at the origin) and the yaw pin (y, along x)."""
    root = meshes.place(meshes.tongue(0.003, 0.0024, -0.0026, 0.0026), (0, 0, 0), (0, 0, np.pi))
    body = meshes.box((0.0016, -0.0032, -0.0037), (0.0066, 0.0032, 0.0037), 0.0009)
    ear = meshes.place(meshes.tongue(0.004, 0.0024, 0.0021, 0.0032), (WRIST_OFFSET, 0, 0), (-QUARTER, 0, 0))
    other = meshes.place(ear, (0, 0, 0), (np.pi, 0, 0))
    return [visual(obj(folder, "psm_wrist", meshes.merge(root, body, ear, other)), SILVER)]


def _jaw_look(folder: Path) -> ET.Element:
    """The first jaw, pointing along y from its hinge; shut, the inner faces of the two meet in x = 0.

    Half a turn about y makes the second: it mirrors x and puts the hub on the other half of the pin.
    """
    hub = meshes.lathe([(0.0023, -0.00195), (0.0023, -0.00005)], 20)
    # Stations along the blade: y, width in x, half height in z.
    stations = [(0.0005, 0.0019, 0.0009), (0.003, 0.0017, 0.0009), (0.007, 0.0014, 0.0009), (0.0097, 0.001, 0.00065)]
    stations.append((JAW_LENGTH, 0.0007, 0.00045))
    blade = []
    for y, width, height in stations:
        ring = meshes.rectangle(width / 2, height, 0, width / 4)
        blade.append(np.c_[width / 2 - ring[:, 0], np.full(len(ring), y), ring[:, 1]])
    return obj(folder, "psm_jaw", meshes.merge(hub, meshes.loft(blade)))


def _jaw(name: str, shape: ET.Element, **inertial: Any) -> tuple[ET.Element, ET.Element]:
    """A jaw on its hinge."""
    hinge = joint(name, "tool_yaw_link", f"{name}_link", (0, 0, 0), (0, 0, 0), (-1, 1))
    return hinge, link(f"{name}_link", shape, **inertial)
