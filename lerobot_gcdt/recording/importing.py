"""Importing demonstrations that were made elsewhere.

Two layouts of ``.npz`` archives are read. N is the number of episodes and T that of their steps:

* SurRoL's and DEX's: ``acs``, actions of shape (N, T, A), and ``obs``, for each episode T + 1 dictionaries of
  ``observation``, ``achieved_goal`` and ``desired_goal``. Episodes may have different lengths. ``info`` is not used.
* Plain arrays: ``actions`` (N, T, A), ``observations`` (N, T + 1, O), ``desired_goals`` and ``achieved_goals``
  (N, T + 1, G), or the same of a single episode, without N. ``achieved_goals`` may be left out where observations hold
  them, as in all tasks but NeedleReach.

Numbers are those of the task's observations, goals and actions, in their order and in scaled units.
"""

import hashlib
import json
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

import gymnasium as gym
import numpy as np

import surrol_gym
from lerobot_gcdt.locking import alone_in
from lerobot_gcdt.recording.facts import RECORDING_FILE
from lerobot_gcdt.recording.features import NO_EXTRAS, to_columns
from lerobot_gcdt.recording.unpickling import read_archive
from lerobot_gcdt.recording.writing import build_dataset
from surrol_gym.envs.psm_env import STEP_SIZE, PSMEnv, unwrapped

OBSERVED = ("observation", "achieved_goal", "desired_goal")

NOTICEABLE = 0.1
"""Size of an action, in units of a full one, from which the motion that follows is compared with it."""

TOLERANCE = 0.1
"""Share by which the median of these motions may differ from what the task does; its own differ by up to 0.03."""

AGREEMENT = 1e-3
"""Scaled units or radians by which numbers that are the same may differ."""


def import_demonstrations(files: Sequence[str | Path], task: str, root: str | Path) -> Path:
    """Writes the successful episodes of archives as a dataset like those of ``gcdt record``.

    Success and time-to-goal follow from the achieved goals by the task's own test. Nothing is written before all files
    are read and checked.

    Args:
        files: Archives; see the module's docstring.
        task: Name of the task; see ``surrol_gym.find_task``.
        root: Folder of the dataset. An interrupted import leaves none, and is repeated by the same call.

    Returns:
        The folder.

    Raises:
        ValueError: A file is refused or does not fit the task, no episode reaches the goal, or the folder exists and
            holds something else.
        OSError: A file cannot be read or written, or another process imports into the folder.
    """
    paths, root, env_id = [Path(file) for file in files], Path(root), surrol_gym.find_task(task)
    origin = [{"file": file.name, "sha256": hashlib.sha256(file.read_bytes()).hexdigest()} for file in paths]
    if len({note["sha256"] for note in origin}) < len(paths):
        raise ValueError(f"Two of the files have the same content: {', '.join(map(str, paths))}.")
    if root.exists():
        _check_same({"env_id": env_id, "imported_from": origin}, root)
        print(f"{root} is complete already.")
        return root
    env = gym.make(env_id)
    parts = root.with_name(root.name + ".importing")
    try:
        episodes = [episode for file in paths for episode in read_episodes(file, unwrapped(env))]
        reached = [episode for episode in episodes if episode["success"].any()]
        if not reached:
            raise ValueError(f"None of the {len(episodes)} episodes reaches the goal by the test of {task}.")
        facts = {
            "env_id": env_id,
            "episodes": len(reached),
            "seed": None,
            "disturb": 0.0,
            "extras": asdict(NO_EXTRAS),
            "package_version": version("lerobot_policy_gcdt"),
            "imported_from": origin,
            "attempts": len(episodes),
            "frames": sum(len(episode["action"]) for episode in reached),
        }
        with alone_in(parts):
            try:
                build_dataset(env, NO_EXTRAS, map(to_columns, reached), facts, parts / "dataset", root)
            finally:
                shutil.rmtree(parts / "dataset", ignore_errors=True)
    finally:
        env.close()
    left_out = len(episodes) - len(reached)
    print(
        f"{root}: {len(reached)} episodes of {env_id} imported"
        + (f"; {left_out} more never reach the goal by the task's test and are left out." if left_out else ".")
    )
    return root


def read_episodes(file: str | Path, env: PSMEnv) -> list[dict[str, np.ndarray]]:
    """Reads the episodes of an archive.

    Args:
        file: The archive; see the module's docstring.
        env: The task's environment, unwrapped.

    Returns:
        For each episode what ``lerobot_gcdt.recording.episodes.run_episode`` returns.

    Raises:
        ValueError: The file is refused, has another layout, or does not fit the task.
        OSError: The file cannot be opened.
    """
    arrays = read_archive(file)
    if {"acs", "obs"} <= arrays.keys():
        layout = _surrol_episodes
    elif {"actions", "observations", "desired_goals"} <= arrays.keys():
        layout = _plain_episodes
    else:
        raise ValueError(
            f"{file} holds {', '.join(arrays)}, but SurRoL's archives hold acs and obs, and those of plain arrays "
            "actions, observations, desired_goals and achieved_goals."
        )
    try:
        episodes = [
            {key: np.asarray(values, dtype=np.float32) for key, values in episode.items()}
            for episode in layout(arrays, env)
        ]
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise ValueError(f"{file} is not laid out as `gcdt import --help` says: {error}.") from error
    if not episodes:
        raise ValueError(f"{file} holds no episode.")
    for i, episode in enumerate(episodes):
        _check_episode(episode, env, f"{file}, episode {i}")
    _check_motion(episodes, env, file)
    return [_to_steps(episode, env) for episode in episodes]


def _surrol_episodes(arrays: dict[str, np.ndarray], env: PSMEnv) -> Iterator[dict]:
    for actions, moments in _by_episode({"acs": arrays["acs"], "obs": arrays["obs"]}):
        episode = {key: np.array([moment[key] for moment in moments]) for key in OBSERVED}
        if env.task == "MatchBoard":
            # SurRoL's expert adds a turn to yaws just above -pi, in the observation that is then recorded.
            yaw = episode["observation"][:, env.observation_names.index("mark_yaw")]
            yaw[(yaw > np.pi) & (yaw <= np.pi + 0.1)] -= 2 * np.pi
        yield {"action": actions} | episode


def _plain_episodes(arrays: dict[str, np.ndarray], env: PSMEnv) -> Iterator[dict]:
    names = ("actions", "observations", "achieved_goals", "desired_goals")
    if "achieved_goals" not in arrays:
        if not (places := _achieved_places(env)):
            raise ValueError(f"it needs achieved_goals, since observations of {env.task} do not hold them")
        arrays = arrays | {"achieved_goals": arrays["observations"][..., places]}
    single = arrays["actions"].ndim == 2
    for episode in _by_episode({name: arrays[name][None] if single else arrays[name] for name in names}):
        yield dict(zip(("action", *OBSERVED), episode, strict=True))


def _by_episode(columns: dict[str, np.ndarray]) -> Iterator[tuple]:
    numbers = {name: len(values) for name, values in columns.items()}
    if len(set(numbers.values())) > 1:
        raise ValueError("numbers of episodes differ: " + ", ".join(f"{n} of {name}" for name, n in numbers.items()))
    return zip(*columns.values(), strict=True)


def _check_episode(episode: dict[str, np.ndarray], env: PSMEnv, where: str) -> None:
    """Raises ValueError unless an episode has the sizes of the task and numbers that it can have."""
    steps, goal = len(episode["action"]), len(env.goal_names)
    shapes = {"action": (steps, len(env.action_names)), "observation": (steps + 1, len(env.observation_names))}
    for key, shape in (shapes | {"achieved_goal": (steps + 1, goal), "desired_goal": (steps + 1, goal)}).items():
        if episode[key].shape != shape or not steps:
            raise ValueError(f"{where}: {key} has the shape {episode[key].shape}; {env.task} needs {shape}.")
        if not np.isfinite(episode[key]).all():
            raise ValueError(f"{where}: {key} holds a number that is not finite.")
    if (largest := np.abs(episode["action"]).max()) > 1:
        raise ValueError(f"{where}: an action holds {largest:g}; they lie in [-1, 1].")
    if (change := np.ptp(episode["desired_goal"], axis=0).max()) > AGREEMENT:
        raise ValueError(f"{where}: desired_goal changes by {change:.3g}, but stays the same within an episode.")
    places = _achieved_places(env)
    if places and (apart := np.abs(episode["observation"][:, places] - episode["achieved_goal"]).max()) > AGREEMENT:
        raise ValueError(f"{where}: achieved_goal differs by {apart:.3g} from the same numbers of observation.")


def _achieved_places(env: PSMEnv) -> list[int]:
    """Where observations hold the achieved goal; empty where they do not."""
    achieved = [name.removeprefix("goal_") for name in env.goal_names]
    names = list(env.observation_names)
    return [names.index(name) for name in achieved] if set(achieved) <= set(names) else []


def _check_motion(episodes: list[dict[str, np.ndarray]], env: PSMEnv, file: str | Path) -> None:
    """Raises ValueError where arms do not move as the actions say, as in files of other units or other versions."""
    for i, name in enumerate(env.action_names):
        moved = name.replace("_d", "_", 1)
        full = env.mounts[i // 5].turn_step if i % 5 == 3 else STEP_SIZE
        if moved not in env.observation_names or full == 0:  # the gripper; a tool that does not turn
            continue
        place = env.observation_names.index(moved)
        action = np.concatenate([episode["action"][:, i] for episode in episodes])
        motion = np.concatenate([np.diff(episode["observation"][:, place]) for episode in episodes])
        if i % 5 == 3:
            motion = (motion + np.pi) % (2 * np.pi) - np.pi
        large = np.abs(action) > NOTICEABLE
        if not large.any():
            if (furthest := np.abs(motion).max()) > (1 + TOLERANCE) * NOTICEABLE * full:
                raise ValueError(
                    f"{file}: {moved} moves by up to {furthest:.3g} in a step, but {name} is at most "
                    f"{np.abs(action).max():.3g}, and {name} = 1 moves it by {full:.3g} in {env.task}. Actions are in "
                    "units of full ones, not in metres."
                )
            continue
        measured = np.median(motion[large] / action[large])
        if abs(measured / full - 1) > TOLERANCE:
            raise ValueError(
                f"{file}: {name} = 1 moves {moved} by {measured:.3g}, but by {full:.3g} in {env.task}. Convert "
                f"positions to scaled units (1 su = 0.2 m), or multiply this number of the actions by "
                f"{measured / full:.3g}."
            )


def _to_steps(episode: dict[str, np.ndarray], env: PSMEnv) -> dict[str, np.ndarray]:
    success = np.asarray(env.is_success(episode["achieved_goal"][1:], episode["desired_goal"][1:]))
    return {key: episode[key][:-1] for key in OBSERVED} | {
        "action": episode["action"],
        "disturbance": np.zeros_like(episode["action"]),
        "reward": success.astype(np.float32) - 1,
        "success": success,
    }


def _check_same(wanted: dict, root: Path) -> None:
    """Raises ValueError unless a folder is the dataset of this import."""
    note = root / RECORDING_FILE
    found = json.loads(note.read_text()) if note.exists() else {}
    if {key: found.get(key) for key in wanted} != wanted:
        raise ValueError(f"{root} exists and was not imported from these files; choose another --root or remove it.")
