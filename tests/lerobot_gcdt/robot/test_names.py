"""What LeRobot's teleoperators and commands say becomes an action."""

import numpy as np
import pytest

from lerobot_gcdt.robot.names import ActionReader, action_names, arm_names, observation_names
from surrol_gym.registry import env_class

NEEDLE_PICK, TWO_ARMS = env_class("NeedlePick"), env_class("BiPegTransfer")


def deltas(x=0.0, y=0.0, z=0.0, gripper=1.0):
    return {"delta_x": x, "delta_y": y, "delta_z": z, "gripper": gripper}


def test_every_name_ends_as_lerobot_rollout_asks_for():
    for task in (NEEDLE_PICK, TWO_ARMS):
        assert all(name.endswith((".pos", ".vel")) for name in (*observation_names(task), *action_names(task)))


def test_observations_hold_the_goals_behind_the_observation():
    names = observation_names(NEEDLE_PICK)
    assert len(names) == len(set(names)) == 19 + 3 + 3
    assert names[18:22] == ("middle_yaw.pos", *(f"desired_goal.middle_{axis}.pos" for axis in "xyz"))


def test_arms_measure_seven_numbers_each():
    assert arm_names(TWO_ARMS)[7:] == tuple(
        f"psm2_{name}.pos" for name in ("x", "y", "z", "roll", "pitch", "yaw", "jaw")
    )


@pytest.mark.parametrize("task", [NEEDLE_PICK, TWO_ARMS])
def test_actions_are_read_by_the_names_of_the_robot_and_of_the_dataset(task):
    numbers = np.linspace(-1, 1, len(task.action_names), dtype=np.float32)
    reader = ActionReader(task, "-y", 1.0)
    for names in (task.action_names, action_names(task)):
        np.testing.assert_array_equal(reader.read(dict(zip(names, numbers, strict=True))), numbers)


@pytest.mark.parametrize(
    ("away", "ahead", "left"),
    [("-y", deltas(y=-1), deltas(x=1)), ("+x", deltas(x=1), deltas(y=1))],
    ids=["keyboard_ee", "gamepad"],
)
def test_away_and_left_are_as_the_cameras_see_them(away, ahead, left):
    """The cameras look along -x of the world, and -y is on their left."""
    reader = ActionReader(NEEDLE_PICK, away, 1.0)
    np.testing.assert_allclose(reader.read(ahead)[:3], (-1, 0, 0))
    np.testing.assert_allclose(reader.read(left)[:3], (0, -1, 0))
    np.testing.assert_allclose(reader.read(deltas(z=1))[:3], (0, 0, 1))


def test_deltas_are_scaled():
    assert ActionReader(NEEDLE_PICK, "+x", 0.25).read(deltas(z=1))[2] == 0.25


def test_the_gripper_of_deltas_stays_where_it_was_told():
    reader = ActionReader(NEEDLE_PICK, "-y", 1.0)
    said = [1, 2, 1, -1, 0, 1]  # LeRobot's keyboard says -1 when the key that closes was let go
    assert [np.sign(reader.read(deltas(gripper=g))[4]) for g in said] == [-1, 1, 1, 1, -1, -1]


def test_deltas_cannot_move_two_arms():
    with pytest.raises(ValueError, match="psm2_dx.vel"):
        ActionReader(TWO_ARMS, "-y", 1.0).read(deltas())
