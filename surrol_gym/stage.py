"""Pictures of a world: a second PyBullet client that knows looks and no physics."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import asin, atan2, degrees, dist, radians, tan

import numpy as np
import pybullet

from surrol_gym import bullet

KINDS = ("rgb", "depth", "segmentation")
"""What a picture can show."""

_NEAR, _FAR = 0.1, 20.0


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Attributes:
        eye: Position, su, world frame.
        target: The point in the centre of the picture, su, world frame.
        field_of_view: Vertical opening angle, degrees.
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    field_of_view: float = 45.0

    def matrices(self, aspect: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Returns the view and projection matrices for a picture of this aspect ratio (width / height)."""
        view = pybullet.computeViewMatrix(self.eye, self.target, (0, 0, 1))
        return view, pybullet.computeProjectionMatrixFOV(self.field_of_view, aspect, _NEAR, _FAR)

    def look(self) -> tuple[float, float, float, tuple[float, float, float]]:
        """Returns distance, yaw and pitch, degrees, and target with which PyBullet's window shows the same.

        The window's vertical opening angle is always 90 degrees, so its eye comes nearer, or steps back.
        """
        x, y, z = (eye - target for eye, target in zip(self.eye, self.target, strict=True))
        distance = dist(self.eye, self.target)
        near = distance * tan(radians(self.field_of_view / 2))
        return near, degrees(atan2(x, -y)), -degrees(asin(z / distance)), self.target


OVERVIEW = Camera(eye=(7.588, 0.0, 6.400), target=(-0.25, 0.0, 1.875))
"""The whole table with its arms, as SurRoL's far view shows it (docs/scenes.md#what-all-scenes-share)."""


class Stage:
    """Shows what a ``surrol_gym.bullet.World`` holds.

    It is filled when the first picture is wanted, so who never looks never loads a mesh.

    Args:
        world: The world.
        window: Opens PyBullet's window, which shows what this camera sees until the mouse turns it; None to render in
            software only.

    Attributes:
        names: Name of each thing that is shown; pixels of a segmentation are indices into it.

    Raises:
        RuntimeError: The window cannot be opened (usually: no display).
    """

    def __init__(self, world: bullet.World, window: Camera | None = None):
        self._client = bullet.connect(gui=window is not None)
        self._has_window = window is not None
        if window:
            # Menus hide the scene, keys would switch wires and shadows, and shadows take a software renderer long.
            for flag in (pybullet.COV_ENABLE_GUI, pybullet.COV_ENABLE_KEYBOARD_SHORTCUTS, pybullet.COV_ENABLE_SHADOWS):
                self._client.configureDebugVisualizer(flag, 0)
            self._client.resetDebugVisualizerCamera(*window.look())
        self._props = [(self._load(prop), prop) for prop in world.props]
        self.names: tuple[str, ...] = tuple(prop.file_name.removesuffix(".urdf") for prop in world.props)

    def close(self) -> None:
        """Disconnects the client."""
        bullet.disconnect(self._client)

    def update(self) -> None:
        """Moves everything to where it is now."""
        with self._hidden():
            for body, prop in self._props:
                if prop.pose is not None:
                    self._client.resetBasePositionAndOrientation(body, *prop.pose())
                if prop.joints is not None:
                    for joint, position in enumerate(prop.joints()):
                        self._client.resetJointState(body, joint, position)

    def pressed_keys(self) -> set[int]:
        """Returns the codes of the keys that are down in the window, or were since the last call.

        Raises:
            WindowClosed: The window was closed.
        """
        self._check_window()
        events = self._client.getKeyboardEvents()
        return {key for key, state in events.items() if state & (pybullet.KEY_IS_DOWN | pybullet.KEY_WAS_TRIGGERED)}

    def render(self, camera: Camera, width: int, height: int, kind: str = "rgb") -> np.ndarray:
        """Renders a picture with PyBullet's software renderer.

        Returns:
            Of kind ``"rgb"`` an array of shape (height, width, 3), uint8; of kind ``"depth"`` the distance from the
            camera's plane, shape (height, width), float32, su; of kind ``"segmentation"`` the index into ``names`` of
            what is seen, -1 where nothing is, shape (height, width), int32.
        """
        self.update()
        view, projection = camera.matrices(width / height)
        _, _, rgba, depth, bodies = self._client.getCameraImage(
            width,
            height,
            view,
            projection,
            lightDirection=(4, 2, 10),
            shadow=0,
            renderer=pybullet.ER_TINY_RENDERER,
        )
        # A PyBullet built without NumPy returns flat tuples.
        if kind == "depth":
            buffer = np.reshape(np.asarray(depth, dtype=np.float32), (height, width))
            return _FAR * _NEAR / (_FAR - (_FAR - _NEAR) * buffer)
        if kind == "segmentation":
            return np.reshape(np.asarray(bodies, dtype=np.int32), (height, width))
        return np.reshape(np.asarray(rgba, dtype=np.uint8), (height, width, 4))[..., :3]

    @contextmanager
    def _hidden(self) -> Iterator[None]:
        """Lets the window draw only when all is in place; otherwise every single motion waits for a frame of it."""
        if not self._has_window:
            yield
            return
        self._check_window()
        self._client.configureDebugVisualizer(pybullet.COV_ENABLE_RENDERING, 0)
        try:
            yield
        finally:
            self._client.configureDebugVisualizer(pybullet.COV_ENABLE_RENDERING, 1)

    def _check_window(self) -> None:
        if not self._client.isConnected():
            raise bullet.WindowClosed("The window was closed; make a new environment to go on.")

    def _load(self, prop: bullet.Prop) -> int:
        return self._client.loadURDF(
            str(bullet.ASSETS / prop.file_name),
            prop.position,
            pybullet.getQuaternionFromEuler((0, 0, prop.yaw)),
            useFixedBase=True,
            globalScaling=bullet.SCALING,
            flags=pybullet.URDF_IGNORE_COLLISION_SHAPES,
        )
