"""What a task says of its numbers, once: names, tables and reading come from it."""

import inspect

import numpy as np
import pytest

from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state
from surrol_gym.quantities import Quantity, described, euler, names, point, repeated_names


class TouchEnv(PSMEnv):
    """
    ## Action Space

    {actions}

    ## Observation Space

    {observation}
    """

    mounts = (Mount(start_position=(2.5, 0.25, 3.6)),)
    observation_quantities = (
        *robot_state(),
        Quantity("colour", "class"),
        point("thing", "a thing"),
        euler("thing", "its angles"),
    )
    goal_quantities = (point("tip", "the tips", "the thing"),)


def test_the_task_is_named_as_its_class():
    assert TouchEnv.task == "Touch"


def test_names_come_from_the_quantities():
    arm = ("psm1_x", "psm1_y", "psm1_z", "psm1_roll", "psm1_pitch", "psm1_yaw", "psm1_jaw")
    thing = ("thing_x", "thing_y", "thing_z", "thing_roll", "thing_pitch", "thing_yaw")
    assert TouchEnv.observation_names == (*arm, "colour", *thing)
    assert TouchEnv.goal_names == ("goal_tip_x", "goal_tip_y", "goal_tip_z")
    assert TouchEnv.action_names == ("psm1_dx", "psm1_dy", "psm1_dz", "psm1_dyaw", "psm1_gripper")


def test_an_observation_is_read_by_its_names():
    observation = {
        "observation": np.arange(14, dtype=np.float32),
        "achieved_goal": np.array([20, 21, 22], np.float32),
        "desired_goal": np.array([30, 31, 32], np.float32),
    }
    seen = TouchEnv.read(observation)
    assert [getattr(seen, name) for name in TouchEnv.observation_names] == list(range(14))
    np.testing.assert_array_equal(seen.psm1, [0, 1, 2])
    np.testing.assert_array_equal(seen.thing_rpy, [11, 12, 13])
    np.testing.assert_array_equal(seen.tip, [20, 21, 22])
    np.testing.assert_array_equal(seen.goal_tip, [30, 31, 32])
    assert (seen.colour, seen.goal_tip_z) == (7, 32)
    with pytest.raises(AttributeError, match="thign"):
        _ = seen.thign


def test_the_docstring_holds_the_tables():
    told = inspect.getdoc(TouchEnv)
    assert "{" not in told
    assert "| 3 | `psm1_dyaw` | turn of the tool about the vertical | 30 degrees |" in told
    assert "Link 5 stays within x [2.48, 3.02], y [-0.27, 0.27], z [3.426, 3.856]." in told
    assert "| 8, 9, 10 | `thing_x`, `thing_y`, `thing_z` | a thing | su |" in told
    assert "`achieved_goal` (3): the tips. `desired_goal` (3): the thing." in told


def test_a_table_has_a_row_for_each_quantity():
    assert described([point("a", "one"), Quantity("b", "two")], "#", "name", "content", "unit").splitlines() == [
        "| # | name | content | unit |",
        "| --- | --- | --- | --- |",
        "| 0, 1, 2 | `a_x`, `a_y`, `a_z` | one | su |",
        "| 3 | `b` | two | |",
    ]


def test_two_arms_are_told_apart():
    assert names(robot_state(arms=2))[7:9] == ("psm2_x", "psm2_y")
    assert robot_state(arms=2)[3].meaning == "position of link 5 of PSM2"


@pytest.mark.parametrize(
    ("quantities", "named"),
    [
        ((point("thing", "a thing"), point("thing", "another")), "thing, thing_x, thing_y, thing_z"),
        ((point("thing", "a thing"), Quantity("thing", "its class")), "thing"),
    ],
)
def test_two_quantities_of_one_name_are_an_error_that_tells_it(quantities, named):
    with pytest.raises(ValueError, match=f"Double has two quantities called {named};"):
        type("DoubleEnv", (PSMEnv,), {"observation_quantities": quantities})


def test_a_point_and_its_angles_may_have_one_name():
    assert not repeated_names((point("thing", "a thing"), euler("thing", "its angles")))
