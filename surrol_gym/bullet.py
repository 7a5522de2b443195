"""One PyBullet world per object: bodies, contacts and snapshots. No module-level state."""

import os
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient

from surrol_gym.units import SCALING

Vector = Sequence[float] | np.ndarray
"""What PyBullet takes for a position, an orientation or the positions of joints."""

ASSETS = Path(__file__).parent / "assets"
TIME_STEP = 1 / 240
"""Duration of one sub-step, seconds (docs/simulator.md#sub-steps)."""

_CORRECTION = 0.1
"""Share of its error that a constraint corrects in a sub-step, as SurRoL's joint motors do (docs/psm.md#motors)."""

_SLEEP, _WAKE_UP = pybullet.ACTIVATION_STATE_SLEEP, pybullet.ACTIVATION_STATE_WAKE_UP

_COLLIDES = 1, -1
"""Collision filters of what moves: group and mask of PyBullet's default."""

_REST_SPEED, _REST_SPIN = 2e-3, 2e-2
"""A body slower than this, su / s and radians / s, is taken to rest."""


@dataclass(frozen=True)
class Prop:
    """Something that pictures show.

    Attributes:
        file_name: URDF in ``surrol_gym/assets``.
        position: Where its base link is at first, su, world frame.
        yaw: Rotation of the base link about z, radians.
        pose: Called for the pose of its centre-of-mass frame, or None if it never moves.
        joints: Called for its joint positions, or None if it has none.
    """

    file_name: str
    position: tuple[float, ...]
    yaw: float
    pose: Callable[[], tuple[Vector, Vector]] | None = None
    joints: Callable[[], Sequence[float]] | None = None


class World:
    """A PyBullet client with the engine parameters of SurRoL (docs/simulator.md#sub-steps).

    Args:
        solver_iterations: Iterations of the contact solver in a sub-step.

    Attributes:
        client: The client.
        props: What a ``surrol_gym.stage.Stage`` shows of this world.
    """

    def __init__(self, solver_iterations: int = 50):
        self.client = connect()
        # PyBullet's usual broadphase takes bodies 0.05 su apart for neighbours, so it wakes them up too early, and when
        # it forgets them depends on all that happened before.
        self.client.resetSimulation(pybullet.RESET_USE_SIMPLE_BROADPHASE)
        self.props: list[Prop] = []
        self._moving: list[tuple[int, range, bool]] = []
        self._fixed: set[int] = set()
        self._parked: set[int] = set()
        self.client.setGravity(0, 0, -9.81)
        self.client.setPhysicsEngineParameter(
            fixedTimeStep=TIME_STEP,
            numSolverIterations=solver_iterations,
            deterministicOverlappingPairs=1,
            erp=_CORRECTION,
        )

    def close(self) -> None:
        """Disconnects the client; closing twice is harmless."""
        disconnect(self.client)

    def load(
        self,
        file_name: str,
        position: Vector = (0, 0, 0),
        yaw: float = 0.0,
        fixed: bool = True,
        sleeps: bool = True,
        drawn: bool = True,
    ) -> int:
        """Loads a URDF of ``surrol_gym/assets`` (written in metres) at five times its size.

        Args:
            file_name: Name of the file.
            position: Position of the base link, su, world frame.
            yaw: Rotation of the base link about z, radians.
            fixed: Whether the base is immovable.
            sleeps: Whether the simulation may skip the body while it rests and nothing that moves touches it.
            drawn: Whether pictures show it.

        Returns:
            The body's id.
        """
        client, path = self.client, ASSETS / file_name
        body = client.loadURDF(
            str(path),
            position,
            pybullet.getQuaternionFromEuler((0, 0, yaw)),
            useFixedBase=fixed,
            # Contacts with a plain rigid body cost less than those with a chain of links, and come out the same.
            useMaximalCoordinates=fixed and "<joint" not in path.read_text(),
            globalScaling=SCALING,
            flags=pybullet.URDF_IGNORE_VISUAL_SHAPES,
        )
        joints = range(client.getNumJoints(body))
        if not fixed or joints:
            self._moving.append((body, joints, sleeps))
        if fixed:
            self._fixed.add(body)
        if sleeps:
            client.changeDynamics(body, -1, activationState=pybullet.ACTIVATION_STATE_ENABLE_SLEEPING)
        if fixed and not joints:
            # Between two bodies that sleep, PyBullet looks for no contacts.
            client.changeDynamics(body, -1, activationState=_SLEEP)
        if drawn:
            self.draw(
                file_name,
                position,
                yaw,
                None if fixed else lambda: client.getBasePositionAndOrientation(body),
                (lambda: [state[0] for state in client.getJointStates(body, joints)]) if joints else None,
            )
        return body

    def draw(
        self,
        file_name: str,
        position: Vector = (0, 0, 0),
        yaw: float = 0.0,
        pose: Callable[[], tuple[Vector, Vector]] | None = None,
        joints: Callable[[], Sequence[float]] | None = None,
    ) -> None:
        """Adds something to the pictures that the simulation knows nothing of; see ``Prop`` for the arguments."""
        self.props.append(Prop(file_name, tuple(position), yaw, pose, joints))

    def place(self, body: int, position: Vector, orientation: Vector = (0, 0, 0, 1)) -> None:
        """Moves a body's centre-of-mass frame to a pose, stops it and wakes it up."""
        self._parked.discard(body)
        self.client.resetBasePositionAndOrientation(body, position, orientation)
        self.client.resetBaseVelocity(body, (0, 0, 0), (0, 0, 0))
        self.client.changeDynamics(body, -1, activationState=_WAKE_UP)

    def lay(self, body: int, position: Vector, orientation: Vector = (0, 0, 0, 1)) -> None:
        """Moves a body's centre-of-mass frame to a pose in which it rests, and lets it sleep there."""
        self.place(body, position, orientation)
        self.client.changeDynamics(body, -1, activationState=_SLEEP)

    def park(self, body: int) -> None:
        """Leaves a body out of an episode: asleep, far from everything."""
        self.lay(body, _far_away(body))
        self._parked.add(body)

    def pose(self, body: int) -> tuple[np.ndarray, np.ndarray]:
        """Returns position (3,), su, and quaternion (x, y, z, w) of a body's centre-of-mass frame, world frame."""
        position, orientation = self.client.getBasePositionAndOrientation(body)
        return np.array(position), np.array(orientation)

    def frame(self, body: int, position: Vector, orientation: Vector = (0, 0, 0, 1)) -> tuple[np.ndarray, np.ndarray]:
        """Returns where a frame fixed to a body is.

        Args:
            body: The body.
            position: Origin of the frame in the body's centre-of-mass frame, su.
            orientation: Its quaternion (x, y, z, w) there.

        Returns:
            Position (3,), su, and fixed-axis x-y-z Euler angles (3,), radians, world frame.
        """
        pose = self.client.getBasePositionAndOrientation(body)
        position, orientation = pybullet.multiplyTransforms(*pose, position, orientation)
        return np.array(position), np.array(pybullet.getEulerFromQuaternion(orientation))

    def step(self, count: int) -> None:
        """Advances the simulation by a number of sub-steps."""
        step_simulation = self.client.stepSimulation
        for _ in range(count):
            step_simulation()

    def mark_built(self) -> None:
        """Declares that all bodies are loaded; call it once, before the first step."""
        for body, _, _ in self._moving:
            if self.client.getDynamicsInfo(body, -1)[0] > 0:
                # Far apart, no two bodies form a pair, so going back to this moment drops all that pairs remember.
                self.place(body, _far_away(body))
        self._as_built = self.client.saveState()

    def get_state(self) -> tuple:
        """Returns pose and velocity of every body and joint that moves, as nested tuples; None for a parked body."""
        client = self.client
        return tuple(
            None
            if body in self._parked
            else (
                client.getBasePositionAndOrientation(body),
                client.getBaseVelocity(body),
                tuple(joint[:2] for joint in client.getJointStates(body, joints)) if joints else (),
            )
            for body, joints, _ in self._moving
        )

    def set_state(self, state: tuple) -> None:
        """Restores what ``get_state`` returned, forgets all contacts and lets what rests sleep.

        PyBullet keeps contacts from one sub-step to the next and starts its solver from them, but restores them
        wrongly for bodies of several pieces. Forgetting them makes what follows depend on the state alone. A sleeping
        body costs nothing until something that moves touches it.
        """
        client = self.client
        moments = {body: moment for (body, _, _), moment in zip(self._moving, state, strict=True)}
        self.restore_built(
            asleep={body for body, moment in moments.items() if moment is None or _rests(*moment[1:])},
            parked={body for body, moment in moments.items() if moment is None},
        )
        for body, moment in moments.items():
            if moment is not None:
                pose, velocity, joints = moment
                client.resetBasePositionAndOrientation(body, *pose)
                client.resetBaseVelocity(body, *velocity)
                for joint, (position, speed) in enumerate(joints):
                    client.resetJointState(body, joint, position, speed)

    def restore_built(self, asleep: Collection[int] = (), parked: Collection[int] = ()) -> None:
        """Goes back to the moment of ``mark_built``, when every body that moves is far from everything.

        Args:
            asleep: The bodies that sleep from now on, parked ones included.
            parked: The bodies that stay parked.
        """
        client = self.client
        client.restoreState(self._as_built)
        parked_before, self._parked = self._parked, set(parked)
        for body, joints, sleeps in self._moving:
            if body in parked_before & self._parked:
                continue
            if sleeps:
                # Waking up first restarts PyBullet's count of how long the body has been at rest.
                client.changeDynamics(body, -1, activationState=_WAKE_UP | _SLEEP if body in asleep else _WAKE_UP)
            # Setting filters to what they are makes PyBullet forget all pairs at once; the order of pairs that are left
            # would change the last digits.
            for link in range(0 if body in self._fixed else -1, len(joints)):
                client.setCollisionFilterGroupMask(body, link, *_COLLIDES)
        # PyBullet takes two sub-steps to put a body to sleep.
        self.step(2)


class _Client(BulletClient):
    """A client that looks up each of PyBullet's functions only once."""

    def __init__(self) -> None:
        # The base class connects with empty options, which makes PyBullet print "argv[0]=" each time.
        self._pid = os.getpid()
        self._client = -1
        self._client = pybullet.connect(pybullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        function = super().__getattr__(name)
        if name != "disconnect":
            setattr(self, name, function)
        return function


def connect() -> BulletClient:
    """Returns a new PyBullet client."""
    return _Client()


def disconnect(client: BulletClient) -> None:
    """Ends a client; ending it twice is harmless."""
    with suppress(pybullet.error):
        client.disconnect()


def _far_away(body: int) -> tuple[float, float, float]:
    return 0.0, 0.0, 20.0 + 5.0 * body


def _rests(velocity: tuple, joints: tuple) -> bool:
    (linear, angular) = velocity
    return (
        max(map(abs, linear)) < _REST_SPEED
        and max(map(abs, angular)) < _REST_SPIN
        and all(abs(speed) < _REST_SPEED for _, speed in joints)
    )
