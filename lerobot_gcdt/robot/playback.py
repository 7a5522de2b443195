"""Trajectories played back in the simulator, to see that they say what the episode did."""

from collections.abc import Iterator
from dataclasses import dataclass

import gymnasium as gym
import numpy as np
from scipy.spatial.transform import Rotation

import surrol_gym
from lerobot_gcdt.robot.set_points import Trajectory
from surrol_gym.envs.psm_env import STEP_SIZE, YAW, Mount, unwrapped
from surrol_gym.psm import kinematics
from surrol_gym.psm.arm import JAW_OPEN, euler_to_matrix
from surrol_gym.units import to_metres, to_su


@dataclass(frozen=True)
class Played:
    """What came of a trajectory in the simulator.

    Attributes:
        tips: Where the jaw tips were measured, metres, world frame, (T + 1, A, 3).
        success: Whether the task was solved after each step, (T,).
    """

    tips: np.ndarray
    success: np.ndarray


def play_back(trajectory: Trajectory) -> Played:
    """Sends the joints and jaws of a trajectory to the simulated arms, from the start of the same episode.

    Each control step sends the set-point at its end, however long the step takes in the trajectory.

    Args:
        trajectory: The trajectory, for where the arms stand in the simulator.

    Returns:
        What came of it.
    """
    env = gym.make(surrol_gym.find_task(trajectory.task))
    try:
        observation, _ = env.reset(seed=trajectory.seed)
        task = unwrapped(env)
        tips, success = [[arm.tip() for arm in task.arms]], []
        for joints, jaws in at_knots(trajectory):
            action = action_to(task.mounts, observation["observation"], joints, jaws)
            observation, _, _, _, info = env.step(action)
            tips.append([arm.tip() for arm in task.arms])
            success.append(info["is_success"])
    finally:
        env.close()
    return Played(to_metres(tips), np.array(success))


def at_knots(trajectory: Trajectory) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yields what the arms are sent at the end of each step: joints, (A, 6), and opening angles of the jaws, (A,)."""
    for knot in trajectory.knots[1:]:
        arms = trajectory.arms.values()
        yield np.array([arm.joints[knot] for arm in arms]), np.array([arm.jaw[knot] for arm in arms])


def action_to(mounts: tuple[Mount, ...], observation: np.ndarray, joints: np.ndarray, jaws: np.ndarray) -> np.ndarray:
    """Finds the action that sends the arms to joints (docs/actions.md#what-an-action-does).

    Args:
        mounts: Where the arms stand in the simulator.
        observation: What is observed now, of which the first seven numbers of each arm are looked at.
        joints: Joints of each arm, metres and radians, (A, 6), for a pose that the task's actions can ask for.
        jaws: Opening angles of the jaws, radians, (A,).

    Returns:
        The action, (5 * A,). Where it is beyond [-1, 1], getting there takes more than one step.
    """
    measured: np.ndarray = np.reshape(observation[: 7 * len(mounts)], (-1, 7)).astype(np.float64)
    numbers = []
    for mount, now, target, jaw in zip(mounts, measured, joints, jaws, strict=True):
        rcm = mount.rcm()
        position, rotation = kinematics.forward(target)
        motion = (to_su(rcm[:3, :3] @ position + rcm[:3, 3]) - now[:3]) / STEP_SIZE
        turn = 0.0
        if mount.turn_step:
            axis = (0, 0, 1) if mount.turns == YAW else euler_to_matrix((0, 0, mount.euler[2]))[:, 1]
            from_start = Rotation.from_matrix(rcm[:3, :3] @ rotation @ euler_to_matrix(mount.euler).T)
            angle = mount.euler[mount.turns] + from_start.as_rotvec() @ axis - now[3 + mount.turns]
            turn = ((angle + np.pi) % (2 * np.pi) - np.pi) / mount.turn_step
        numbers += [*motion, turn, 1.0 if jaw > JAW_OPEN / 2 else -1.0]
    return np.array(numbers)
