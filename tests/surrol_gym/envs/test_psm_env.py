"""What an action does, in the tasks with one arm that points straight down (section 2 of the facts)."""

import numpy as np
import pytest

SINGLE_ARM = ("NeedleReach", "NeedlePick")
START_HEIGHT = {"NeedleReach": 3.776, "NeedlePick": 3.601}  # section 1.7
# Section 2: where link 5 may be.
LOW, HIGH = np.array((2.48, -0.27, 3.426)), np.array((3.02, 0.27, 3.856))
CLOSED = np.array((0, 0, 0, 0, -1), dtype=np.float32)


@pytest.fixture
def psm_env(env):
    """An environment with one such arm, at the start of an episode."""
    if env.unwrapped.task not in SINGLE_ARM:
        pytest.skip("another arm or another orientation")
    env.reset(seed=0)
    return env


def motion(x=0.0, y=0.0, z=0.0, turn=0.0, gripper=-1.0):
    return np.array((x, y, z, turn, gripper), dtype=np.float32)


def link5(env):
    """Position of link 5, as float64."""
    return env.unwrapped.arm.pose()[0]


def test_an_episode_starts_with_the_tool_down_and_the_jaws_closed(psm_env):
    observation = psm_env.reset(seed=1)[0]["observation"]
    np.testing.assert_allclose(observation[:3], (2.5, 0.25, START_HEIGHT[psm_env.unwrapped.task]), atol=1e-5)
    np.testing.assert_allclose(observation[3:6], (-np.pi / 2, 0, np.pi / 2), atol=1e-3)
    assert observation[6] == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("size", [1.0, 0.4, -0.1, -1.0])
@pytest.mark.parametrize("axis", range(3))
def test_an_action_moves_link_5_by_its_share_of_0_05_su(psm_env, axis, size):
    """Section 9: 0.9936 x 0.05 x size."""
    for _ in range(2):  # away from the edge of the workspace
        psm_env.step(motion(x=1, y=-1))
    psm_env.step(CLOSED)
    before = link5(psm_env)
    action = CLOSED.copy()
    action[axis] = size
    psm_env.step(action)
    moved = link5(psm_env) - before
    assert moved[axis] == pytest.approx(0.9936 * 0.05 * size, rel=1e-3)
    np.testing.assert_allclose(np.delete(moved, axis), 0, atol=5e-5)


def test_an_action_starts_from_the_measured_position_not_from_the_last_target(psm_env):
    start = link5(psm_env)
    for _ in range(5):
        psm_env.step(motion(x=1))
    # Each step leaves out 0.64 % of its command; targets that added up would leave it out only once.
    assert link5(psm_env)[0] - start[0] == pytest.approx(5 * 0.9936 * 0.05, rel=1e-3)


def test_an_action_of_zero_keeps_the_pose(psm_env):
    psm_env.step(motion(x=0.5, y=-0.5))
    psm_env.step(CLOSED)
    before = link5(psm_env)
    for _ in range(5):
        psm_env.step(CLOSED)
    np.testing.assert_allclose(link5(psm_env), before, rtol=0, atol=2e-4)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("direction", [-1, 1])
def test_the_workspace_stops_link_5_and_info_says_so(psm_env, axis, direction):
    for _ in range(4):
        psm_env.step(motion(x=1, y=-1))  # off the walls of the tray
    action = CLOSED.copy()
    action[axis] = direction
    clipped = []
    for _ in range(14):
        clipped.append(psm_env.step(action)[4]["workspace_clipped"])
        # Where the jaws are pressed onto the pad, the joints give way a little.
        give = 2e-3 if (axis, direction) == (2, -1) else 1e-4
        assert np.all(link5(psm_env) > LOW - give)
        assert np.all(link5(psm_env) < HIGH + give)
    assert not clipped[0]
    assert clipped[-1]
    if (axis, direction) != (2, -1):
        assert link5(psm_env)[axis] == pytest.approx((LOW, HIGH)[direction > 0][axis], abs=1e-4)


def test_clipping_lasts_only_as_long_as_the_action_points_outward(psm_env):
    for _ in range(10):
        info = psm_env.step(motion(y=1))[4]
    assert info["workspace_clipped"]
    assert not psm_env.step(motion(y=-0.5))[4]["workspace_clipped"]
    psm_env.step(motion(y=1))
    assert not psm_env.reset(seed=0)[1]["workspace_clipped"]


def test_clipping_one_axis_leaves_the_others_free(psm_env):
    for _ in range(3):
        psm_env.step(motion(y=1))
    before = link5(psm_env)
    psm_env.step(motion(x=1, y=1))
    assert link5(psm_env)[0] - before[0] == pytest.approx(0.9936 * 0.05, rel=1e-3)


def test_a_free_arm_feels_no_force_and_one_pressed_onto_the_pad_does(psm_env):
    assert psm_env.step(motion(z=0.5))[4]["contact_force"] == 0
    for _ in range(3):
        psm_env.step(motion(x=1, y=-1))
    for _ in range(12):
        info = psm_env.step(motion(z=-1))[4]
    assert info["contact_force"] > 1
