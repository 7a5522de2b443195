import numpy as np
import pybullet
import pytest

from surrol_gym.bullet import Camera, World

CAMERA = Camera(eye=(2.0, 0.0, 1.0), target=(0.0, 0.0, 1.0))
RED, BLUE = (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)


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
    """Section 1.6 of the facts."""
    parameters = world.client.getPhysicsEngineParameters()
    assert parameters["fixedTimeStep"] == pytest.approx(1 / 240)
    assert parameters["numSolverIterations"] == 50
    assert parameters["numSubSteps"] in (0, 1)
    gravity = [parameters[f"gravityAcceleration{axis}"] for axis in "XYZ"]
    assert gravity == [0, 0, pytest.approx(-9.81)]


def test_descriptions_in_metres_are_loaded_five_times_as_large(world):
    needle = world.load("needle.urdf", fixed=False)
    low, high = np.array(world.client.getAABB(needle))
    # Section 4.0: a half circle of radius 20 mm.
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


def test_a_marker_is_only_seen(falling):
    world, needle = falling
    marker = world.marker(radius=0.2, color=RED)
    world.place(marker, world.pose(needle)[0])
    world.step(1)
    assert not world.client.getContactPoints(needle, marker)
    assert world.client.getDynamicsInfo(marker, -1)[0] == 0
    assert world.pose(marker)[0][2] == pytest.approx(0.02)


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


def test_a_missing_description_is_an_error_that_names_it(world, capfd):
    with pytest.raises(pybullet.error, match=r"no_such_thing\.urdf|Cannot load URDF"):
        world.load("no_such_thing.urdf")


# ------------------------------------------------------------------------------------------------------------- pictures


def red_pixels(picture):
    rows, columns = np.nonzero((picture[..., 0] > 100) & (picture[..., 1] < 60) & (picture[..., 2] < 60))
    return rows, columns


@pytest.mark.parametrize(("width", "height"), [(64, 64), (80, 40), (30, 90)])
def test_a_picture_has_the_asked_size_and_the_target_in_its_middle(world, width, height):
    marker = world.marker(radius=0.1, color=RED)
    world.place(marker, CAMERA.target)
    picture = world.render(CAMERA, width, height)
    assert (picture.shape, picture.dtype) == ((height, width, 3), np.uint8)
    rows, columns = red_pixels(picture)
    assert rows.mean() == pytest.approx((height - 1) / 2, abs=1.5)
    assert columns.mean() == pytest.approx((width - 1) / 2, abs=1.5)


def test_up_is_up_and_plus_y_is_to_the_right_of_a_camera_that_looks_along_minus_x(world):
    """Section 4 of the facts."""
    marker = world.marker(radius=0.1, color=RED)
    world.place(marker, (0.0, 0.4, 1.3))
    rows, columns = red_pixels(world.render(CAMERA, 64, 64))
    assert rows.mean() < 28
    assert columns.mean() > 36


def test_the_field_of_view_is_the_vertical_angle(world):
    marker = world.marker(radius=0.05, color=RED)
    world.place(marker, (0.0, 0.0, 1.0 + 2 * np.tan(np.deg2rad(15))))  # 15 degrees above the middle
    camera = Camera(CAMERA.eye, CAMERA.target, field_of_view=60.0)
    rows, _ = red_pixels(world.render(camera, 200, 100))
    expected = 50 * (1 - np.tan(np.deg2rad(15)) / np.tan(np.deg2rad(30)))
    assert rows.mean() == pytest.approx(expected, abs=2)


def test_what_is_near_hides_what_is_behind(world):
    behind, near = world.marker(0.1, RED), world.marker(0.1, BLUE)
    world.place(behind, (0.0, 0.0, 1.0))
    world.place(near, (0.5, 0.0, 1.0))
    assert len(red_pixels(world.render(CAMERA, 64, 64))[0]) == 0
    world.place(near, (0.5, 1.0, 1.0))
    assert len(red_pixels(world.render(CAMERA, 64, 64))[0]) > 0
