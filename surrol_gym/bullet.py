"""One PyBullet world per object: bodies, contacts, pictures and snapshots. No module-level state."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient

from surrol_gym.units import SCALING

ASSETS = Path(__file__).parent / "assets"
TIME_STEP = 1 / 240
"""Duration of one sub-step, seconds (facts, section 1.6)."""


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

    def matrices(self, aspect):
        """Returns the view and projection matrices for a picture of this aspect ratio (width / height)."""
        view = pybullet.computeViewMatrix(self.eye, self.target, (0, 0, 1))
        return view, pybullet.computeProjectionMatrixFOV(self.field_of_view, aspect, 0.1, 20.0)


class World:
    """A PyBullet client with the engine parameters of SurRoL (facts, section 1.6).

    Args:
        gui: Opens PyBullet's window instead of simulating headlessly.

    Raises:
        RuntimeError: The window cannot be opened (usually: no display).
    """

    def __init__(self, gui=False):
        try:
            self.client = BulletClient(pybullet.GUI if gui else pybullet.DIRECT)
        except pybullet.error as error:
            raise RuntimeError(
                "PyBullet could not open a window; on a machine without a display use render_mode='rgb_array'."
            ) from error
        self._moving = []
        self.client.setGravity(0, 0, -9.81)
        self.client.setPhysicsEngineParameter(
            fixedTimeStep=TIME_STEP, numSolverIterations=50, deterministicOverlappingPairs=1
        )

    def close(self):
        """Disconnects the client; closing twice is harmless."""
        with suppress(pybullet.error):
            self.client.disconnect()

    def load(self, file_name, position=(0, 0, 0), yaw=0.0, fixed=True):
        """Loads a URDF of ``surrol_gym/assets`` (written in metres) at five times its size.

        Args:
            file_name: Name of the file.
            position: Position of the base link, su, world frame.
            yaw: Rotation of the base link about z, radians.
            fixed: Whether the base is immovable.

        Returns:
            The body's id.
        """
        return self.client.loadURDF(
            str(ASSETS / file_name),
            position,
            pybullet.getQuaternionFromEuler((0, 0, yaw)),
            useFixedBase=fixed,
            globalScaling=SCALING,
        )

    def marker(self, radius, color):
        """Creates a sphere that is only seen: no collision, no mass. Returns the body's id."""
        shape = self.client.createVisualShape(pybullet.GEOM_SPHERE, radius=radius, rgbaColor=color)
        body = self.client.createMultiBody(baseMass=0, baseVisualShapeIndex=shape)
        self._moving.append((body, ()))
        return body

    def place(self, body, position, orientation=(0, 0, 0, 1)):
        """Moves a body's centre-of-mass frame to a pose and stops it."""
        self.client.resetBasePositionAndOrientation(body, position, orientation)
        self.client.resetBaseVelocity(body, (0, 0, 0), (0, 0, 0))

    def pose(self, body):
        """Returns position (3,), su, and quaternion (x, y, z, w) of a body's centre-of-mass frame, world frame."""
        position, orientation = self.client.getBasePositionAndOrientation(body)
        return np.array(position), np.array(orientation)

    def step(self, count):
        """Advances the simulation by a number of sub-steps."""
        step_simulation = self.client.stepSimulation
        for _ in range(count):
            step_simulation()

    def mark_built(self):
        """Declares that all bodies are loaded; call it once, before the first step."""
        for body in map(self.client.getBodyUniqueId, range(self.client.getNumBodies())):
            joints = range(self.client.getNumJoints(body))
            free = self.client.getDynamicsInfo(body, -1)[0] > 0
            if free or joints:
                self._moving.append((body, joints))
            if free:
                # Far apart, no two bodies form a pair, so going back to this moment drops all that pairs remember.
                self.place(body, (0.0, 0.0, 20.0 + 5.0 * body))
        self._as_built = self.client.saveState()

    def get_state(self):
        """Returns pose and velocity of every body and joint that moves, as nested tuples."""
        client = self.client
        return tuple(
            (
                client.getBasePositionAndOrientation(body),
                client.getBaseVelocity(body),
                tuple(joint[:2] for joint in client.getJointStates(body, joints)) if joints else (),
            )
            for body, joints in self._moving
        )

    def set_state(self, state):
        """Restores what ``get_state`` returned and forgets all contacts.

        PyBullet keeps contacts from one sub-step to the next and starts its solver from them, but restores them
        wrongly for bodies of several pieces. Forgetting them makes what follows depend on the state alone.
        """
        client = self.client
        self.restore_built()
        for (body, _), (pose, velocity, joints) in zip(self._moving, state, strict=True):
            client.resetBasePositionAndOrientation(body, *pose)
            client.resetBaseVelocity(body, *velocity)
            for joint, (position, speed) in enumerate(joints):
                client.resetJointState(body, joint, position, speed)

    def restore_built(self):
        """Goes back to the moment of ``mark_built``."""
        self.client.restoreState(self._as_built)
        self.client.performCollisionDetection()  # finds that nothing touches, and so drops all pairs

    def render(self, camera, width, height):
        """Renders a picture with PyBullet's software renderer.

        Returns:
            An array of shape (height, width, 3), uint8.
        """
        view, projection = camera.matrices(width / height)
        _, _, rgba, _, _ = self.client.getCameraImage(
            width,
            height,
            view,
            projection,
            lightDirection=(4, 2, 10),
            shadow=0,
            renderer=pybullet.ER_TINY_RENDERER,
        )
        # A PyBullet built without NumPy returns a flat tuple.
        return np.reshape(np.asarray(rgba, dtype=np.uint8), (height, width, 4))[..., :3]
