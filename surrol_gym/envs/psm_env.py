"""Base of the tasks with one arm: five numbers per action."""

import numpy as np

from surrol_gym.envs.goal_env import GoalEnv
from surrol_gym.psm.arm import DOWN, JAW_CLOSED, JAW_OPEN, Arm
from surrol_gym.units import to_su

STEP_SIZE = 0.05
"""Motion of a full action along one axis, su."""

_WORKSPACE = np.array([[0.50, 0.60], [-0.05, 0.05], [0.675, 0.745]])  # metres (facts, section 2)
_WORKSPACE_PADDING = np.array([[-0.02, 0.02], [-0.02, 0.02], [0.0, 0.08]])  # su


ROBOT_STATE_NAMES = ("psm1_x", "psm1_y", "psm1_z", "psm1_roll", "psm1_pitch", "psm1_yaw", "psm1_jaw")


class PSMEnv(GoalEnv):
    """A task with one PSM whose tool points straight down.

    An action is ``(dx, dy, dz, d_yaw, gripper)`` in [-1, 1]: the first three move link 5 by up to 0.05 su along the
    world's axes from where it is measured, within the workspace; the fourth turns the tool about the vertical by up to
    ``yaw_step``; a negative gripper closes the jaws, any other opens them to 40 degrees (facts, section 2).
    """

    action_names = ("psm1_dx", "psm1_dy", "psm1_dz", "psm1_dyaw", "psm1_gripper")
    start_position: tuple[float, float, float]
    """Position of link 5 at reset, su."""
    yaw_step = np.deg2rad(30)
    """Turn of a full action, radians; 0 keeps the tool's orientation."""
    has_gripper = True
    """Whether the action moves the jaws; otherwise they stay closed."""

    def _build_scene(self):
        self.arm = Arm(self.world, base_position=(0.05, 0.24, 0.8524), base_yaw=np.deg2rad(-110))
        self.grasps = []
        self._low, self._high = (
            to_su(_WORKSPACE + [[0.0], [0.0], [0.0102]]) + _WORKSPACE_PADDING
        ).T  # the workspace is one of the tips

    def _pose_scene(self):
        for grasp in self.grasps:
            grasp.reset()
        self.arm.reset(self.start_position, DOWN)

    def _apply_action(self, action):
        position, euler = self.arm.pose()
        wanted = position + STEP_SIZE * action[:3]
        target = np.clip(wanted, self._low, self._high)
        yaw = euler[2] + self.yaw_step * action[3]
        self.arm.move_to(target, (DOWN[0], DOWN[1], yaw))
        closing = action[4] < 0 or not self.has_gripper
        for grasp in self.grasps:
            grasp.before_step(closing)
        self.arm.command_jaws(JAW_CLOSED if closing else JAW_OPEN)
        return bool(np.any(wanted != target))

    def _after_sub_steps(self):
        for grasp in self.grasps:
            grasp.after_step()

    def _contact_force(self):
        return self.arm.contact_force()

    def _robot_state(self):
        """The first seven numbers of every observation: pose of link 5 and the opening angle of the jaws."""
        return np.concatenate([*self.arm.pose(), [self.arm.jaw_angle()]])

    def _get_task_state(self):
        return super()._get_task_state() | {"grasps": [grasp.get_state() for grasp in self.grasps]}

    def _set_task_state(self, state):
        super()._set_task_state(state)
        for grasp, grasp_state in zip(self.grasps, state["grasps"], strict=True):
            grasp.set_state(grasp_state)
