"""Pictures of a world: a second PyBullet client that knows looks and no physics."""

from dataclasses import dataclass, replace
from math import asin, atan2, cos, dist, pi, radians, sin

import numpy as np
import pybullet

from surrol_gym import bullet

KINDS = ("rgb", "depth", "segmentation")
"""What a picture can show."""

_NEAR, _FAR = 0.1, 20.0
_STEEPEST = 0.49 * pi  # radians; straight down there is no upper edge


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

    def turned(self, yaw: float = 0.0, pitch: float = 0.0, zoom: float = 1.0) -> "Camera":
        """Returns the camera with its eye moved about its target.

        Args:
            yaw: Turn about the vertical, degrees.
            pitch: How much higher the eye goes, degrees; it stays below the zenith.
            zoom: Its distance from the target, in units of that before.
        """
        x, y, z = (eye - target for eye, target in zip(self.eye, self.target, strict=True))
        distance = dist(self.eye, self.target)
        around = atan2(y, x) + radians(yaw)
        up = min(max(asin(z / distance) + radians(pitch), -_STEEPEST), _STEEPEST)
        there = cos(up) * cos(around), cos(up) * sin(around), sin(up)
        x, y, z = (at + zoom * distance * part for at, part in zip(self.target, there, strict=True))
        return replace(self, eye=(x, y, z))


OVERVIEW = Camera(eye=(7.588, 0.0, 6.400), target=(-0.25, 0.0, 1.875))
"""The whole table with its arms, as SurRoL's far view shows it (docs/scenes.md#what-all-scenes-share)."""


class Stage:
    """Shows what a ``surrol_gym.bullet.World`` holds.

    It is filled when the first picture is wanted, so who never looks never loads a mesh.

    Args:
        world: The world.

    Attributes:
        names: Name of each thing that is shown; pixels of a segmentation are indices into it.
    """

    def __init__(self, world: bullet.World):
        self._client = bullet.connect()
        self._props = [(self._load(prop), prop) for prop in world.props]
        self.names: tuple[str, ...] = tuple(prop.file_name.removesuffix(".urdf") for prop in world.props)

    def close(self) -> None:
        """Disconnects the client."""
        bullet.disconnect(self._client)

    def render(self, camera: Camera, width: int, height: int, kind: str = "rgb") -> np.ndarray:
        """Renders a picture with PyBullet's software renderer.

        Returns:
            Of kind ``"rgb"`` an array of shape (height, width, 3), uint8; of kind ``"depth"`` the distance from the
            camera's plane, shape (height, width), float32, su; of kind ``"segmentation"`` the index into ``names`` of
            what is seen, -1 where nothing is, shape (height, width), int32.
        """
        self._update()
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

    def _update(self) -> None:
        """Moves everything to where it is now."""
        for body, prop in self._props:
            if prop.pose is not None:
                self._client.resetBasePositionAndOrientation(body, *prop.pose())
            if prop.joints is not None:
                for joint, position in enumerate(prop.joints()):
                    self._client.resetJointState(body, joint, position)

    def _load(self, prop: bullet.Prop) -> int:
        return self._client.loadURDF(
            str(bullet.ASSETS / prop.file_name),
            prop.position,
            pybullet.getQuaternionFromEuler((0, 0, prop.yaw)),
            useFixedBase=True,
            globalScaling=bullet.SCALING,
            flags=pybullet.URDF_IGNORE_COLLISION_SHAPES,
        )
