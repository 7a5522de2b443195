import numpy as np
import pytest

from surrol_gym.bullet import World
from surrol_gym.stage import Camera, Stage

CAMERA = Camera(eye=(0.4, 0.0, 1.0), target=(0.0, 0.0, 1.0))
RADIUS = 0.015
"""Of the sphere that marks a goal, su."""


class Ball:
    """A red sphere that the test moves."""

    def __init__(self, world, position=(0.0, 0.0, 1.0)):
        self.position = position
        world.draw("goal.urdf", pose=lambda: (self.position, (0, 0, 0, 1)))


@pytest.fixture
def world():
    world = World()
    yield world
    world.close()


@pytest.fixture
def render():
    """Renders a world once."""

    def render(world, width=64, height=64, kind="rgb", camera=CAMERA):
        stage = Stage(world)
        picture = stage.render(camera, width, height, kind)
        stage.close()
        return picture

    return render


def red_pixels(picture):
    return np.nonzero((picture[..., 0] > 100) & (picture[..., 1] < 60) & (picture[..., 2] < 60))


@pytest.mark.parametrize(("width", "height"), [(64, 64), (80, 40), (30, 90)])
def test_a_picture_has_the_asked_size_and_the_target_in_its_middle(world, render, width, height):
    Ball(world, CAMERA.target)
    picture = render(world, width, height)
    assert (picture.shape, picture.dtype) == ((height, width, 3), np.uint8)
    rows, columns = red_pixels(picture)
    assert rows.mean() == pytest.approx((height - 1) / 2, abs=1.5)
    assert columns.mean() == pytest.approx((width - 1) / 2, abs=1.5)


def test_up_is_up_and_plus_y_is_to_the_right_of_a_camera_that_looks_along_minus_x(world, render):
    """docs/scenes.md#what-all-scenes-share."""
    Ball(world, (0.0, 0.08, 1.08))
    rows, columns = red_pixels(render(world))
    assert rows.mean() < 24
    assert columns.mean() > 40


def test_the_field_of_view_is_the_vertical_angle(world, render):
    Ball(world, (0.0, 0.0, 1.0 + 0.4 * np.tan(np.deg2rad(15))))  # 15 degrees above the middle
    rows, _ = red_pixels(render(world, 200, 100, camera=Camera(CAMERA.eye, CAMERA.target, field_of_view=60.0)))
    expected = 50 * (1 - np.tan(np.deg2rad(15)) / np.tan(np.deg2rad(30)))
    assert rows.mean() == pytest.approx(expected, abs=2)


def test_depth_is_the_distance_from_the_camera_in_scaled_units(world, render):
    Ball(world)
    depth = render(world, 65, 65, "depth")
    assert (depth.shape, depth.dtype) == ((65, 65), np.float32)
    assert depth[32, 32] == pytest.approx(0.4 - RADIUS, abs=2e-3)
    assert depth[0, 0] == pytest.approx(20.0, rel=1e-3)


def test_a_segmentation_tells_things_apart_by_their_names(world):
    Ball(world)
    world.load("floor.urdf")
    stage = Stage(world)
    pixels = stage.render(CAMERA, 65, 65, "segmentation")
    stage.close()
    assert stage.names == ("goal", "floor")
    assert (pixels.shape, pixels.dtype) == ((65, 65), np.int32)
    assert pixels[32, 32] == 0
    assert pixels[64, 32] == -1 or pixels[64, 32] == 1
    assert set(np.unique(pixels)) <= {-1, 0, 1}


def test_what_is_near_hides_what_is_behind(world):
    Ball(world)
    near = Ball(world, (0.1, 0.0, 1.0))
    stage = Stage(world)
    middle = (32, 32)
    assert stage.render(CAMERA, 65, 65, "segmentation")[middle] == 1
    near.position = (0.1, 0.2, 1.0)
    assert stage.render(CAMERA, 65, 65, "segmentation")[middle] == 0
    stage.close()


def test_a_picture_shows_where_things_are_now(world):
    ball = Ball(world)
    stage = Stage(world)
    before = red_pixels(stage.render(CAMERA, 64, 64))[1].mean()
    ball.position = (0.0, 0.1, 1.0)
    assert red_pixels(stage.render(CAMERA, 64, 64))[1].mean() > before + 5
    stage.close()


def test_a_stage_may_be_closed_twice(world):
    stage = Stage(world)
    stage.close()
    stage.close()


@pytest.mark.parametrize(
    ("turn", "eye"),
    [
        ({"yaw": 90.0}, (0.0, 0.4, 1.0)),
        ({"pitch": 30.0}, (0.4 * np.cos(np.pi / 6), 0.0, 1.2)),
        ({"zoom": 0.5}, (0.2, 0.0, 1.0)),
    ],
    ids=str,
)
def test_a_camera_is_turned_about_its_target(turn, eye):
    turned = CAMERA.turned(**turn)
    np.testing.assert_allclose(turned.eye, eye, atol=1e-12)
    assert (turned.target, turned.field_of_view) == (CAMERA.target, CAMERA.field_of_view)


def test_a_camera_is_not_turned_over_the_zenith():
    eye = CAMERA.turned(pitch=80.0).turned(pitch=80.0).eye
    assert 0 < eye[0] < 0.1 and eye[2] > 1.39
