"""Imperfect sensors, which show the truth noisy, late or not at all, and arms whose actions are noisy."""

from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

from surrol_gym.quantities import Quantity, names

if TYPE_CHECKING:
    from surrol_gym.envs.goal_env import GoalEnv

SENSORS = 2
"""Tells the random stream of an episode's sensors from that of its start, which the seed alone makes."""

ACTIONS = 4
"""The same of the noise of its actions."""

PERFECT = {"position_std": 0.0, "angle_std": 0.0, "dropout": 0.0, "delay": 0}
"""Arguments of sensors that show the truth."""

IDEAL = PERFECT | {"action_std": 0.0}
"""Arguments of ``imperfect`` that change nothing."""


def complete_sensors(arguments: Mapping[str, Any] | None, perfect: Mapping[str, Any] = PERFECT) -> dict[str, Any]:
    """Checks arguments of ``ImperfectSensors`` and adds those that are left out.

    Args:
        arguments: Some of its arguments, by name; None for perfect sensors.
        perfect: All that there are, with the values that change nothing: ``IDEAL`` for those of ``imperfect``.

    Returns:
        All of them, in the order of ``perfect``.

    Raises:
        ValueError: One is unknown or out of range.
    """
    if unknown := sorted(set(arguments or {}) - set(perfect)):
        raise ValueError(f"Sensors have no {', '.join(unknown)}; choose from {', '.join(perfect)}.")
    sensors = dict(perfect) | dict(arguments or {})
    for name, value in sensors.items():
        if name.endswith("_std") and not (isinstance(value, float | int | np.number) and 0 <= value < np.inf):
            raise ValueError(f"{name} must be a finite number from 0 on, got {value!r}.")
    dropout, delay = sensors["dropout"], sensors["delay"]
    if not (isinstance(dropout, float | int | np.number) and 0 <= dropout <= 1):
        raise ValueError(f"dropout is a probability, in [0, 1]; got {dropout!r}.")
    if not isinstance(delay, int | np.integer) or isinstance(delay, bool) or delay < 0:
        raise ValueError(f"delay must be a whole number of steps from 0 on, got {delay!r}.")
    return sensors


class ImperfectSensors(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Shows the observations of a task as imperfect sensors would see them.

    Positions and angles, those of the jaws among them, get Gaussian noise, new in every step. Every point and every set
    of angles is measured by itself, but what is measured once has one noise: a relative position is the difference of
    two shown ones, and an achieved goal that is observed, too, is the same in both places. Desired goals, wherever they
    stand, and classes are exact. Angles may leave [-pi, pi], so noise makes none jump by a whole turn.

    A reading is a whole observation, pictures with it. One that is missed is replaced by the one before it; the first
    of an episode is never missed. With a delay, the first is shown until later ones arrive. Readings on their way are
    none of an environment's state: after ``set_state`` those from before it are still shown.

    Rewards, ``is_success`` and the episode itself are what they are without the wrapper. ``info`` also holds
    ``true_observation``, without noise, loss and delay, from which the expert acts:
    ``expert.act(info["true_observation"])``.

    Everything random comes from a generator of the wrapper's own, made by ``reset(seed=seed)``: the same seed gives the
    same noise in any process, scaled by the standard deviations. Without a seed the generator goes on.

    Args:
        env: An environment of ``surrol_gym``, wrapped or not.
        position_std: Standard deviation of the noise of each coordinate, su.
        angle_std: Standard deviation of the noise of each angle, radians.
        dropout: Probability that a step's reading is missed, in [0, 1].
        delay: Steps by which what is shown lags.

    Raises:
        TypeError: The environment does not say what its numbers are, or a wrapper around it changed them.
        ValueError: An argument is out of range.
    """

    unwrapped: "GoalEnv"  # imported for the type only: PyBullet is loaded with the environment

    def __init__(
        self,
        env: gym.Env,
        position_std: float = 0.0,
        angle_std: float = 0.0,
        dropout: float = 0.0,
        delay: int = 0,
    ):
        arguments = {"position_std": position_std, "angle_std": angle_std, "dropout": dropout, "delay": delay}
        gym.utils.RecordConstructorArgs.__init__(self, **complete_sensors(arguments))
        gym.Wrapper.__init__(self, env)
        task = self.unwrapped
        if not getattr(task, "observation_quantities", ()):
            raise TypeError(f"{env} does not say what its numbers are; sensors take environments of surrol_gym.")
        self._arrays = {"observation": task.observation_quantities, "achieved_goal": task.goal_quantities}
        shown = getattr(env.observation_space, "spaces", {})
        for array, described in self._arrays.items():
            if array not in shown or shown[array].shape != (len(names(described)),):
                raise TypeError(
                    f"{env} does not show {array} as its task does; put the sensors beneath what changes observations."
                )
        quantities = {quantity.key: quantity for quantity in (*task.goal_quantities, *task.observation_quantities)}
        self._derived = {key: quantity.derived_from for key, quantity in quantities.items() if quantity.derived_from}
        goals, of_unit = set(task.goal_names), {"su": position_std, "rad": angle_std}

        def std_of(quantity: Quantity) -> float:
            return 0.0 if goals.issuperset(quantity.names) else of_unit.get(quantity.unit, 0.0)

        self._std = {
            key: np.full(len(quantity.names), std_of(quantity))
            for key, quantity in quantities.items()
            if not quantity.derived_from
        }
        self._dropout = dropout
        self._rng = np.random.default_rng()
        self._readings: deque[dict[str, Any]] = deque(maxlen=delay + 1)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Starts an episode; see ``gymnasium.Env.reset``. A seed also starts the noise anew."""
        observation, info = self.env.reset(seed=seed, options=options)
        if seed is not None:
            self._rng = np.random.default_rng([seed, SENSORS])
        self._readings.clear()
        self._readings.append(self._measure(observation))
        return self._readings[0], info | {"true_observation": observation}

    def step(self, action: Any) -> tuple[dict[str, Any], Any, bool, bool, dict[str, Any]]:
        """Steps the environment; see ``gymnasium.Env.step``."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        reading, missed = self._measure(observation), self._rng.random() < self._dropout
        self._readings.append(self._readings[-1] if missed else reading)
        return self._readings[0], reward, terminated, truncated, info | {"true_observation": observation}

    def _measure(self, observation: dict[str, Any]) -> dict[str, Any]:
        """Returns an observation with noise. As many numbers are drawn whatever the standard deviations are."""
        noise = {key: std * self._rng.standard_normal(len(std)) for key, std in self._std.items()}
        for key, (first, *second) in self._derived.items():
            noise[key] = noise[first] - noise[second[0]] if second else noise[first]
        return observation | {
            array: np.float32(observation[array] + np.concatenate([noise[quantity.key] for quantity in quantities]))
            for array, quantities in self._arrays.items()
        }


class NoisyActions(gym.ActionWrapper, gym.utils.RecordConstructorArgs):
    """Lets an arm do something else than it is told: every number of an action gets Gaussian noise, new in every step.

    What then lies outside of the action space is clipped. Neither observations nor ``info`` tell what was done.

    The noise comes from a generator of the wrapper's own, as that of ``ImperfectSensors``.

    Args:
        env: An environment of ``surrol_gym``, wrapped or not.
        action_std: Standard deviation of the noise, in units of a full action.

    Raises:
        ValueError: The standard deviation is out of range.
    """

    def __init__(self, env: gym.Env, action_std: float = 0.0):
        complete_sensors({"action_std": action_std}, IDEAL)
        gym.utils.RecordConstructorArgs.__init__(self, action_std=action_std)
        gym.ActionWrapper.__init__(self, env)
        self._std = action_std
        self._rng = np.random.default_rng()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Starts an episode; see ``gymnasium.Env.reset``. A seed also starts the noise anew."""
        if seed is not None:
            self._rng = np.random.default_rng([seed, ACTIONS])
        return self.env.reset(seed=seed, options=options)

    def action(self, action: Any) -> np.ndarray:
        """Adds the noise of this step."""
        told = np.asarray(action, dtype=np.float64)
        if not np.isfinite(told).all():
            return told  # which the environment refuses
        noise = self._std * self._rng.standard_normal(told.shape)
        return np.clip(told + noise, -1, 1).astype(np.float32)


def imperfect(env: gym.Env, sensors: Mapping[str, Any] | None) -> gym.Env:
    """Wraps an environment in ``ImperfectSensors`` and ``NoisyActions``, where they change anything.

    Args:
        env: An environment of ``surrol_gym``, wrapped or not.
        sensors: Some arguments of both, by name; None for none.

    Raises:
        TypeError: The environment does not say what its numbers are, which sensors have to know.
        ValueError: An argument is unknown or out of range.
    """
    completed = complete_sensors(sensors, IDEAL)
    action_std = completed.pop("action_std")
    if action_std:
        env = NoisyActions(env, action_std)
    return env if completed == PERFECT else ImperfectSensors(env, **completed)
