"""The grasping rule: friction first, then a fixed constraint while the jaws stay in touch.

See docs/grasping.md#the-rule.
"""

from collections.abc import Callable, Sequence

import pybullet

from surrol_gym.bullet import Vector, World
from surrol_gym.psm.arm import END_EFFECTOR, Arm


class Grasp:
    """Attaches one object to one arm.

    Closing the jaws while both touch the object makes the grasp active. Once the task's requirement holds, the object
    is fixed to link 5. It is released when the jaws open or lose touch.

    Args:
        world: The ``surrol_gym.bullet.World`` of both.
        arm: The ``surrol_gym.psm.arm.Arm``.
        body: Id of the object.
        requirement: Called without arguments; says whether an active grasp may attach the object. None: at once.
        max_force: Largest force of the constraint.
        needs_both_jaws: Whether losing touch with one jaw releases the object; otherwise both have to.
    """

    def __init__(
        self,
        world: World,
        arm: Arm,
        body: int,
        requirement: Callable[[], bool] | None = None,
        max_force: float = 20.0,
        needs_both_jaws: bool = False,
    ):
        self._client = world.client
        self._arm = arm
        self._body = body
        self._requirement = requirement
        self._max_force = max_force
        self._holds = all if needs_both_jaws else any
        self._rivals: tuple[Grasp, ...] = ()
        self._active = False
        self._touched = (False, False)
        self._constraint: int | None = None

    @property
    def attached(self) -> bool:
        """Whether the object is fixed to the arm."""
        return self._constraint is not None

    def before_step(self, closing: bool) -> None:
        """Reacts to the gripper command of an action, before the simulation advances."""
        if not closing:
            self.release()
        elif not self._active:
            self._active = all(self._touched) and not any(rival._active for rival in self._rivals)

    def after_step(self) -> None:
        """Attaches or detaches the object, after the simulation has advanced."""
        self._touched = self._arm.touches(self._body)
        if self.attached and not self._holds(self._touched):
            self.release()
        elif self._active and not self.attached and (self._requirement is None or self._requirement()):
            self.attach()

    def attach(self) -> None:
        """Fixes the object to link 5 as it is."""
        self._active = True
        link = self._client.getBasePositionAndOrientation(self._arm.body)
        inverse = pybullet.invertTransform(*link)
        self._fix(*pybullet.multiplyTransforms(*inverse, *self._client.getBasePositionAndOrientation(self._body)))

    def release(self) -> None:
        """Lets go of the object."""
        self._active = False
        if self.attached:
            self._client.removeConstraint(self._constraint)
            self._constraint = None

    def reset(self) -> None:
        """Forgets the episode before."""
        self.release()
        self._touched = (False, False)

    def get_state(self) -> tuple:
        """Returns what ``set_state`` needs: active, which jaws touch, the attached object in the frame of link 5."""
        if not self.attached:
            return self._active, self._touched, None
        info = self._client.getConstraintInfo(self._constraint)
        return self._active, self._touched, (info[6], info[8])

    def set_state(self, state: tuple) -> None:
        """Restores the grasp."""
        self.release()
        self._active, self._touched, frame = state
        if frame is not None:
            self._fix(*frame)

    def _fix(self, position: Vector, orientation: Vector) -> None:
        self._constraint = self._client.createConstraint(
            self._arm.body,
            END_EFFECTOR,
            self._body,
            -1,
            pybullet.JOINT_FIXED,
            (0, 0, 0),
            position,
            (0, 0, 0),
            parentFrameOrientation=orientation,
        )
        self._client.changeConstraint(self._constraint, maxForce=self._max_force)


def exclude_each_other(grasps: Sequence[Grasp]) -> None:
    """Lets only one of several grasps be active at a time: two arms never pull at one object."""
    for grasp in grasps:
        grasp._rivals = tuple(rival for rival in grasps if rival is not grasp)
