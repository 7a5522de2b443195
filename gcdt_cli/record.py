"""``gcdt record``."""

import argparse
import os
from functools import partial
from pathlib import Path
from typing import Any

from gcdt_cli.options import (
    add_executor,
    add_sensors,
    check_folder,
    check_root,
    check_tasks,
    checkpoint_of,
    executor_settings,
    names,
    sensor_settings,
)

EXAMPLE = "example: gcdt record --task NeedlePick --episodes 100 --seed 0 --root datasets/needle_pick"
TELEOP_EXAMPLE = "your own episodes: gcdt record --teleop keyboard --task NeedlePick --episodes 5 --root datasets/mine"
ALL_EXAMPLE = "all of the published datasets: gcdt record --all --root datasets"


def add(commands: Any) -> None:
    record = commands.add_parser(
        "record",
        help="record demonstrations of a scripted expert as a LeRobot dataset",
        epilog=f"{EXAMPLE}; {TELEOP_EXAMPLE}; {ALL_EXAMPLE}",
    )
    what = record.add_mutually_exclusive_group(required=True)
    what.add_argument("--task", help="name of the task, such as NeedlePick or my_module:MyTask")
    what.add_argument("--all", action="store_true", help="all tasks side by side, and their merger surrol_cross_task")
    record.add_argument("--episodes", type=int, default=100, help="successful episodes to keep (default 100)")
    record.add_argument("--seed", type=int, default=0, help="seed of the first episode (default 0)")
    record.add_argument(
        "--root",
        required=True,
        help="folder of the dataset, with --all of the datasets; an interrupted recording goes on there",
    )
    record.add_argument(
        "--disturb",
        type=float,
        metavar="LEVEL",
        help="push the arm now and then, by up to LEVEL of a full action; the expert corrects "
        "(default 0, with --all that of the published datasets)",
    )
    record.add_argument(
        "--policy",
        metavar="TRAINING",
        help="let a policy act at the beginning of every episode, and record what the expert would have done (DAgger): "
        "a training, a pretrained_model folder, a repository on the Hub, or generalist, which is built in",
    )
    record.add_argument(
        "--mix",
        type=float,
        metavar="BETA",
        help="with --policy: probability that a step of its part executes the expert's action (default 0)",
    )
    record.add_argument(
        "--teleop",
        choices=("keyboard", "keyboard_ee", "gamepad"),
        help="act yourself, in a window, in the expert's place: with a teleoperator of LeRobot's "
        "(needs lerobot[core_scripts])",
    )
    record.add_argument(
        "--fields",
        type=names,
        default=[],
        help="further numbers, separated by commas; there is: openh (others as my_module:my_field)",
    )
    record.add_argument("--cameras", type=names, default=[], help="cameras that film, such as overview,closeup")
    record.add_argument("--camera_size", type=int, help="with --cameras: width and height of the films (default 128)")
    record.add_argument(
        "--workers",
        type=int,
        help="with --all: datasets recorded at a time (default: one a core; with Slurm and Ray all that have room)",
    )
    record.add_argument(
        "--manifest",
        type=Path,
        help="with --all: what the episodes are compared with (default: that of the published ones)",
    )
    record.add_argument("--write_manifest", action="store_true", help="with --all: write the manifest instead")
    add_executor(record, "with --all, on other machines: a unit a task")
    add_sensors(record, "imperfect sensors, with --task: the expert acts by the truth")
    record.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    check_tasks([options.task] if options.task else [])
    if options.all and options.policy:
        raise ValueError("--policy acts in the recording of a single task; name it with --task instead of --all.")
    if options.mix is not None and not options.policy:
        raise ValueError(f"--mix {options.mix:g} needs a policy to mix with: --policy.")
    if options.teleop and (options.all or options.policy or options.disturb):
        raise ValueError("--teleop lets a person act alone, in a single task; leave out --all, --policy and --disturb.")
    sensors = sensor_settings(options)
    if sensors and (options.all or options.teleop):
        raise ValueError(f"Imperfect sensors ({', '.join(sensors)}) are for --task, with an expert or a policy.")
    executor = executor_settings(options, os.cpu_count() or 1)
    if executor and not options.all:
        raise ValueError(f"--executor {options.executor} runs the recordings of several tasks, with --all.")
    if options.camera_size is not None and not options.cameras:
        raise ValueError(f"--camera_size {options.camera_size} needs cameras that film: --cameras.")
    if not options.all:
        check_root(options.root)
        for name, unasked in (("workers", None), ("manifest", None), ("write_manifest", False)):
            if getattr(options, name) is not unasked:
                raise ValueError(f"--{name} goes with --all, not with a single task.")
    if options.teleop:
        from surrol_gym.display import check_display

        check_display()

    from lerobot_gcdt.recording import record
    from lerobot_gcdt.recording.collection import PUBLISHED_DISTURB, recording_units
    from lerobot_gcdt.recording.features import Extras
    from lerobot_gcdt.recording.manifest import MANIFEST

    size = Extras.camera_size if options.camera_size is None else options.camera_size
    extras = Extras(options.fields, options.cameras, size)
    if not options.all:
        who: dict[str, Any] = {"sensors": sensors or None}
        who["learner"] = _learner(options.policy, options.task, options.mix or 0.0) if options.policy else None
        if options.teleop:
            from lerobot_gcdt.robot.person import seat

            who["person"] = seat(options.teleop, options.task)
        record(options.task, options.episodes, options.seed, options.root, options.disturb or 0.0, extras, **who)
        return
    manifest = options.manifest or MANIFEST
    if options.write_manifest:
        check_folder(manifest.parent, "name the manifest's file with --manifest")
    disturb = PUBLISHED_DISTURB if options.disturb is None else options.disturb
    asked = (options.root, options.episodes, options.seed, disturb, extras)
    last = partial(_record_all, *asked, options.workers, manifest, options.write_manifest)
    if executor:
        from lerobot_gcdt.executors import run_units

        run_units(recording_units(*asked), last, options.root, **executor)
    else:
        last()


def _record_all(
    root: str,
    episodes: int,
    seed: int,
    disturb: float,
    extras: Any,
    workers: int | None,
    manifest: Path,
    write: bool,
) -> None:
    """Records what is not there yet, merges all, and compares it with the manifest."""
    from lerobot_gcdt.recording.collection import record_all
    from lerobot_gcdt.recording.manifest import write_manifest

    roots = record_all(root, episodes, seed, disturb, extras, workers)
    if write:
        write_manifest(roots, manifest)
    else:
        _compare(roots, manifest)


def _learner(named: str, task: str, mix: float) -> Any:
    """Loads the policy that acts while a task is recorded, a ``lerobot_gcdt.recording.Learner``."""
    from lerobot_gcdt.evaluation import load_policy
    from lerobot_gcdt.evaluation.tasks import tasks_of
    from lerobot_gcdt.recording import Learner

    found = checkpoint_of(named)
    tasks_of(found, [task])
    if found.parent.is_symlink():  # checkpoints/last, which is another one after more training
        named = str(found.parent.parent / found.parent.resolve().name / found.name)
    return Learner(load_policy(found), named, mix)


def _compare(roots: list[Path], manifest: Path) -> None:
    """Says of each dataset whether it holds what the manifest says; exits with status 1 if one does not."""
    from lerobot_gcdt.recording.manifest import differing_episodes

    if not manifest.exists():
        print(f"There is no {manifest}, so the datasets were not compared with the published ones.")
        return
    differing = {root: differing_episodes(root, manifest) for root in roots}
    for root, episodes in differing.items():
        if episodes is None:
            print(f"{root} is not a recording that the manifest knows.")
        elif episodes:
            print(f"{root} differs from the manifest in {len(episodes)} episodes: {', '.join(map(str, episodes))}")
        else:
            print(f"{root} matches the manifest.")
    if any(differing.values()):
        raise ValueError("the recorded datasets are kept, but differ from the published ones")
