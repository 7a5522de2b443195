"""The console command ``gcdt``.

A module outside of ``lerobot_gcdt``, because importing that package registers its policies with LeRobot and so loads
PyTorch and LeRobot, which takes many seconds. Whoever asks for help or mistypes something is answered without them.
"""

import argparse
import os
import sys
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

RECORD_EXAMPLE = "example: gcdt record --task NeedlePick --episodes 100 --seed 0 --root datasets/needle_pick"
RECORD_TELEOP_EXAMPLE = (
    "your own episodes: gcdt record --teleop keyboard --task NeedlePick --episodes 5 --root datasets/mine"
)
RECORD_ALL_EXAMPLE = "all of the published datasets: gcdt record --all --root datasets"
IMPORT_EXAMPLE = "example: gcdt import data_NeedlePickRL-v0_random_200.npz --task NeedlePick --root datasets/imported"
MERGE_EXAMPLE = "example: gcdt merge datasets/needle_pick datasets/peg_transfer --root datasets/surrol_cross_task"
TRAIN_EXAMPLE = "example: gcdt train --dataset datasets/surrol_needle_pick --output outputs/needle_pick"
EVALUATE_EXAMPLE = "example: gcdt evaluate outputs/needle_pick --first_seed 100000 --starts 100"
BENCHMARK_EXAMPLE = "example: gcdt benchmark --datasets datasets --tasks PickAndPlace,MatchBoard --methods gcdt bc"
PUBLISH_EXAMPLE = "example: gcdt publish datasets/surrol_needle_pick --repo_id user/surrol_needle_pick --dry_run"

EXECUTORS = {
    "local": set[str](),
    "slurm": {"partition", "time", "cpus_per_task", "gpus_per_task", "dry_run"},
    "ray": {"cpus_per_task", "gpus_per_task"},
}
"""Options that go with each executor, beside ``--workers``."""

EXPORT_EXAMPLE = "example: gcdt export-dvrk --policy expert --task PegTransfer --seed 3 --out outputs/peg_transfer_dvrk"


def main(arguments: list[str] | None = None) -> None:
    """Runs ``gcdt``; a bad argument ends with one line and an exit status other than 0."""
    # Threads that wait busily for each other make a training beside other work take up to 40 times as long.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # read when PyTorch is loaded
    parser = argparse.ArgumentParser(
        prog="gcdt", description="Datasets and policies of the SurRoL tasks.", epilog=RECORD_EXAMPLE
    )
    commands = parser.add_subparsers(dest="command", required=True)
    _add_record(commands)
    _add_import(commands)
    _add_merge(commands)
    _add_train(commands)
    _add_evaluate(commands)
    _add_benchmark(commands)
    _add_publish(commands)
    _add_export_dvrk(commands)
    options = parser.parse_args(arguments)
    try:
        options.run(options)
    except (ValueError, OSError, RuntimeError) as error:
        sys.exit(f"gcdt {options.command}: {error}")


def _add_record(commands: Any) -> None:
    record = commands.add_parser(
        "record",
        help="record demonstrations of a scripted expert as a LeRobot dataset",
        epilog=f"{RECORD_EXAMPLE}; {RECORD_TELEOP_EXAMPLE}; {RECORD_ALL_EXAMPLE}",
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
        type=_names,
        default=[],
        help="further numbers, separated by commas; there is: openh (others as my_module:my_field)",
    )
    record.add_argument("--cameras", type=_names, default=[], help="cameras that film, such as overview,closeup")
    record.add_argument("--camera_size", type=int, default=128, help="width and height of the films (default 128)")
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
    _add_executor(record, "with --all, on other machines: a unit a task")
    _add_sensors(record, "imperfect sensors, with --task: the expert acts by the truth")
    record.set_defaults(run=_record)


def _add_import(commands: Any) -> None:
    importing = commands.add_parser(
        "import",
        help="import demonstrations of SurRoL or DEX, or plain arrays, as a LeRobot dataset",
        epilog=f"{IMPORT_EXAMPLE}; for N episodes of T steps, archives of SurRoL hold acs (N, T, A) and obs, N times "
        "T + 1 dictionaries of observation, achieved_goal and desired_goal; plain arrays are called actions (N, T, A), "
        "observations (N, T + 1, O), desired_goals and achieved_goals (N, T + 1, G)",
    )
    importing.add_argument(
        "files", nargs="+", metavar="FILE", help="archives (.npz) of SurRoL or DEX, or of plain arrays"
    )
    importing.add_argument("--task", required=True, help="name of the task, such as NeedlePick")
    importing.add_argument("--root", required=True, help="folder of the dataset")
    importing.set_defaults(run=_import)


def _add_merge(commands: Any) -> None:
    merge = commands.add_parser(
        "merge", help="merge the datasets of several tasks into one for cross-task training", epilog=MERGE_EXAMPLE
    )
    merge.add_argument("datasets", nargs="+", help="folders of datasets that `gcdt record` or `gcdt import` wrote")
    merge.add_argument("--root", required=True, help="folder of the merged dataset")
    merge.set_defaults(run=_merge)


def _add_train(commands: Any) -> None:
    train = commands.add_parser(
        "train",
        help="train a policy with lerobot-train, or go on where that was interrupted",
        epilog=TRAIN_EXAMPLE,
    )
    train.add_argument("--dataset", required=True, type=Path, help="folder of a dataset")
    train.add_argument("--output", required=True, type=Path, help="folder of the checkpoints and the losses")
    train.add_argument(
        "--policy", metavar="TYPE", help="gcdt (default), bc, dt, vinn, or a type of LeRobot's, such as act"
    )
    train.add_argument(
        "--stage",
        choices=("pretrain", "generalist", "finetune", "scratch"),
        help="pretrain: all objectives, on many tasks; generalist: then the actions alone; finetune: then one task "
        "(default with --start); scratch: from random weights (default without)",
    )
    train.add_argument("--start", type=Path, help="training, or folder of a checkpoint, to begin with")
    train.add_argument("--steps", type=int, help="optimiser steps (default: what the stage needs, of gcdt and bc)")
    train.add_argument("--device", help="where to train, such as cpu or cuda (default: LeRobot chooses)")
    train.add_argument(
        "--launcher", help="command that runs a module, such as 'accelerate launch --num_processes=4 -m'"
    )
    train.add_argument("options", nargs="*", metavar="-- OPTION", help="more arguments of lerobot-train, after --")
    train.set_defaults(run=_train)


def _add_evaluate(commands: Any) -> None:
    evaluate = commands.add_parser(
        "evaluate",
        help="evaluate trained policies from fresh starts; the episodes are kept beside their checkpoints",
        epilog=EVALUATE_EXAMPLE,
    )
    evaluate.add_argument(
        "trainings",
        nargs="+",
        metavar="TRAINING",
        help="training, or pretrained_model folder in it; with --episodes a single one, a repository on the Hub, or "
        "generalist, which is built in",
    )
    evaluate.add_argument(
        "--tasks", type=_names, help="tasks, separated by commas (default: all that the policy knows)"
    )
    evaluate.add_argument("--first_seed", type=int, default=100_000, help="seed of the first start (default 100000)")
    evaluate.add_argument("--starts", type=int, default=100, help="episodes of each task (default 100)")
    evaluate.add_argument(
        "--episodes", type=Path, metavar="FILE", help="keep the episodes in this Parquet file instead"
    )
    evaluate.add_argument("--film", action="store_true", help="also film the first three, beside the checkpoint")
    _add_sensors(evaluate, "imperfect sensors, with --episodes")
    evaluate.set_defaults(run=_evaluate)


def _add_benchmark(commands: Any) -> None:
    benchmark = commands.add_parser(
        "benchmark",
        help="train methods on tasks with several seeds, and draw their success against the seconds of training",
        epilog=f"{BENCHMARK_EXAMPLE}; repeated, the command goes on where it was interrupted",
    )
    benchmark.add_argument("--datasets", type=Path, default=Path("datasets"), help="folder of the published datasets")
    benchmark.add_argument(
        "--output",
        type=Path,
        default=Path("outputs/benchmark"),
        help="folder of the trainings, METHOD/TASK/SEED, and of the results (default outputs/benchmark)",
    )
    benchmark.add_argument("--tasks", type=_names, required=True, help="tasks, separated by commas")
    benchmark.add_argument(
        "--methods",
        nargs="+",
        default=["gcdt,bc"],
        metavar="METHOD",
        help="types of policies, also separated by commas, and variants in quotes, as a name and what it stands for, "
        "such as 'long=gcdt --policy.context_length=100 --steps=8000' (default gcdt,bc); --start=CHECKPOINT and "
        "--dataset=NAME of a variant say what it begins with, and what it learns all tasks from",
    )
    benchmark.add_argument(
        "--seeds", type=_numbers, default=[0, 1, 2], help="seeds of the trainings, separated by commas (default 0,1,2)"
    )
    benchmark.add_argument(
        "--steps", type=int, help="optimiser steps of methods that do not say their own (default: as for gcdt train)"
    )
    benchmark.add_argument(
        "--points", type=int, default=4, help="checkpoints of each training that are evaluated (default 4)"
    )
    benchmark.add_argument("--starts", type=int, default=200, help="episodes of each checkpoint (default 200)")
    benchmark.add_argument(
        "--first_seed",
        type=int,
        default=20_000,
        help="seed of the first start (default 20000, for validation: starts from 100000 on are for reporting, so "
        "nothing may be chosen by them)",
    )
    benchmark.add_argument(
        "options", nargs="*", metavar="-- OPTION", help="more arguments of lerobot-train, of all methods, after --"
    )
    benchmark.add_argument(
        "--workers",
        type=int,
        help="with --executor: trainings at a time (default: 1; with Slurm and Ray all that have room)",
    )
    _add_executor(benchmark, "on other machines: a unit a training")
    _add_sensors(benchmark, "imperfect sensors, through which all policies see")
    benchmark.set_defaults(run=_benchmark)


def _add_publish(commands: Any) -> None:
    publish = commands.add_parser(
        "publish", help="publish a dataset or a trained policy, with its card, on the Hub", epilog=PUBLISH_EXAMPLE
    )
    publish.add_argument(
        "folder", help="a dataset of `gcdt record`, `import` or `merge`, or an output folder of lerobot-train"
    )
    publish.add_argument("--repo_id", required=True, metavar="USER/NAME", help="repository to publish it as")
    publish.add_argument("--private", action="store_true", help="make a new repository private")
    publish.add_argument("--revision_tag", metavar="TAG", help="name that this state keeps for ever, such as v1.0")
    publish.add_argument("--dry_run", action="store_true", help="only show what would be sent")
    publish.set_defaults(run=_publish)


def _add_export_dvrk(commands: Any) -> None:
    export = commands.add_parser(
        "export-dvrk",
        help="export an episode as set-points of a da Vinci Research Kit, with a safety report",
        epilog=f"{EXPORT_EXAMPLE}; no real robot was ever moved with this: read docs/dvrk.md first",
    )
    export.add_argument(
        "--policy",
        required=True,
        metavar="TRAINING",
        help="who acts: expert, a training, a pretrained_model folder, a repository on the Hub, or generalist, which "
        "is built in",
    )
    export.add_argument("--task", required=True, help="name of the task, such as PegTransfer or my_module:MyTask")
    export.add_argument("--seed", type=int, default=0, help="seed of the episode (default 0)")
    export.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="folder of the set-points and the report"
    )
    export.add_argument("--rate", type=float, default=200.0, help="set-points a second (default 200)")
    export.add_argument(
        "--base-frame", type=Path, metavar="FILE", help="measured poses of the RCMs, JSON (default: the simulator's)"
    )
    export.add_argument("--bag", action="store_true", help="also write a ROS 2 bag (mcap), which needs the extra dvrk")
    export.add_argument("--allow_unsafe", action="store_true", help="write a trajectory that breaks limits, too")
    export.set_defaults(run=_export_dvrk)


def _add_sensors(command: argparse.ArgumentParser, title: str) -> None:
    sensors = command.add_argument_group(title)
    sensors.add_argument("--position_std", type=float, default=0.0, help="noise of each coordinate, su (default 0)")
    sensors.add_argument("--angle_std", type=float, default=0.0, help="noise of each angle, radians (default 0)")
    sensors.add_argument("--dropout", type=float, default=0.0, help="probability that a step is missed (default 0)")
    sensors.add_argument("--delay", type=int, default=0, help="steps by which what is shown lags (default 0)")


def _add_executor(command: argparse.ArgumentParser, title: str) -> None:
    executor = command.add_argument_group(f"{title} (needs lerobot_policy_gcdt[executors])")
    executor.add_argument("--executor", choices=EXECUTORS, help="who runs the units: datatrove's executor of that name")
    executor.add_argument("--partition", help="with Slurm: the partition")
    executor.add_argument("--time", metavar="HH:MM:SS", help="with Slurm: the longest time of a unit")
    executor.add_argument("--cpus_per_task", type=int, help="with Slurm and Ray: cores a unit, of 2 GB (default 1)")
    executor.add_argument("--gpus_per_task", type=int, help="with Slurm and Ray: GPUs a unit (default 0)")
    executor.add_argument("--dry_run", action="store_true", help="with Slurm: only show what would be submitted")


def _executor(options: argparse.Namespace, workers: int) -> dict[str, Any]:
    """What the options of ``_add_executor`` say, as arguments of ``run_units``; nothing without an executor.

    Args:
        options: The options.
        workers: Units at a time on this machine, where that is not said.
    """
    named = ("partition", "time", "cpus_per_task", "gpus_per_task", "dry_run")
    given = {name: value for name in named if (value := getattr(options, name))}
    for name in given:
        if name not in EXECUTORS.get(options.executor, ()):
            takers = " or ".join(executor for executor, takes in EXECUTORS.items() if name in takes)
            raise ValueError(f"--{name} goes with --executor {takers}.")
    if not options.executor:
        return {}
    if options.workers is not None and options.workers < 1:
        raise ValueError(f"--executor needs at least one worker, got {options.workers}.")
    if options.executor == "slurm" and not {"partition", "time"} <= given.keys():
        raise ValueError("--executor slurm needs a --partition and a --time, such as 02:00:00.")
    for package in ("datatrove", "ray") if options.executor == "ray" else ("datatrove",):
        if not find_spec(package):
            raise RuntimeError(
                f"--executor {options.executor} needs {package}, which is not installed: "
                "`pip install 'lerobot_policy_gcdt[executors]'`."
            )
    elsewhere = options.executor != "local"
    return {"executor": options.executor, "workers": options.workers or (-1 if elsewhere else workers), **given}


def _sensors(options: argparse.Namespace) -> dict[str, float]:
    """What the options of ``_add_sensors`` say, without those that leave sensors perfect."""
    from surrol_gym.wrappers import PERFECT

    return {name: value for name in PERFECT if (value := getattr(options, name))}


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


def _numbers(text: str) -> list[int]:
    return [int(number) for number in text.split(",")]


def _methods(arguments: list[str]) -> list[str]:
    """The methods, each by itself; what stands for one may hold commas."""
    return [method for text in arguments for method in ([text] if "=" in text else _names(text))]


def _check_tasks(names: list[str]) -> None:
    """Raises ValueError for an unknown task, before anything slow is imported."""
    import surrol_gym

    for name in names:
        surrol_gym.find_task(name)


def _check_folder(folder: Path, remedy: str) -> None:
    """Raises FileNotFoundError for a missing folder, before anything slow is imported."""
    if not folder.exists():
        raise FileNotFoundError(f"There is no folder {folder}; {remedy}.")


def _record(options: argparse.Namespace) -> None:
    _check_tasks([options.task] if options.task else [])
    if options.all and options.policy:
        raise ValueError("--policy acts in the recording of a single task; name it with --task instead of --all.")
    if options.mix is not None and not options.policy:
        raise ValueError(f"--mix {options.mix:g} needs a policy to mix with: --policy.")
    if options.teleop and (options.all or options.policy or options.disturb):
        raise ValueError("--teleop lets a person act alone, in a single task; leave out --all, --policy and --disturb.")
    sensors = _sensors(options)
    if sensors and (options.all or options.teleop):
        raise ValueError(f"Imperfect sensors ({', '.join(sensors)}) are for --task, with an expert or a policy.")
    executor = _executor(options, os.cpu_count() or 1)
    if executor and not options.all:
        raise ValueError(f"--executor {options.executor} runs the recordings of several tasks, with --all.")
    if options.teleop:
        from surrol_gym.display import check_display

        check_display()

    from lerobot_gcdt.recording import record
    from lerobot_gcdt.recording.collection import PUBLISHED_DISTURB, recording_units
    from lerobot_gcdt.recording.features import Extras
    from lerobot_gcdt.recording.manifest import MANIFEST

    extras = Extras(options.fields, options.cameras, options.camera_size)
    if not options.all:
        who: dict[str, Any] = {"sensors": sensors or None}
        who["learner"] = _learner(options.policy, options.task, options.mix or 0.0) if options.policy else None
        if options.teleop:
            from lerobot_gcdt.robot.person import seat

            who["person"] = seat(options.teleop, options.task)
        record(options.task, options.episodes, options.seed, options.root, options.disturb or 0.0, extras, **who)
        return
    disturb = PUBLISHED_DISTURB if options.disturb is None else options.disturb
    asked = (options.root, options.episodes, options.seed, disturb, extras)
    last = partial(_record_all, *asked, options.workers, options.manifest or MANIFEST, options.write_manifest)
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

    found = _checkpoint(named)
    tasks_of(found, [task])
    if found.parent.is_symlink():  # checkpoints/last, which is another one after more training
        named = str(found.parent.parent / found.parent.resolve().name / found.name)
    return Learner(load_policy(found), named, mix)


def _checkpoint(named: str) -> Path:
    """Returns where a policy is loaded from: the built-in one, a training, a folder, or a repository on the Hub."""
    from lerobot_gcdt import GENERALIST
    from lerobot_gcdt.training import checkpoint

    return GENERALIST if named == "generalist" else checkpoint(named)


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


def _import(options: argparse.Namespace) -> None:
    _check_tasks([options.task])

    from lerobot_gcdt.recording import import_demonstrations

    import_demonstrations(options.files, options.task, options.root)


def _merge(options: argparse.Namespace) -> None:
    from lerobot_gcdt.recording import merge

    merge(options.datasets, options.root)


def _train(options: argparse.Namespace) -> None:
    _check_folder(options.dataset, f"`gcdt record --task TASK --root {options.dataset}` records a dataset")
    if options.start:
        _check_folder(options.start, f"`gcdt train --dataset DATASET --output {options.start}` trains a policy")

    from lerobot_gcdt.training import train

    train(**{name: value for name, value in vars(options).items() if name not in ("command", "run")})


def _evaluate(options: argparse.Namespace) -> None:
    _check_tasks(options.tasks or [])
    if options.episodes and len(options.trainings) > 1:
        raise ValueError(f"--episodes keeps those of a single training, got {', '.join(options.trainings)}.")
    sensors = _sensors(options)
    if sensors and not options.episodes:
        raise ValueError(f"Episodes of imperfect sensors ({', '.join(sensors)}) need a file of their own: --episodes.")
    for training in [] if options.episodes else options.trainings:
        _check_folder(Path(training), f"`gcdt train --dataset DATASET --output {training}` trains a policy")

    from lerobot_gcdt.evaluation import describe, evaluate_checkpoint, load_policy
    from lerobot_gcdt.evaluation.pictures import film
    from lerobot_gcdt.evaluation.tasks import tasks_of
    from lerobot_gcdt.training import existing_checkpoint

    seeds = range(options.first_seed, options.first_seed + options.starts)
    if options.episodes:
        checkpoints = {training: _checkpoint(training) for training in options.trainings}
    else:
        checkpoints = {training: existing_checkpoint(training) for training in options.trainings}
    tasks = {training: tasks_of(found, options.tasks) for training, found in checkpoints.items()}
    for training, found in checkpoints.items():
        episodes = evaluate_checkpoint(found, tasks[training], seeds, file=options.episodes, sensors=sensors)
        print(f"{training}\n{describe(episodes)}", flush=True)
        for task in tasks[training] if options.film else []:
            path = (options.episodes or found.resolve()).parent / f"{task}.mp4"
            film(load_policy(found), task, seeds[:3], path, sensors=sensors)
            print(f"The film is {path}.")


def _benchmark(options: argparse.Namespace) -> None:
    _check_tasks(options.tasks)
    executor = _executor(options, 1)
    if options.workers and not executor:
        raise ValueError("--workers of a benchmark go with --executor.")
    _check_folder(options.datasets, f"`gcdt record --all --root {options.datasets}` records the datasets")

    starts = range(options.first_seed, options.first_seed + options.starts)
    asked = {name: getattr(options, name) for name in ("datasets", "output", "tasks", "seeds", "steps", "points")}
    asked |= {"methods": _methods(options.methods), "starts": starts}
    asked |= {"options": options.options, "sensors": _sensors(options)}
    last = partial(_report, asked)
    if executor:
        from lerobot_gcdt.benchmark.learning import training_units
        from lerobot_gcdt.executors import run_units

        units = training_units(write=not options.dry_run, **asked)
        run_units(units, last, options.output, **executor)
    else:
        last()


def _report(asked: dict[str, Any]) -> None:
    """Runs what is not finished yet of a benchmark, and says how it ended."""
    from lerobot_gcdt.benchmark.learning import benchmark
    from lerobot_gcdt.benchmark.report import success_rates, success_table

    print(success_table(success_rates(benchmark(**asked))))
    print(f"The episodes, this table and a figure lie in {asked['output']}.")


def _publish(options: argparse.Namespace) -> None:
    from lerobot_gcdt.hub.publish import publish

    publish(options.folder, options.repo_id, options.private, options.revision_tag, options.dry_run)


def _export_dvrk(options: argparse.Namespace) -> None:
    _check_tasks([options.task])

    from lerobot_gcdt.robot.export import export

    policy = None
    if options.policy != "expert":
        from lerobot_gcdt.evaluation import load_policy
        from lerobot_gcdt.evaluation.tasks import tasks_of

        checkpoint = _checkpoint(options.policy)
        tasks_of(checkpoint, [options.task])
        policy = load_policy(checkpoint)
    asked = {name: getattr(options, name) for name in ("rate", "base_frame", "bag", "allow_unsafe")}
    report = export(options.task, options.seed, options.out, policy, options.policy, **asked)
    print(f"{report.summary()}\nThe set-points and the report are in {options.out}.")


if __name__ == "__main__":
    main()
