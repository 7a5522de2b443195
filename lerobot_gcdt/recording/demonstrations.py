"""Recording expert demonstrations as LeRobot datasets, resumable at any moment.

Every finished episode is first kept in a file of its own beside the dataset's folder. The dataset is built from these
files when all are there, and takes its name only when it is whole. So an interrupted recording goes on where it was,
and ends with the same dataset as one that was never interrupted.
"""

import json
import os
import re
import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import datasets
import gymnasium as gym
import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from tqdm import tqdm

import surrol_gym
from lerobot_gcdt.keys import TIME_TO_GOAL
from lerobot_gcdt.locking import LOCK_FILE, alone_in
from lerobot_gcdt.recording.features import NO_EXTRAS, Extras, describe_columns, to_columns
from lerobot_gcdt.recording.learners import Learner
from lerobot_gcdt.recording.persons import Person
from lerobot_gcdt.recording.writing import save_episode
from surrol_gym.by_hand import Stop
from surrol_gym.envs.psm_env import Mount, unwrapped
from surrol_gym.registry import env_class, find_law
from surrol_gym.wrappers import ImperfectSensors, complete_sensors

RECORDING_FILE = "meta/surrol.json"
"""Beside LeRobot's metadata: what it takes to replay any episode, and how the expert did."""

PARTS_NOTE, UNFINISHED_NOTE = "recording.json", "recording.unfinished"
"""In the folder of finished episodes: the recording that they belong to, and its name while it is written."""

PUSH_RATE = 0.2
"""Probability of a push in a step of a disturbed episode (examples/paper_table/notes.md#how-often-to-push)."""

PUSHES = 1
"""Tells the random stream of an episode's pushes from that of its start, which the seed alone makes."""

FAILURES_IN_A_ROW = 50
"""Failed attempts after which a recording ends. Even an expert that succeeds in one of five attempts begins such a
series but once in 70,000; a worse one is broken."""


@dataclass(frozen=True)
class Recording:
    """What was asked for; two recordings with equal fields give the same dataset.

    Attributes:
        env_id: The environment, with the module that registers it where that was named: makes it in any process.
        episodes: How many successful episodes.
        seed: Seed of the first episode; the following ones count up, failures are left out.
        disturb: Size of the pushes that divert the arm, in units of an action; 0 for none.
        extras: What is recorded beside what every dataset holds.
        package_version: Version of this package.
        policy: The policy that acts in the expert's place; None where the expert always acts.
        mix: Probability of the expert's action where the policy acts.
        human: Teleoperator with which a person acted; None where no person did.
        sensors: Arguments of the imperfect sensors that observations are recorded through; None for perfect ones.
        push_rate: Share of the steps that are pushed; None without pushes.
    """

    env_id: str
    episodes: int
    seed: int
    disturb: float
    extras: Extras
    package_version: str
    policy: str | None = None
    mix: float | None = None
    human: str | None = None
    sensors: dict[str, Any] | None = None
    push_rate: float | None = None

    def facts(self) -> dict:
        """Returns what files say of it: a policy and a person only where there is one."""
        return {name: value for name, value in asdict(self).items() if value is not None}


def dataset_name(task: str) -> str:
    """Returns the name of a task's published dataset, such as ``surrol_needle_pick`` of ``NeedlePick``."""
    return "surrol" + re.sub("([A-Z])", r"_\1", task).lower()


def record(
    task: str,
    episodes: int,
    seed: int,
    root: str | Path,
    disturb: float = 0.0,
    extras: Extras = NO_EXTRAS,
    on_episode: Callable[[], None] | None = None,
    learner: Learner | None = None,
    person: Person | None = None,
    sensors: Mapping[str, Any] | None = None,
) -> Path:
    """Records successful episodes of a task as a LeRobot dataset: the expert's, those that it saves, or a person's.

    Args:
        task: Name of the task; see ``surrol_gym.find_task``.
        episodes: Number of successful episodes.
        seed: Seed of the first episode.
        root: Folder of the dataset; calling again with the same arguments goes on with an interrupted recording. The
            number of episodes may then be another one, from that of the finished ones on.
        disturb: Size of the pushes that divert the arm, in [0, 1]; see ``run_episode``.
        extras: What to record beside what every dataset holds.
        on_episode: Called for every episode that is there; nothing is printed then.
        learner: A policy that acts in the expert's place; None where the expert always acts.
        person: Somebody who acts instead of the expert, in a window; their episodes have their own lengths.
        sensors: Arguments of ``surrol_gym.wrappers.ImperfectSensors``, through which observations and achieved goals
            are recorded, while the expert acts by the truth; None for perfect ones.

    Returns:
        The folder.

    Raises:
        ValueError: The task is unknown or has no expert, a number or a sensor is out of range, or the folder holds
            something else.
        OSError: The disk is full, something else keeps files from being written, or another process records there;
            what is finished is kept.
        RuntimeError: The expert fails again and again, or the person stops; what is finished is kept.
    """
    root = Path(root)
    wanted = check_recording(task, episodes, seed, root, disturb, extras, learner, person, sensors)
    parts = _parts_of(root)
    if root.exists():
        if parts.exists() and _are_ours(parts):
            with alone_in(parts):
                _remove_parts(parts)  # what an earlier call, interrupted at its very end, left
        if on_episode:
            for _ in range(episodes):
                on_episode()
        else:
            print(f"{root} is complete already.")
    else:
        with alone_in(parts):
            if root.exists():  # another process has finished it just now
                _check_same(wanted, root / RECORDING_FILE, root)
            else:
                _make(wanted, parts, root, on_episode, learner, person)
            _remove_parts(parts)
    if not on_episode:
        print(summary(root))
    return root


def check_recording(
    task: str,
    episodes: int,
    seed: int,
    root: str | Path,
    disturb: float = 0.0,
    extras: Extras = NO_EXTRAS,
    learner: Learner | None = None,
    person: Person | None = None,
    sensors: Mapping[str, Any] | None = None,
) -> Recording:
    """Checks what is asked of ``record``, and writes nothing.

    Returns:
        The recording that it would make.

    Raises:
        ValueError: As ``record`` does.
    """
    env_id = surrol_gym.find_task(task)
    if episodes < 1 or seed < 0:
        raise ValueError(f"A recording needs at least one episode and a seed from 0, got {episodes} and {seed}.")
    if not 0 <= disturb <= 1:
        raise ValueError(f"The size of disturbances must lie in [0, 1], got {disturb}.")
    if not person and not find_law(env_class(env_id)):
        raise ValueError(f"{env_id} has no scripted expert; register it with one, or act yourself with --teleop.")
    wanted = Recording(env_id, episodes, seed, float(disturb), extras, version("lerobot_policy_gcdt"))
    if disturb:
        wanted = replace(wanted, push_rate=PUSH_RATE)
    if learner:
        wanted = replace(wanted, policy=learner.name, mix=float(learner.mix))
    if person:
        wanted = replace(wanted, human=person.name)
    if sensors:
        wanted = replace(wanted, sensors=complete_sensors(sensors))
    extras.check(wanted.env_id)
    root = Path(root)
    parts = _parts_of(root)
    if root.exists():
        _check_same(wanted, root / RECORDING_FILE, root)
    elif parts.exists() and not _are_ours(parts):
        raise ValueError(f"{parts} exists and was not written by `gcdt record`; choose another --root.")
    return wanted


def _parts_of(root: Path) -> Path:
    """The folder of the finished episodes of an unfinished dataset."""
    return root.with_name(root.name + ".recording")


def summary(root: str | Path) -> str:
    """Describes a recorded dataset: the expert's success rate and its steps to success."""
    facts = json.loads((Path(root) / RECORDING_FILE).read_text())
    steps = np.array(facts["steps_to_success"])
    who = "a person" if "human" in facts else "a policy and the expert" if "policy" in facts else "the expert"
    return (
        f"{facts['env_id']}: {len(steps)} episodes from {facts['attempts']} attempts of {who} "
        f"(success rate {len(steps) / facts['attempts']:.3f}), first success after {steps.mean():.1f} steps "
        f"({steps.min()}-{steps.max()})"
    )


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


def _make(
    wanted: Recording,
    parts: Path,
    root: Path,
    on_episode: Callable[[], None] | None,
    learner: Learner | None,
    person: Person | None,
) -> None:
    """Records what is missing among the finished episodes, and builds the dataset."""
    _prepare_parts(wanted, parts)
    env = gym.make(wanted.env_id, render_mode="human" if person and person.window else None)
    if wanted.sensors:
        env = ImperfectSensors(env, **wanted.sensors)
    try:
        kept = _record_episodes(env, wanted, parts, on_episode, learner, person)
        facts = wanted.facts() | {
            "seeds": [int(file.stem) for file in kept],
            "attempts": int(kept[-1].stem) - wanted.seed + 1,
        }
        if person:
            facts["frames"] = sum(len(_read_columns(file)[TIME_TO_GOAL]) for file in kept)
        shown = tqdm(kept, desc="Writing the dataset", unit="episode", disable=on_episode is not None)
        build_dataset(env, wanted.extras, map(_read_columns, shown), facts, parts / "dataset", root)
    except OSError as error:
        told = f"{error.strerror or error}; finished episodes are kept, repeat the command to go on"
        raise OSError(error.errno, told, str(parts)) from error
    finally:
        env.close()


def _record_episodes(
    env: gym.Env,
    wanted: Recording,
    parts: Path,
    on_episode: Callable[[], None] | None,
    learner: Learner | None,
    person: Person | None,
) -> list[Path]:
    """Records attempts until enough succeeded; returns the files of the successful ones, in order of their seeds."""
    kept: list[Path] = []
    name = f"Recording {unwrapped(env).task}"
    with tqdm(total=wanted.episodes, desc=name, unit="episode", disable=on_episode is not None) as bar:
        on_episode = on_episode or bar.update
        attempt = failures = 0
        while len(kept) < wanted.episodes:
            file = parts / f"{wanted.seed + attempt:09d}.npz"
            if not file.exists():
                unfinished = file.with_suffix(".unfinished")
                with unfinished.open("wb") as stream:
                    seed = wanted.seed + attempt
                    try:
                        episode = (
                            person.run_episode(env, seed, wanted.extras)
                            if person
                            else run_episode(env, seed, wanted.disturb, wanted.extras, learner)
                        )
                    except Stop:
                        raise RuntimeError(
                            f"Stopped. The {len(kept)} episodes of {wanted.episodes} that are finished are kept in "
                            f"{parts}; the same command goes on with seed {seed}"
                            + (f", and with --episodes {len(kept)} it ends with these." if kept else ".")
                        ) from None
                    np.savez_compressed(stream, **episode)  # type: ignore[arg-type]  # none is called allow_pickle
                os.replace(unfinished, file)
            if _succeeded(file):
                kept.append(file)
                on_episode()
                failures = 0
            else:
                failures += 1
            attempt += 1
            if failures == FAILURES_IN_A_ROW:
                raise RuntimeError(
                    f"{'A policy and the' if learner else 'The'} expert of {wanted.env_id} failed {failures} times in "
                    f"a row, the last time with seed {wanted.seed + attempt - 1}; the {len(kept)} successful episodes "
                    f"are kept in {parts}. "
                    + (f"Ask for these with --episodes {len(kept)}, or start" if kept else "Start")
                    + " from another seed in another folder."
                )
    return kept


def _succeeded(file: Path) -> bool:
    """Whether a finished attempt ended in success."""
    with np.load(file) as episode:
        return bool(episode["success"].any())


def _read_columns(file: Path) -> dict[str, np.ndarray]:
    with np.load(file) as episode:
        return to_columns(dict(episode))


def build_dataset(
    env: gym.Env, extras: Extras, episodes: Iterable[dict[str, np.ndarray]], facts: dict, building: Path, root: Path
) -> None:
    """Writes episodes as a LeRobot dataset beside its final place and moves it there in one step.

    Args:
        env: The task's environment.
        extras: What the episodes hold beside what all do.
        episodes: What ``to_columns`` gives of each.
        facts: What ``meta/surrol.json`` says; the steps to success are added.
        building: Where the dataset is written; what an interrupted call left there is removed.
        root: Folder of the dataset.
    """
    shutil.rmtree(building, ignore_errors=True)
    datasets.disable_progress_bars()
    dataset = LeRobotDataset.create(
        f"local/{root.name}",
        fps=env.metadata["render_fps"],
        features=describe_columns(env, extras),
        root=building,
        robot_type="dvrk_psm",
        use_videos=bool(extras.cameras),
        video_backend="pyav",
    )
    steps = []
    for columns in episodes:
        steps.append(int(columns[TIME_TO_GOAL][0, 0]))
        for t in range(len(columns[TIME_TO_GOAL])):
            frame = {key: values[t] for key, values in columns.items()}
            dataset.add_frame(frame | {"task": unwrapped(env).task_description})
        save_episode(dataset, parallel_encoding=False)  # that would fork, which a worker of `--all` may not
    dataset.finalize()
    sort_statistics(building)
    (building / RECORDING_FILE).write_text(json.dumps(facts | {"steps_to_success": steps}, indent=2) + "\n")
    root.parent.mkdir(parents=True, exist_ok=True)
    os.replace(building, root)


def sort_statistics(root: Path) -> None:
    """Brings a dataset's statistics into order: LeRobot writes them in that of a set, which differs by process."""
    stats = root / "meta/stats.json"
    stats.write_text(json.dumps(json.loads(stats.read_text()), indent=4, sort_keys=True) + "\n")


def _prepare_parts(wanted: Recording, parts: Path) -> None:
    """Notes the recording in the folder of finished episodes, and checks that they belong to it.

    An episode does not depend on how many there are, so this number may differ from that of an earlier call.
    """
    note = parts / PARTS_NOTE
    if note.exists():
        _check_same(replace(wanted, episodes=json.loads(note.read_text())["episodes"]), note, parts)
        kept = sum(map(_succeeded, parts.glob("*.npz")))
        if wanted.episodes < kept:
            raise ValueError(
                f"{parts} holds {kept} finished episodes, more than {wanted.episodes}; ask for at least as many, or "
                "choose another --root."
            )
    (parts / UNFINISHED_NOTE).write_text(json.dumps(wanted.facts()))
    os.replace(parts / UNFINISHED_NOTE, note)


def _are_ours(parts: Path) -> bool:
    """Whether a folder of finished episodes was written by ``record``: even if that was killed at once."""
    return (parts / PARTS_NOTE).exists() or {file.name for file in parts.iterdir()} <= {LOCK_FILE, UNFINISHED_NOTE}


def _remove_parts(parts: Path) -> None:
    """Empties the folder of finished episodes, the note that tells it from any other folder last."""
    for file in parts.iterdir():
        if file.is_dir():
            shutil.rmtree(file)
        elif file.name not in (PARTS_NOTE, LOCK_FILE):
            file.unlink()
    (parts / PARTS_NOTE).unlink(missing_ok=True)


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
