"""Recording expert demonstrations as LeRobot datasets, resumable at any moment.

Every finished episode is first kept in a file of its own beside the dataset's folder. The dataset is built from these
files when all are there, and takes its name only when it is whole. So an interrupted recording goes on where it was,
and ends with the same dataset as one that was never interrupted.
"""

import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import datasets
import gymnasium as gym
import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from tqdm import tqdm

import surrol_gym
from lerobot_gcdt.surrol_env import ENVIRONMENT_STATE
from lerobot_gcdt.trajectories import ACHIEVED_GOAL, ACTION, GOAL, STATE, TIME_TO_GOAL
from surrol_gym.envs.psm_env import Mount

RECORDING_FILE = "meta/surrol.json"
"""Beside LeRobot's metadata: what it takes to replay any episode, and how the expert did."""

PARTS_NOTE = "recording.json"
"""In the folder of finished episodes: the recording that they belong to."""

PUSH_RATE, PUSH_RATE_SLOW, SLOW_ACTION = 0.05, 0.12, 0.2
"""Probability of a push in a step of a disturbed episode, the same while the expert moves slowly, and what is slow."""


@dataclass(frozen=True)
class Recording:
    """What was asked for; two recordings with equal fields give the same dataset.

    Attributes:
        env_id: The environment.
        episodes: How many successful episodes.
        seed: Seed of the first episode; the following ones count up, failures are left out.
        disturb: Size of the pushes that divert the arm, in units of an action; 0 for none.
        package_version: Version of this package.
    """

    env_id: str
    episodes: int
    seed: int
    disturb: float
    package_version: str


def record(task: str, episodes: int, seed: int, root: str | Path, disturb: float = 0.0) -> Path:
    """Records successful episodes of a task's scripted expert as a LeRobot dataset.

    Args:
        task: Name of the task, one of ``surrol_gym.TASKS``.
        episodes: Number of successful episodes.
        seed: Seed of the first episode.
        root: Folder of the dataset; calling again with the same arguments goes on with an interrupted recording.
        disturb: Size of the pushes that divert the arm, in [0, 1]; see ``run_episode``.

    Returns:
        The folder.

    Raises:
        ValueError: The task is unknown, a number is out of range, or the folder holds something else.
    """
    if task not in surrol_gym.TASKS:
        raise ValueError(f"Unknown task {task!r}; choose one of {', '.join(surrol_gym.TASKS)}.")
    if episodes < 1 or seed < 0:
        raise ValueError(f"A recording needs at least one episode and a seed from 0, got {episodes} and {seed}.")
    if not 0 <= disturb <= 1:
        raise ValueError(f"The size of disturbances must lie in [0, 1], got {disturb}.")
    root = Path(root)
    wanted = Recording(f"surrol/{task}-v0", episodes, seed, float(disturb), version("lerobot_policy_gcdt"))
    parts = root.with_name(root.name + ".recording")
    if root.exists():
        _check_same(wanted, root / RECORDING_FILE, root)
        print(f"{root} is complete already.")
        if (parts / PARTS_NOTE).exists() or (parts.is_dir() and not any(parts.iterdir())):
            _remove_parts(parts)  # what an earlier call, interrupted at its very end, left
    else:
        _prepare_parts(wanted, parts)
        env = gym.make(wanted.env_id)
        try:
            kept = _record_episodes(env, wanted, parts)
            _build_dataset(env, wanted, kept, parts, root)
        finally:
            env.close()
        _remove_parts(parts)
    print(summary(root))
    return root


def summary(root: str | Path) -> str:
    """Describes a recorded dataset: the expert's success rate and its steps to success."""
    facts = json.loads((Path(root) / RECORDING_FILE).read_text())
    steps = np.array(facts["steps_to_success"])
    return (
        f"{facts['env_id']}: {len(steps)} episodes from {facts['attempts']} attempts of the expert "
        f"(success rate {len(steps) / facts['attempts']:.3f}), first success after {steps.mean():.1f} steps "
        f"({steps.min()}-{steps.max()})"
    )


def run_episode(env: gym.Env, seed: int, disturb: float = 0.0) -> dict[str, np.ndarray]:
    """Runs the expert for one episode, to the time limit.

    Demonstrations that never err do not show how to correct, and a policy cloned from them soon stops correcting.
    Disturbed ones do: now and then an arm is pushed sideways, backwards or turned for a step, more often where the
    expert moves slowly because precision matters. Never is it pushed ahead, where the jaws point, and the jaws obey.
    The recorded action is always the expert's own, so a disturbed episode is replayed by this function, not by its
    actions.

    Args:
        env: The environment.
        seed: Seed of the reset and of the pushes.
        disturb: Largest push, in units of an action.

    Returns:
        Arrays over the steps: ``observation``, ``achieved_goal``, ``desired_goal`` before the step, ``action``, and
        ``reward`` and ``success`` after it.
    """
    expert = surrol_gym.make_expert(env)
    rng = np.random.default_rng(seed)
    observation, _ = env.reset(seed=seed)
    frames, truncated = [], False
    while not truncated:
        action = expert.act(observation)
        following, reward, _, truncated, info = env.step(action + disturb * _push(rng, action, env.unwrapped.mounts))
        frames.append(observation | {"action": action, "reward": np.float32(reward), "success": info["is_success"]})
        observation = following
    return {key: np.stack([frame[key] for frame in frames]) for key in frames[0]}


def _push(rng: np.random.Generator, action: np.ndarray, mounts: tuple[Mount, ...]) -> np.ndarray:
    """Draws pushes in the direction of each arm's first four numbers; most of the time they are zero."""
    push = np.zeros_like(action)
    for arm, mount in enumerate(mounts):
        numbers = slice(5 * arm, 5 * arm + 4)
        slow = np.abs(action[numbers]).max() < SLOW_ACTION
        if rng.random() < (PUSH_RATE_SLOW if slow else PUSH_RATE):
            push[numbers] = rng.uniform(-1, 1, 4)
            motion, ahead = push[numbers][:3], mount.tool_direction()
            motion -= 2 * max(motion @ ahead, 0) * ahead
    return push


def time_to_goal(success: np.ndarray) -> np.ndarray:
    """Computes the steps that are left to the first success, 0 once it is reached.

    Args:
        success: Whether each step ended in success, shape (T,); at least one did.

    Returns:
        Shape (T,), float32; step t is before action t, so an action that succeeds at once starts at 1.
    """
    first = int(np.argmax(success)) + 1
    return np.maximum(first - np.arange(len(success)), 0).astype(np.float32)


def _record_episodes(env: gym.Env, wanted: Recording, parts: Path) -> list[Path]:
    """Records attempts until enough succeeded; returns the files of the successful ones, in order of their seeds."""
    kept: list[Path] = []
    with tqdm(total=wanted.episodes, desc=f"Recording {env.unwrapped.task}", unit="episode") as bar:
        attempt = 0
        while len(kept) < wanted.episodes:
            file = parts / f"{wanted.seed + attempt:09d}.npz"
            if not file.exists():
                unfinished = file.with_suffix(".unfinished")
                with unfinished.open("wb") as stream:
                    np.savez(stream, **run_episode(env, wanted.seed + attempt, wanted.disturb))
                os.replace(unfinished, file)
            with np.load(file) as episode:
                if episode["success"].any():
                    kept.append(file)
                    bar.update()
            attempt += 1
            if attempt >= 20 and not kept:
                raise RuntimeError(f"The expert failed in its first {attempt} attempts at {wanted.env_id}.")
    return kept


def _build_dataset(env: gym.Env, wanted: Recording, kept: list[Path], parts: Path, root: Path) -> None:
    """Writes the dataset beside its final place and moves it there in one step."""
    building = parts / "dataset"
    shutil.rmtree(building, ignore_errors=True)
    datasets.disable_progress_bars()
    dataset = LeRobotDataset.create(
        f"local/{root.name}",
        fps=env.metadata["render_fps"],
        features=_features(env),
        root=building,
        robot_type="dvrk_psm",
        use_videos=False,
        video_backend="pyav",
    )
    steps = []
    for file in tqdm(kept, desc="Writing the dataset", unit="episode"):
        with np.load(file) as arrays:
            episode = dict(arrays)
        remaining = time_to_goal(episode["success"])
        steps.append(int(remaining[0]))
        for t in range(len(remaining)):
            dataset.add_frame(
                {
                    STATE: episode["observation"][t],
                    ENVIRONMENT_STATE: episode["desired_goal"][t],
                    GOAL: episode["desired_goal"][t],
                    ACHIEVED_GOAL: episode["achieved_goal"][t],
                    TIME_TO_GOAL: remaining[t : t + 1],
                    ACTION: episode["action"][t],
                    "next.reward": episode["reward"][t : t + 1],
                    "next.success": episode["success"][t : t + 1],
                    "task": env.unwrapped.task_description,
                }
            )
        dataset.save_episode()
    dataset.finalize()
    sort_statistics(building)
    facts = asdict(wanted) | {
        "seeds": [int(file.stem) for file in kept],
        "attempts": int(kept[-1].stem) - wanted.seed + 1,
        "steps_to_success": steps,
    }
    (building / RECORDING_FILE).write_text(json.dumps(facts, indent=2) + "\n")
    root.parent.mkdir(parents=True, exist_ok=True)
    os.replace(building, root)


def _features(env: gym.Env) -> dict[str, dict]:
    """The dataset's features, every number named by the environment."""
    unwrapped = env.unwrapped

    goal = unwrapped.goal_names
    return {
        STATE: vector_feature(unwrapped.observation_names),
        ENVIRONMENT_STATE: vector_feature(goal),
        GOAL: vector_feature(goal),
        ACHIEVED_GOAL: vector_feature(goal),
        TIME_TO_GOAL: vector_feature(["steps"]),
        ACTION: vector_feature(unwrapped.action_names),
        "next.reward": vector_feature(["reward"]),
        "next.success": {"dtype": "bool", "shape": (1,), "names": ["success"]},
    }


def vector_feature(names: Sequence[str]) -> dict:
    """Returns LeRobot's description of a vector of named float32 numbers."""
    return {"dtype": "float32", "shape": (len(names),), "names": list(names)}


def sort_statistics(root: Path) -> None:
    """Brings a dataset's statistics into order: LeRobot writes them in that of a set, which differs by process."""
    stats = root / "meta/stats.json"
    stats.write_text(json.dumps(json.loads(stats.read_text()), indent=4, sort_keys=True) + "\n")


def _prepare_parts(wanted: Recording, parts: Path) -> None:
    """Makes the folder of finished episodes, or checks that it belongs to the same recording."""
    note = parts / PARTS_NOTE
    unfinished = note.with_suffix(".unfinished")
    if note.exists() or any(file != unfinished for file in parts.glob("*")):
        _check_same(wanted, note, parts)
        return
    parts.mkdir(parents=True, exist_ok=True)
    unfinished.write_text(json.dumps(asdict(wanted)))
    os.replace(unfinished, note)


def _remove_parts(parts: Path) -> None:
    """Removes the folder of finished episodes, the note that tells it from any other folder last."""
    for file in parts.iterdir():
        if file.is_dir():
            shutil.rmtree(file)
        elif file.name != PARTS_NOTE:
            file.unlink()
    (parts / PARTS_NOTE).unlink(missing_ok=True)
    parts.rmdir()


def _check_same(wanted: Recording, note: Path, folder: Path) -> None:
    """Raises if the folder is not the one of this recording."""
    if not note.exists():
        raise ValueError(f"{folder} exists and was not written by `gcdt record`; choose another --root.")
    found = json.loads(note.read_text())
    for name, value in asdict(wanted).items():
        if found.get(name) != value:
            raise ValueError(
                f"{folder} holds a recording with {name} = {found.get(name)!r}, not {value!r}; choose another --root "
                "or remove it."
            )
