"""The window of render mode ``"human"``, by pygame, as Gymnasium's own tasks have it.

It shows the picture of mode ``"rgb_array"`` and lives in the thread that steps the environment. PyBullet's own window
passes every command through three threads that poll a shared lock and never sleep (``b3Clock::usleep(0)`` does nothing
on Linux): beside other work a step took a second, and once stood still for good.
"""

import gc
import os
import warnings
from collections.abc import Callable

import numpy as np

from surrol_gym.display import WindowClosed
from surrol_gym.stage import Camera

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of setuptools, which pygame 2.6 still asks for its files
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    import pygame

SIZE = 512
"""Width and height of the picture, pixels; a larger window shows it larger."""

_TURN = 0.5  # degrees a pixel
_ZOOM = 0.9  # a notch of the wheel
_NAMES = {"left shift": "shift", "right shift": "shift", "return": "enter"}

# LeRobot's gamepad teleoperator reads these from the same queue.
_JOYSTICK = tuple(range(pygame.JOYAXISMOTION, pygame.JOYDEVICEREMOVED + 1))


class Window:
    """Shows a scene, and hears the keys that are pressed while it is in front.

    Dragging the mouse turns the view about the camera's target, and the wheel brings the eye nearer.

    Args:
        title: What its bar says.
        camera: From where it looks at first.
        draw: Renders the scene as it is: ``draw(camera, width, height)`` returns (height, width, 3), uint8.

    Raises:
        RuntimeError: The display cannot be opened, or shows a window of this process.
    """

    _is_open = False

    def __init__(self, title: str, camera: Camera, draw: Callable[[Camera, int, int], np.ndarray]):
        if _is_shown():
            gc.collect()  # closes the window of an environment that nobody holds any more
        if _is_shown():
            raise RuntimeError("A process has one window; close the environment that shows it first.")
        try:
            pygame.display.init()
            pygame.display.set_mode((SIZE, SIZE), pygame.RESIZABLE)
        except pygame.error as error:
            raise RuntimeError(f"No window could be opened: {error}.") from error
        pygame.display.set_caption(title)
        pygame.key.stop_text_input()  # otherwise input methods take the letters
        self._camera, self._draw = camera, draw
        self._picture = pygame.Surface((SIZE, SIZE))
        self._down: set[str] = set()
        self._pressed: set[str] = set()
        self._is_open = True

    def __del__(self) -> None:
        self.close()

    def show(self) -> None:
        """Draws the scene as it is now.

        Raises:
            WindowClosed: The window was closed.
        """
        self._listen()
        self._render()

    def refresh(self) -> None:
        """Turns the view where the mouse says so; call it now and then while the scene does not change.

        Raises:
            WindowClosed: The window was closed.
        """
        before = self._camera
        if self._listen():
            self._paint()
        if self._camera != before:
            self._render()

    def pressed_keys(self) -> set[str]:
        """Returns the names of the keys that are down, or were since the last call, as in ``surrol_gym.keyboard``.

        Raises:
            WindowClosed: The window was closed.
        """
        self._listen()
        pressed, self._pressed = self._pressed | self._down, set()
        return pressed

    def close(self) -> None:
        """Closes the window; closing twice is harmless."""
        if self._is_open:
            self._is_open = False
            pygame.display.quit()

    def _listen(self) -> bool:
        """Takes note of what was done with keys and mouse; returns whether the window has to be painted anew."""
        exposed = False
        for event in pygame.event.get(exclude=_JOYSTICK) if self._is_open else ():
            if event.type == pygame.QUIT or (event.type == pygame.KEYDOWN and event.key == pygame.K_ESCAPE):
                self.close()
                break
            if event.type == pygame.KEYDOWN:
                self._down.add(_name(event.key))
                self._pressed.add(_name(event.key))
            elif event.type == pygame.KEYUP:
                self._down.discard(_name(event.key))
            elif event.type == pygame.MOUSEMOTION and any(event.buttons):
                right, down = event.rel
                self._camera = self._camera.turned(-_TURN * right, _TURN * down)
            elif event.type == pygame.MOUSEWHEEL:
                self._camera = self._camera.turned(zoom=_ZOOM**event.y)
            exposed |= event.type in (pygame.WINDOWEXPOSED, pygame.WINDOWSIZECHANGED)
        if not self._is_open:
            raise WindowClosed("The window was closed; make a new environment to go on.")
        return exposed

    def _render(self) -> None:
        picture = self._draw(self._camera, SIZE, SIZE)
        self._picture = pygame.image.frombytes(picture.tobytes(), (SIZE, SIZE), "RGB")
        self._paint()

    def _paint(self) -> None:
        screen = pygame.display.get_surface()
        width, height = screen.get_size()
        side = min(width, height)
        screen.fill(0)
        picture = self._picture if side == SIZE else pygame.transform.smoothscale(self._picture, (side, side))
        screen.blit(picture, ((width - side) // 2, (height - side) // 2))
        pygame.display.flip()


def _is_shown() -> bool:
    """Whether this process has a window."""
    return bool(pygame.display.get_init() and pygame.display.get_surface())


def _name(key: int) -> str:
    name = pygame.key.name(key)
    return _NAMES.get(name, name)
