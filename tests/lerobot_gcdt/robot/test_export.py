"""`gcdt export-dvrk`: what a user gets, and what is refused."""

import contextlib
import io
import json
import sys
from dataclasses import fields

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import gcdt_cli as cli
from lerobot_gcdt.robot.base_frame import simulated
from lerobot_gcdt.robot.files import read_npz
from lerobot_gcdt.robot.set_points import SetPoints

PICK = ["export-dvrk", "--policy", "expert", "--task", "NeedlePick", "--seed", "3", "--rate", "10"]
REGRASP = ["export-dvrk", "--policy", "expert", "--task", "NeedleRegrasp", "--seed", "3", "--rate", "10"]
"""Bends the wrists by more than the 1.2217 rad that are allowed."""


@pytest.fixture(scope="module")
def printed_and_exported(tmp_path_factory):
    folder, printed = tmp_path_factory.mktemp("exports") / "pick", io.StringIO()
    with contextlib.redirect_stdout(printed):
        cli.main([*PICK, "--out", str(folder), "--bag"])
    return printed.getvalue(), folder


@pytest.fixture
def exported(printed_and_exported):
    return printed_and_exported[1]


def test_it_writes_set_points_report_pictures_and_a_bag(exported):
    assert {path.name for path in exported.iterdir()} == {
        *("PSM1.csv", "trajectory.npz", "trajectory.png", "safety.txt", "safety.json", "safety.png", "bag")
    }
    assert {path.name for path in (exported / "bag").iterdir()} == {"bag.mcap", "metadata.yaml"}
    for name in ("trajectory.png", "safety.png"):
        assert min(Image.open(exported / name).size) > 400
    assert json.loads((exported / "safety.json").read_text())["safe"]


def test_the_table_names_its_units_and_holds_the_set_points(exported):
    table = pd.read_csv(exported / "PSM1.csv")
    points = read_npz(exported / "trajectory.npz").arms["PSM1"]
    assert list(table.columns[:6]) == ["time_s", "step", "x_m", "y_m", "z_m", "qx"]
    np.testing.assert_allclose(table[["x_m", "y_m", "z_m"]], points.position, atol=1e-9)
    np.testing.assert_allclose(table[["qx", "qy", "qz", "qw"]], points.quaternion, atol=1e-9)
    joints = ["yaw_rad", "pitch_rad", "insertion_m", "roll_rad", "wrist_pitch_rad", "wrist_yaw_rad"]
    np.testing.assert_allclose(table[joints], points.joints, atol=1e-9)
    np.testing.assert_allclose(table.jaw_rad, points.jaw, atol=1e-9)
    np.testing.assert_allclose(table.time_s.diff()[1:], 0.1)
    assert table.step.iloc[[0, -1]].tolist() == [0, 49]


def test_what_is_loaded_is_what_was_exported(exported, episode):
    found = read_npz(exported / "trajectory.npz")
    facts = (found.task, found.seed, found.source, found.success, found.rate, found.frame)
    assert facts == ("NeedlePick", 3, "expert", True, 10.0, "local")
    np.testing.assert_allclose(found.arms["PSM1"].joints[found.knots], episode.joints[:, 0], atol=1e-9)


def test_the_npz_can_be_read_without_this_package(exported):
    with np.load(exported / "trajectory.npz", allow_pickle=False) as file:
        assert file["arms"].tolist() == ["PSM1"]
        assert {f"PSM1_{field.name}" for field in fields(SetPoints)} <= set(file)
        assert len(file["time"]) == len(file["step"]) == len(file["PSM1_position"])


def test_another_file_is_no_trajectory(tmp_path):
    np.savez(tmp_path / "other.npz", numbers=1)
    with pytest.raises(ValueError, match=r"other.npz is no trajectory"):
        read_npz(tmp_path / "other.npz")


def test_the_outcome_is_printed(printed_and_exported):
    printed, folder = printed_and_exported
    assert "NeedlePick, seed 3, expert:" in printed and "No limit is broken." in printed
    assert str(folder) in printed


def test_a_broken_limit_is_refused_and_reported_and_written_for_those_who_insist(tmp_path, capsys):
    folder = tmp_path / "regrasp"
    with pytest.raises(SystemExit) as end:
        cli.main([*REGRASP, "--out", str(folder)])
    assert "PSM1, step " in end.value.code and "wrist_pitch = 1.2" in end.value.code
    assert "--allow_unsafe" in end.value.code and "\n" not in end.value.code
    assert {path.name for path in folder.iterdir()} == {"safety.txt", "safety.json", "safety.png"}
    assert "wrist_pitch" in (folder / "safety.txt").read_text()
    cli.main([*REGRASP, "--out", str(folder), "--allow_unsafe"])
    assert "Limits are broken:" in capsys.readouterr().out
    assert list(read_npz(folder / "trajectory.npz").arms) == ["PSM1", "PSM2"]
    assert (folder / "PSM2.csv").exists() and not (folder / "bag").exists()


def test_a_policy_acts_by_its_name(tmp_path):
    command = ["export-dvrk", "--policy", "generalist", "--task", "NeedleReach", "--rate", "5"]
    cli.main([*command, "--out", str(tmp_path / "reach")])
    assert read_npz(tmp_path / "reach/trajectory.npz").source == "generalist"


def test_measured_transforms_are_applied(tmp_path, episode):
    rcm = simulated(episode.mounts).rcm["PSM1"]
    moved = rcm.copy()
    moved[0, 3] += 0.01
    (tmp_path / "base.json").write_text(json.dumps({"frame": "table", "PSM1": moved.tolist()}))
    cli.main([*PICK, "--base-frame", str(tmp_path / "base.json"), "--out", str(tmp_path / "pick")])
    found = read_npz(tmp_path / "pick/trajectory.npz")
    assert found.frame == "table"
    np.testing.assert_allclose(found.arms["PSM1"].rcm, moved)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (["--rate", "2"], "got 2"),
        (["--seed", "-1"], "got -1"),
        (["--task", "NeedleSew"], "NeedleSew"),
        (["--base-frame", "{}/none.json"], "none.json"),
        (["--policy", "{}/none"], "none"),
    ],
    ids=["rate", "seed", "task", "base frame", "policy"],
)
def test_a_bad_argument_ends_with_one_line_and_writes_nothing(tmp_path, changed, told):
    with pytest.raises(SystemExit) as end:
        cli.main([*PICK, "--out", str(tmp_path / "pick"), *(argument.format(tmp_path) for argument in changed)])
    assert told in end.value.code and "\n" not in end.value.code
    assert not list(tmp_path.iterdir())


def test_a_folder_with_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("ten years of work")
    with pytest.raises(SystemExit, match="thesis.txt"):
        cli.main([*PICK, "--out", str(tmp_path)])
    with pytest.raises(SystemExit, match="is a file"):
        cli.main([*PICK, "--out", str(tmp_path / "thesis.txt")])
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_bag_without_rosbags_is_an_error_that_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(SystemExit, match=r"lerobot_policy_gcdt\[dvrk\]"):
        cli.main([*PICK, "--out", str(tmp_path / "pick"), "--bag"])
    assert not list(tmp_path.iterdir())
