import subprocess
import sys

import numpy as np
import pybullet
import pytest

from surrol_gym.bullet import World


@pytest.fixture
def world():
    world = World()
    yield world
    world.close()


@pytest.fixture
def falling(world):
    """A world with a floor and a needle above it."""
    world.load("floor.urdf")
    needle = world.load("needle.urdf", fixed=False)
    world.mark_built()
    world.place(needle, (0.1, 0.2, 0.02), pybullet.getQuaternionFromEuler((0.3, 0.2, 0.1)))
    return world, needle


def test_the_engine_has_the_parameters_of_the_original(world):
    """docs/simulator.md#sub-steps."""
    parameters = world.client.getPhysicsEngineParameters()
    assert parameters["fixedTimeStep"] == pytest.approx(1 / 240)
    assert parameters["numSolverIterations"] == 50
    assert parameters["numSubSteps"] in (0, 1)
    gravity = [parameters[f"gravityAcceleration{axis}"] for axis in "XYZ"]
    assert gravity == [0, 0, pytest.approx(-9.81)]


def test_a_client_prints_nothing():
    # In a process of its own, because what C prints into a pipe appears at its end.
    code = "from surrol_gym.bullet import World; World().close(); World().close()"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert [line for line in printed.splitlines() if "build time" not in line] == []


def test_descriptions_in_metres_are_loaded_five_times_as_large(world):
    needle = world.load("needle.urdf", fixed=False)
    low, high = np.array(world.client.getAABB(needle))
    # docs/objects.md#needle: a half circle of radius 20 mm.
    np.testing.assert_allclose((high - low)[:2], (0.1, 0.2), atol=0.02)


def test_bodies_are_loaded_where_asked(world):
    table = world.load("table.urdf", (1.0, 2.0, 3.0), yaw=0.5)
    position, orientation = world.pose(table)
    np.testing.assert_allclose(position, (1, 2, 3), atol=1e-9)
    assert pybullet.getEulerFromQuaternion(orientation)[2] == pytest.approx(0.5)


def test_fixed_bodies_stay_and_free_ones_fall(world):
    fixed, free = world.load("needle.urdf", (0, 0, 1)), world.load("needle.urdf", (1, 0, 1), fixed=False)
    before = world.pose(fixed)[0][2], world.pose(free)[0][2]
    world.step(24)
    assert world.pose(fixed)[0][2] == before[0]
    # A tenth of a second of free fall.
    assert before[1] - world.pose(free)[0][2] == pytest.approx(9.81 * 0.1**2 / 2, rel=0.05)


def test_placing_a_body_stops_it(falling):
    world, needle = falling
    world.step(10)
    world.place(needle, (0.0, 0.0, 1.0))
    linear, angular = world.client.getBaseVelocity(needle)
    assert (linear, angular) == ((0, 0, 0), (0, 0, 0))
    position, orientation = world.pose(needle)
    np.testing.assert_array_equal(position, (0, 0, 1))
    np.testing.assert_array_equal(orientation, (0, 0, 0, 1))


def test_what_is_only_drawn_is_no_body(falling):
    world, _ = falling
    before = world.client.getNumBodies()
    world.draw("goal.urdf")
    assert world.client.getNumBodies() == before
    assert [prop.file_name for prop in world.props] == ["floor.urdf", "needle.urdf", "goal.urdf"]


def test_a_frame_of_a_body_moves_and_turns_with_it(falling):
    world, needle = falling
    world.place(needle, (1.0, 2.0, 3.0), pybullet.getQuaternionFromEuler((0, 0, np.pi / 2)))
    position, euler = world.frame(needle, (0.1, 0.0, 0.2), pybullet.getQuaternionFromEuler((0, 0, 0.3)))
    np.testing.assert_allclose(position, (1.0, 2.1, 3.2), atol=1e-9)
    np.testing.assert_allclose(euler, (0, 0, np.pi / 2 + 0.3), atol=1e-9)


def trajectory(world, needle, count):
    poses = []
    for _ in range(count):
        world.step(1)
        poses.append(np.concatenate(world.pose(needle)).tobytes())
    return poses


@pytest.mark.parametrize("steps", [0, 5, 15, 60])
def test_a_restored_world_goes_on_the_same_way_every_time(falling, steps):
    world, needle = falling
    world.step(steps)
    state = world.get_state()
    world.set_state(state)
    first = trajectory(world, needle, 40)
    world.step(30)
    world.set_state(state)
    assert trajectory(world, needle, 40) == first


def test_a_restored_world_has_the_state_that_was_saved(falling):
    world, needle = falling
    world.step(8)
    (((position, orientation), velocity, joints),) = state = world.get_state()
    world.step(8)
    world.set_state(state)
    np.testing.assert_array_equal(world.pose(needle)[0], position)
    np.testing.assert_allclose(world.pose(needle)[1], orientation, rtol=0, atol=1e-15)
    assert world.client.getBaseVelocity(needle) == velocity
    assert joints == ()


def test_restoring_the_built_world_forgets_contacts(falling):
    world, needle = falling
    world.step(60)
    assert world.client.getContactPoints(needle)
    world.restore_built()
    assert not world.client.getContactPoints(needle)


def test_a_parked_body_is_far_away_and_stays_there(falling):
    world, needle = falling
    world.park(needle)
    state = world.get_state()
    assert state == (None,)
    parked = world.pose(needle)[0]
    world.set_state(state)
    world.step(48)
    np.testing.assert_allclose(world.pose(needle)[0], parked, rtol=0, atol=1e-3)
    assert parked[2] > 10


def test_restored_worlds_park_and_fetch_bodies_as_the_state_says(falling):
    world, needle = falling
    world.step(8)
    present = world.get_state()
    world.set_state(present)
    expected = trajectory(world, needle, 40)
    world.park(needle)
    absent = world.get_state()
    world.set_state(present)
    assert trajectory(world, needle, 40) == expected
    world.set_state(absent)
    assert world.get_state() == absent
    assert world.pose(needle)[0][2] > 10


def test_two_worlds_do_not_touch(world):
    other = World()
    world.load("needle.urdf", fixed=False)
    assert (world.client.getNumBodies(), other.client.getNumBodies()) == (1, 0)
    other.close()
    assert world.client.isConnected()


def test_closing_twice_is_harmless():
    world = World()
    world.close()
    world.close()
    with pytest.raises(pybullet.error):
        world.step(1)


def test_a_missing_description_is_an_error_that_names_it(world):
    with pytest.raises(FileNotFoundError, match=r"no_such_thing\.urdf"):
        world.load("no_such_thing.urdf")


# -------------------------------------------------------------------------------------------------------------- sleep


def motion(world, needle):
    """Distance that the needle moves in a control step that starts from its present state."""
    world.set_state(world.get_state())
    before = world.pose(needle)[0]
    world.step(48)
    return np.linalg.norm(world.pose(needle)[0] - before)


def test_a_body_at_rest_sleeps_and_stays_exactly_where_it_is(falling):
    world, needle = falling
    world.step(480)
    motion(world, needle)
    assert motion(world, needle) == 0
    assert world.client.getBaseVelocity(needle) == ((0, 0, 0), (0, 0, 0))


def test_a_body_that_moves_is_awake(falling):
    world, needle = falling
    world.step(2)
    assert motion(world, needle) > 0


def test_a_placed_body_is_awake(falling):
    world, needle = falling
    world.step(480)
    motion(world, needle)
    world.place(needle, (0.0, 0.0, 0.3))
    world.step(24)
    assert world.pose(needle)[0][2] < 0.3


def test_a_body_sleeps_on_while_something_passes_close_by(falling):
    world, needle = falling
    world.step(480)
    motion(world, needle)
    gauze = world.load("gauze.urdf", world.pose(needle)[0] + (0, 0, 0.08), fixed=False)
    world.client.resetBaseVelocity(gauze, (0, 0, 1))
    before = world.pose(needle)
    world.step(24)
    assert str(world.pose(needle)) == str(before)


def test_a_sleeping_body_wakes_up_when_something_that_moves_touches_it(falling):
    world, needle = falling
    world.step(480)
    rest = world.pose(needle)[0]
    axis = rest - world.frame(needle, (-0.0365, 0, 0))[0]  # from the middle of the arc inwards
    gauze = world.load("gauze.urdf", rest - 3 * axis + (0, 0, 0.01), fixed=False)
    world.client.resetBaseVelocity(gauze, 40 * axis)
    world.step(96)
    assert np.linalg.norm(world.pose(needle)[0] - rest) > 1e-4
