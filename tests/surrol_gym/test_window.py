"""The window of render mode "human", drawn on SDL's dummy display; tests/surrol_gym/test_play.py uses a real one."""

import gymnasium as gym
import numpy as np
import pytest

from surrol_gym.display import WindowClosed, check_display
from surrol_gym.stage import Camera

pygame = pytest.importorskip("pygame", reason="pygame is not installed (surrol-gym[window])")

from surrol_gym.window import SIZE, Window  # noqa: E402

CAMERA = Camera(eye=(1.0, 0.0, 1.0), target=(0.0, 0.0, 0.0))


class Scene:
    """Draws a picture whose left half is red and whose right half is blue, and notes from where it was looked at."""

    def __init__(self):
        self.cameras = []

    def __call__(self, camera, width, height):
        self.cameras.append(camera)
        picture = np.zeros((height, width, 3), np.uint8)
        picture[:, : width // 2, 0] = picture[:, width // 2 :, 2] = 200
        return picture


@pytest.fixture
def scene(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    return Scene()


@pytest.fixture
def window(scene):
    window = Window("NeedlePick", CAMERA, scene)
    pygame.event.get()
    yield window
    window.close()


def press(key):
    pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))


def let_go(key):
    pygame.event.post(pygame.event.Event(pygame.KEYUP, key=key))


def drag(right, down):
    pygame.event.post(pygame.event.Event(pygame.MOUSEMOTION, rel=(right, down), buttons=(1, 0, 0)))


def test_the_window_shows_the_picture(window):
    window.show()
    screen = pygame.surfarray.array3d(pygame.display.get_surface())  # by column and row
    assert (screen[: SIZE // 2] == (200, 0, 0)).all() and (screen[SIZE // 2 :] == (0, 0, 200)).all()


@pytest.mark.parametrize("side", [300, 900])
def test_a_window_of_another_size_shows_the_whole_picture_in_its_middle(window, scene, side):
    pygame.display.set_mode((side, side + 100))
    window.show()
    screen = pygame.surfarray.array3d(pygame.display.get_surface())
    assert not screen[:, :50].any() and not screen[:, -50:].any()
    np.testing.assert_allclose(screen[[5, -5], [55, -55]], [(200, 0, 0), (0, 0, 200)], atol=5)


def test_a_key_counts_while_it_is_down(window):
    press(pygame.K_w)
    assert window.pressed_keys() == window.pressed_keys() == {"w"}
    let_go(pygame.K_w)
    assert window.pressed_keys() == set()


def test_a_key_that_was_tapped_between_two_looks_counts_once(window):
    press(pygame.K_w)
    let_go(pygame.K_w)
    window.show()
    assert window.pressed_keys() == {"w"}
    assert window.pressed_keys() == set()


def test_keys_are_named_by_what_they_write(window):
    for key in (pygame.K_1, pygame.K_LSHIFT, pygame.K_RSHIFT, pygame.K_RETURN, pygame.K_KP_ENTER):
        press(key)
    assert window.pressed_keys() == {"1", "shift", "enter"}


def test_the_mouse_turns_the_view_and_the_wheel_brings_it_nearer(window, scene):
    window.show()
    drag(20, 10)
    window.refresh()
    assert scene.cameras[-1] == CAMERA.turned(yaw=-10.0, pitch=5.0)
    pygame.event.post(pygame.event.Event(pygame.MOUSEWHEEL, y=2))
    window.refresh()
    np.testing.assert_allclose(scene.cameras[-1].eye, CAMERA.turned(-10.0, 5.0, 0.81).eye)


def test_nothing_is_rendered_anew_while_nothing_changes(window, scene):
    window.show()
    window.refresh()
    assert len(scene.cameras) == 1


def test_the_events_of_a_gamepad_are_left_to_lerobot(window):
    pygame.event.post(pygame.event.Event(pygame.JOYBUTTONDOWN, button=1))
    window.show()
    assert [event.type for event in pygame.event.get()] == [pygame.JOYBUTTONDOWN]


@pytest.mark.parametrize("event", [{"type": pygame.QUIT}, {"type": pygame.KEYDOWN, "key": pygame.K_ESCAPE}], ids=str)
def test_a_window_that_was_closed_says_so_from_then_on(window, event):
    pygame.event.post(pygame.event.Event(event.pop("type"), event))
    for use in (window.show, window.refresh, window.pressed_keys):
        with pytest.raises(WindowClosed):
            use()


def test_a_process_has_one_window(window, scene):
    with pytest.raises(RuntimeError, match="one window"):
        Window("another", CAMERA, scene)


def test_after_one_window_there_may_be_another(window, scene):
    window.close()
    window.close()
    Window("another", CAMERA, scene).close()


def test_a_window_that_nobody_holds_any_more_makes_room(scene, make):
    """Of two environments of a vector the second is refused, and then the first cannot be closed."""
    with pytest.raises(RuntimeError, match="one window"):
        gym.make_vec("surrol/NeedleReach-v0", 2, render_mode="human")
    make("NeedleReach", render_mode="human")
    with pytest.raises(RuntimeError, match="one window"):
        make("NeedleReach", render_mode="human")


def test_an_environment_is_shown_with_every_reset_and_step(scene, make):
    env = make("NeedleReach", render_mode="human")
    env.reset(seed=0)
    before = pygame.surfarray.array3d(pygame.display.get_surface())
    picture = env.unwrapped.picture("closeup", SIZE, SIZE)
    np.testing.assert_allclose(before.swapaxes(0, 1).astype(int), picture.astype(int), atol=2)
    env.step(env.action_space.high)
    assert (pygame.surfarray.array3d(pygame.display.get_surface()) != before).any()
    assert env.render() is None
    press(pygame.K_q)
    assert env.unwrapped.pressed_keys() == {"q"}
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    with pytest.raises(WindowClosed):
        env.step(env.action_space.high)


def test_a_display_that_does_not_answer_is_a_clear_error(monkeypatch, scene):
    monkeypatch.setenv("SDL_VIDEODRIVER", "no_such_driver")
    with pytest.raises(RuntimeError, match="No window could be opened: no_such_driver"):
        Window("NeedlePick", CAMERA, scene)


@pytest.mark.parametrize("name", ["DISPLAY", "WAYLAND_DISPLAY"])
def test_either_kind_of_display_will_do(monkeypatch, no_display, name):
    monkeypatch.setenv(name, ":0")
    assert check_display() is None
