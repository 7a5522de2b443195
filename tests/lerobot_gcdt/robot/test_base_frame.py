import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lerobot_gcdt.robot.base_frame import TABLE_ORIGIN, read_placement, simulated
from lerobot_gcdt.robot.set_points import interpolate

ROOT = Path(__file__).parents[3]
TILTED = Rotation.from_euler("xyz", (190, 10, 30), degrees=True).as_matrix()


def pose(rotation, position):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix


@pytest.fixture
def measured(episode):
    """What a user measures of an arm that stands as in the simulator, in the frame of a camera above the table."""
    table = pose(TILTED, (0.02, -0.01, 0.3))
    return {"frame": "camera", "table": table, "PSM1": table @ simulated(episode.mounts).rcm["PSM1"]}


@pytest.fixture
def write(tmp_path):
    def write(measured):
        path = tmp_path / "base.json"
        path.write_text(json.dumps(measured, default=np.ndarray.tolist))
        return path

    return write


def test_the_table_frame_lies_on_the_table_with_the_axes_of_the_world(episode):
    rcm = simulated(episode.mounts).rcm["PSM1"]
    # docs/psm.md#where-the-arms-stand
    np.testing.assert_allclose(rcm[:3, 3] + TABLE_ORIGIN, (0.507066, 0.073641, 0.8524), atol=1e-6)
    np.testing.assert_allclose(Rotation.from_matrix(rcm[:3, :3]).as_euler("xyz", degrees=True), (0, 0, -110), atol=1e-9)
    assert 5 * TABLE_ORIGIN[2] == pytest.approx(3.380)


def test_an_arm_that_was_measured_where_it_stands_in_the_simulator_is_sent_the_same(
    episode, trajectory, measured, write
):
    found = interpolate(episode, read_placement(write(measured), ("PSM1",))).arms["PSM1"]
    np.testing.assert_allclose(found.joints, trajectory.arms["PSM1"].joints, rtol=0, atol=1e-9)


def test_cartesian_set_points_are_given_in_the_measured_frame(episode, trajectory, measured, write):
    found = interpolate(episode, read_placement(write(measured), ("PSM1",)))
    assert found.frame == "camera"
    points, expected = found.arms["PSM1"], trajectory.arms["PSM1"]
    on_table, _ = expected.in_frame(expected.rcm)
    in_camera = on_table @ TILTED.T + (0.02, -0.01, 0.3)
    np.testing.assert_allclose(points.in_frame(points.base)[0], in_camera, rtol=0, atol=1e-9)


def test_a_frame_that_is_the_tables_needs_no_table(episode, trajectory, write):
    path = write({"frame": "table", "PSM1": simulated(episode.mounts).rcm["PSM1"]})
    points = interpolate(episode, read_placement(path, ("PSM1",))).arms["PSM1"]
    np.testing.assert_allclose(points.base, points.rcm)
    np.testing.assert_allclose(points.joints, trajectory.arms["PSM1"].joints, rtol=0, atol=1e-9)


def test_rounding_is_mended(measured, write):
    rounded = measured | {"PSM1": measured["PSM1"].round(4), "table": measured["table"].round(4)}
    rcm = read_placement(write(rounded), ("PSM1",)).rcm["PSM1"]
    np.testing.assert_allclose(rcm[:3, :3] @ rcm[:3, :3].T, np.eye(3), atol=1e-12)


def swapped(matrix):
    return matrix[:, [1, 0, 2, 3]]


def sheared(matrix):
    return matrix @ [[1, 0.1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda m: {"PSM1": m["PSM1"] @ np.diag([5, 5, 5, 1])}, "PSM1 in .* scales by 5"),
        (lambda m: {"PSM1": swapped(m["PSM1"])}, "left-handed"),
        (lambda m: {"table": m["table"] @ np.diag([1, 1, -1, 1])}, "table in .* left-handed"),
        (lambda m: {"PSM1": sheared(m["PSM1"])}, "holds no rotation"),
        (lambda m: {"PSM1": m["PSM1"].T}, "last row .* transposed"),
        (lambda m: {"PSM1": m["PSM1"][:3]}, "4 rows of 4 numbers"),
        (lambda m: {"PSM1": [["a"] * 4] * 4}, "4 rows of 4 numbers"),
        (lambda m: {"PSM1": m["PSM1"] + np.nan}, "4 rows of 4 numbers"),
        (lambda m: {"PSM1": pose(m["PSM1"][:3, :3], 1000 * m["PSM1"][:3, 3])}, "PSM1 is at .* metres"),
        (
            lambda m: {"table": np.eye(4), "PSM1": np.linalg.inv(m["PSM1"]) @ m["table"]},
            "PSM1 is at .* not the other way round",
        ),
        (lambda m: {"psm2": m["PSM1"]}, "psm2; known are frame, table, PSM1, PSM2 and no_go"),
        (lambda m: {"no_go": [[0, 0, 0], [1, 1, 1]]}, "no_go in .* two corners"),
        (lambda m: {"no_go": "all"}, "no_go in .* two corners"),
        (lambda m: {"frame": None}, "name the frame"),
    ],
    ids=[
        *("scaled", "axes swapped", "mirrored", "sheared", "transposed", "three rows", "no numbers", "not finite"),
        *("millimetres", "inverted", "unknown key", "one box without a list", "no box", "no frame"),
    ],
)
def test_what_is_no_pose_is_an_error_that_says_what_it_is(measured, write, change, told):
    with pytest.raises(ValueError, match=told):
        read_placement(write(measured | change(measured)), ("PSM1",))


def test_no_go_boxes_are_given_by_any_two_opposite_corners(episode, measured, write):
    path = write(measured | {"no_go": [[[0.1, 0, 0.2], [0, 0.1, 0]]]})
    found = interpolate(episode, read_placement(path, ("PSM1",)), rate=5)
    np.testing.assert_array_equal(found.no_go, [[[0, 0, 0], [0.1, 0.1, 0.2]]])


def test_the_file_that_the_documentation_shows_is_one(episode, tmp_path):
    [shown] = re.findall(r"```json\n(.*?)```", (ROOT / "docs/dvrk.md").read_text(), re.DOTALL)
    (tmp_path / "base.json").write_text(shown)
    found = read_placement(tmp_path / "base.json", ("PSM1",))
    np.testing.assert_allclose(found.rcm["PSM1"], simulated(episode.mounts).rcm["PSM1"], atol=1e-4)
    assert found.frame == "camera" and len(found.no_go) == 1


def test_a_missing_arm_is_named(measured, write):
    with pytest.raises(ValueError, match="lacks the pose of PSM2"):
        read_placement(write(measured), ("PSM1", "PSM2"))


def test_a_file_that_is_no_json_is_named(tmp_path):
    (tmp_path / "base.yaml").write_text("frame: camera")
    with pytest.raises(ValueError, match=r"base.yaml is no JSON"):
        read_placement(tmp_path / "base.yaml", ("PSM1",))
