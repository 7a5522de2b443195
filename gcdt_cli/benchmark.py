"""``gcdt benchmark``."""

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from gcdt_cli.options import (
    add_executor,
    add_sensors,
    check_folder,
    check_tasks,
    executor_settings,
    names,
    numbers,
    sensor_settings,
)

EXAMPLE = "example: gcdt benchmark --datasets datasets --tasks PickAndPlace,MatchBoard --methods gcdt bc"


def add(commands: Any) -> None:
    benchmark = commands.add_parser(
        "benchmark",
        help="train methods on tasks with several seeds, and draw their success against the seconds of training",
        epilog=f"{EXAMPLE}; repeated, the command goes on where it was interrupted",
    )
    benchmark.add_argument("--datasets", type=Path, default=Path("datasets"), help="folder of the published datasets")
    benchmark.add_argument(
        "--output",
        type=Path,
        default=Path("outputs/benchmark"),
        help="folder of the trainings, METHOD/TASK/SEED, and of the results (default outputs/benchmark)",
    )
    benchmark.add_argument("--tasks", type=names, required=True, help="tasks, separated by commas")
    benchmark.add_argument(
        "--methods",
        nargs="+",
        default=["gcdt,bc"],
        metavar="METHOD",
        help="types of policies, also separated by commas, expert, the scripted one, and variants in quotes, as a name "
        "and what it stands for, "
        "such as 'long=gcdt --policy.context_length=100 --steps=8000' (default gcdt,bc); --start=CHECKPOINT and "
        "--dataset=NAME of a variant say what it begins with, and what it learns all tasks from",
    )
    benchmark.add_argument(
        "--seeds", type=numbers, default=[0, 1, 2], help="seeds of the trainings, separated by commas (default 0,1,2)"
    )
    benchmark.add_argument(
        "--steps", type=int, help="optimiser steps of methods that do not say their own (default: as for gcdt train)"
    )
    benchmark.add_argument(
        "--demonstrations",
        type=numbers,
        help="numbers of demonstrations to compare, separated by commas, such as 10,25,50,100: the first ones of each "
        "dataset (default: all)",
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
    add_executor(benchmark, "on other machines: a unit a training")
    add_sensors(benchmark, "imperfect sensors and noisy actions, of all policies", noisy_actions=True)
    benchmark.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    check_tasks(options.tasks)
    executor = executor_settings(options, 1)
    if options.workers and not executor:
        raise ValueError("--workers of a benchmark go with --executor.")
    check_folder(options.datasets, f"`gcdt record --all --root {options.datasets}` records the datasets")

    starts = range(options.first_seed, options.first_seed + options.starts)
    named = ("datasets", "output", "tasks", "seeds", "steps", "points", "demonstrations", "options")
    asked = {name: getattr(options, name) for name in named}
    asked |= {"methods": _methods(options.methods), "starts": starts, "sensors": sensor_settings(options)}
    if executor:
        from lerobot_gcdt.benchmark.learning import Benchmark
        from lerobot_gcdt.executors import run_units

        units = Benchmark(**asked).units(write=not options.dry_run)
        run_units(units, partial(_report, asked), options.output, **executor)
    else:
        _report(asked)


def _report(asked: dict[str, Any]) -> None:
    """Runs what is not finished yet of a benchmark, and says how it ended."""
    from lerobot_gcdt.benchmark.learning import Benchmark
    from lerobot_gcdt.benchmark.report import success_rates, success_table

    print(success_table(success_rates(Benchmark(**asked).run())))
    print(f"The episodes, this table and figures lie in {asked['output']}.")


def _methods(arguments: list[str]) -> list[str]:
    """The methods, each by itself; what stands for one may hold commas."""
    return [method for text in arguments for method in ([text] if "=" in text else names(text))]
