"""One episode of a recording: the expert acts, or a policy that it corrects, and arms are pushed now and then."""

import gymnasium as gym
import numpy as np

import surrol_gym
from lerobot_gcdt.recording.features import NO_EXTRAS, Extras
from lerobot_gcdt.recording.learners import Learner
from surrol_gym.envs.psm_env import Mount, unwrapped

PUSH_RATE = 0.2
"""Probability of a push in a step of a disturbed episode (examples/paper_table/notes.md#how-often-to-push)."""

PUSHES = 1
"""Tells the random stream of an episode's pushes from that of its start, which the seed alone makes."""


def run_episode(
    env: gym.Env, seed: int, disturb: float = 0.0, extras: Extras = NO_EXTRAS, learner: Learner | None = None
) -> dict[str, np.ndarray]:
    """Runs the expert, or a policy that it corrects, for one episode, to the time limit.

    Demonstrations that never err do not show how to correct, and a policy cloned from them soon stops correcting.
    Disturbed ones do: now and then an arm is pushed sideways, backwards or turned for a step. Never is it pushed ahead,
    where the jaws point, and the jaws obey.
    The recorded action is always the expert's own; ``env.step(action + disturbance)`` replays the episode exactly.
    Where a policy acts, the disturbance is what its action, and a push, differ from the expert's by.

    Args:
        env: The environment; through ``surrol_gym.wrappers.ImperfectSensors`` the expert sees the truth.
        seed: Seed of the reset, of the pushes and of whose turn it is.
        disturb: Largest push, in units of an action.
        extras: What to observe beside the environment's own observation.
        learner: A policy that acts in the expert's place; None where the expert always acts.

    Returns:
        Arrays over the steps: ``observation``, ``achieved_goal``, ``desired_goal`` and the extras before the step,
        ``action`` and ``disturbance``, and ``reward`` and ``success`` after it.
    """
    expert = surrol_gym.make_expert(env)
    rng = np.random.default_rng([seed, PUSHES])
    observation, info = env.reset(seed=seed)
    choose = learner.begin(env, seed) if learner else None
    frames, truncated = [], False
    while not truncated:
        action = expert.act(info.get("true_observation", observation))
        chosen = choose(observation, action) if choose else action
        push = disturb * _push(rng, unwrapped(env).mounts)
        disturbance = (chosen - action) + push + 0.0  # turns -0 into 0
        frame = observation | extras.observe(env) | {"action": action, "disturbance": disturbance}
        observation, reward, _, truncated, info = env.step(action + disturbance)
        frames.append(frame | {"reward": np.float32(reward), "success": info["is_success"]})
    return {key: np.stack([frame[key] for frame in frames]) for key in frames[0]}


def _push(rng: np.random.Generator, mounts: tuple[Mount, ...]) -> np.ndarray:
    """Draws pushes in the direction of each arm's first four numbers; most of the time they are zero."""
    push = np.zeros(5 * len(mounts), np.float32)
    for arm, mount in enumerate(mounts):
        numbers = slice(5 * arm, 5 * arm + 4)
        if rng.random() < PUSH_RATE:
            push[numbers] = rng.uniform(-1, 1, 4)
            motion, ahead = push[numbers][:3], mount.tool_direction()
            motion -= 2 * max(motion @ ahead, 0) * ahead
    return push
