"""How fast methods learn: success from validation starts against the seconds of training.

A cell is one training: of a method, on a task, with a seed. What it gave stands in ``episodes.parquet``, a row an
episode; the table and the figure are drawn from nothing else.
"""

import json
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from lerobot.common.train_utils import get_step_checkpoint_dir
from tqdm import tqdm

from lerobot_gcdt.benchmark.report import write_report
from lerobot_gcdt.evaluation import evaluate_checkpoint
from lerobot_gcdt.evaluation.checkpoints import keep_episodes, keeps_other_sensors
from lerobot_gcdt.evaluation.tasks import check_starts
from lerobot_gcdt.recording.demonstrations import dataset_name
from lerobot_gcdt.training import train, training_seconds
from lerobot_gcdt.training.outputs import existing_checkpoint
from lerobot_gcdt.training.stages import policy_type, recipe, steps_to_train
from lerobot_gcdt.training.trainer import check_options
from surrol_gym.registry import find_task, task_name
from surrol_gym.wrappers import PERFECT, complete_sensors

EPISODES_FILE = "episodes.parquet"
EPISODES_OF_SENSORS = "episodes_of_sensors.parquet"
SETTINGS_FILE = "method.json"
CELL = ["method", "task", "training_seed"]
EPISODE = [*CELL, "step", "seed"]
"""Columns that tell cells and episodes apart."""

PROCESS = f"{shlex.quote(sys.executable)} -m"
"""A training takes a process of its own, because a process keeps the precision of its first one."""

OWN = ("steps", "start", "dataset")
"""Options of a method that are not those of `lerobot-train`."""

LOSSES = 80
"""Rows in the loss file of a training, at most."""


class Method(NamedTuple):
    """A way to train a policy.

    Attributes:
        name: Its name, also of its folder.
        policy: Type of the policy.
        steps: Optimiser steps.
        points: Checkpoints that are evaluated.
        options: Further arguments of `lerobot-train`.
        start: Training, or folder of a checkpoint, that it begins with; None for random weights.
        dataset: Name of the dataset that it learns all tasks from, in one training; None for one of each task's.
    """

    name: str
    policy: str
    steps: int
    points: int
    options: tuple[str, ...]
    start: str | None = None
    dataset: str | None = None

    @property
    def checkpoints(self) -> range:
        """The steps of the checkpoints that are evaluated; the last is the end of the training."""
        every = self.steps // self.points
        return range(every, self.steps + 1, every)


class Cell(NamedTuple):
    """One training."""

    method: Method
    task: str
    seed: int

    @property
    def key(self) -> tuple[str, str, int]:
        """What its rows have in the columns ``CELL``."""
        return self.method.name, self.task, self.seed

    @property
    def folder(self) -> Path:
        """Where the training lies in the output folder; tasks that are learned together share it."""
        return Path(self.method.name, self.method.dataset or self.task, str(self.seed))


def parse_method(text: str, points: int, steps: int | None = None, options: Iterable[str] = ()) -> Method:
    """Reads a method.

    Args:
        text: A type of policy, such as ``bc``, or a name and what it stands for, such as
            ``long=gcdt --policy.context_length=100 --steps=8000``. Beside options of `lerobot-train` it may hold
            ``--steps``, ``--start`` and ``--dataset`` (``Method``).
        points: Checkpoints that are evaluated, as far as there are steps.
        steps: Steps where the text says none; None for those of ``lerobot_gcdt.training.stages.RECIPES``.
        options: Arguments of `lerobot-train` for all methods; those of the text win.

    Returns:
        The method.

    Raises:
        ValueError: The name cannot be that of a folder, or the type, the steps, the points or an option is bad.
        FileNotFoundError: There is no checkpoint to start from.
    """
    first, *own = shlex.split(text) or [""]
    name, named, policy = first.partition("=")
    policy = policy if named else name
    if not name.replace("-", "_").isidentifier():
        raise ValueError(
            f"{text!r} is no method; write a type of policy, such as gcdt, or a name and what it stands for, such as "
            "'long=gcdt --policy.context_length=100'."
        )
    said = dict(option[2:].split("=", 1) for option in own if option.startswith(tuple(f"--{key}=" for key in OWN)))
    if not said.get("steps", "1").isdigit():
        raise ValueError(f"The method {name} has --steps={said['steps']}, which is no number of steps.")
    start = existing_checkpoint(said["start"]) if "start" in said else None
    if start and policy != (found := policy_type(start)):
        raise ValueError(f"The method {name} is a policy of type {policy}, and {said['start']} is one of type {found}.")
    steps = int(said["steps"]) if "steps" in said else steps
    steps = steps_to_train(policy, recipe(policy, "finetune" if start else "scratch", start), steps)
    points = min(points, steps)
    if points < 1 or steps % points:
        raise ValueError(f"The {steps} steps of the method {name} cannot be divided into {points} equal parts.")
    settings = (*options, *(option for option in own if option[2:].partition("=")[0] not in said))
    try:
        check_options([f"--policy.type={policy}", "--policy.push_to_hub=false", "--dataset.repo_id=any", *settings])
    except ValueError as error:
        raise ValueError(f"lerobot-train does not take the options of the method {name}: {error}") from None
    return Method(name, policy, steps, points, settings, said.get("start"), said.get("dataset"))


def benchmark(
    datasets: str | Path,
    output: str | Path,
    tasks: Sequence[str],
    methods: Sequence[str] = ("gcdt", "bc"),
    seeds: Sequence[int] = (0, 1, 2),
    steps: int | None = None,
    points: int = 4,
    starts: Sequence[int] = range(20_000, 20_200),
    options: Sequence[str] = (),
    sensors: Mapping[str, Any] | None = None,
) -> pd.DataFrame:
    """Trains methods on tasks with several seeds, and evaluates checkpoints along the way.

    Cells that are finished are not repeated, and one that was interrupted goes on. After each, the episodes, the tables
    and figures are brought up to date (``lerobot_gcdt.benchmark.report``); they also hold what earlier calls gave.

    Args:
        datasets: Folder of the datasets, named as the published ones.
        output: Folder of the trainings, ``METHOD/TASK/SEED`` or ``METHOD/DATASET/SEED``, and of the results.
        tasks: Names of the tasks.
        methods: As ``parse_method`` takes them.
        seeds: Seeds of the trainings.
        steps: Optimiser steps of the methods that do not say their own; None for those of
            ``lerobot_gcdt.training.stages.RECIPES``.
        points: Checkpoints of each training that are evaluated, at equal distances up to its end.
        starts: Seeds of the starts that each is evaluated from. Demonstrations count up from 0; those from 100000 on
            are for reporting.
        options: Arguments of `lerobot-train` for all methods.
        sensors: As ``lerobot_gcdt.evaluation.evaluate`` takes them; the datasets should have been recorded through the
            same.

    Returns:
        The episodes of these cells, points and starts: ``method``, ``task``, ``training_seed``, ``step``, ``seconds``
        of training up to there (``lerobot_gcdt.training.training_seconds``), ``seed`` of the start, ``reached``,
        ``held`` and ``steps`` to the first success.

    Raises:
        ValueError: A method, a task, a number or an option is bad, or the output folder holds another method under one
            of the names.
        FileNotFoundError: There is no dataset of a task, or no checkpoint to start from.
    """
    output = Path(output)
    plan = _plan(datasets, output, tasks, methods, seeds, steps, points, starts, options, sensors)
    _claim_folders(output, plan.methods)
    done = len(plan.cells) - len(plan.unfinished)
    with tqdm(total=len(plan.cells), initial=done, desc="Benchmark", unit="training") as bar:
        for cell, root in plan.unfinished.items():
            keep_episodes(output / EPISODES_FILE, _run(cell, root, output, starts, plan.sensors), EPISODE)
            write_report(pd.read_parquet(output / EPISODES_FILE), output)
            bar.update()
    return _kept(output, plan.cells, starts)


def training_units(output: str | Path, write: bool = True, **request: Any) -> list[partial[None]]:
    """Returns the trainings that ``benchmark`` lacks, with their evaluation, for ``lerobot_gcdt.executors.run_units``.

    Each keeps its episodes beside its own checkpoints alone; ``benchmark`` with the same arguments then collects them.

    Args:
        output: Folder of the trainings and of the results.
        write: Whether to note there what the names of the methods stand for, as ``benchmark`` does.
        request: All other arguments of ``benchmark``, whose errors are raised, too.
    """
    output = Path(output)
    plan = _plan(output=output, **request)
    if write:
        _claim_folders(output, plan.methods)
    trainings: dict[Path, list[Cell]] = {}
    for cell in plan.unfinished:
        trainings.setdefault(cell.folder, []).append(cell)
    return [
        partial(_run_together, cells, plan.unfinished[cells[0]], output, request["starts"], plan.sensors)
        for cells in trainings.values()
    ]


class Plan(NamedTuple):
    """What a benchmark is about.

    Attributes:
        methods: The methods.
        cells: All cells.
        unfinished: The datasets of those cells that lack episodes.
        sensors: All arguments of the sensors.
    """

    methods: list[Method]
    cells: list[Cell]
    unfinished: dict[Cell, Path]
    sensors: dict[str, float]


def _plan(
    datasets: str | Path,
    output: Path,
    tasks: Sequence[str],
    methods: Sequence[str],
    seeds: Sequence[int],
    steps: int | None,
    points: int,
    starts: Sequence[int],
    options: Sequence[str],
    sensors: Mapping[str, Any] | None,
) -> Plan:
    """Checks the arguments of ``benchmark``; writes nothing."""
    names = [task_name(find_task(task)) for task in tasks]
    check_starts(names, starts)
    chosen = [parse_method(text, points, steps, options) for text in methods]
    _check_once("method", [method.name for method in chosen])
    _check_once("task", names)
    _check_once("seed", seeds)
    # With the seed outermost, all methods and tasks can be compared as soon as the first seed is through.
    cells = [Cell(method, task, seed) for seed in seeds for task in names for method in chosen]
    roots = {cell: _dataset(Path(datasets), cell) for cell in cells}
    described = complete_sensors(sensors)
    if keeps_other_sensors(output / EPISODES_FILE, described):
        raise ValueError(f"{output} keeps episodes of other sensors than {described}; choose another --output.")
    _check_folders(output, chosen)
    numbers = _kept(output, cells, starts).groupby(CELL).size()
    unfinished = {
        cell: root for cell, root in roots.items() if numbers.get(cell.key) != cell.method.points * len(starts)
    }
    return Plan(chosen, cells, unfinished, described)


def _dataset(datasets: Path, cell: Cell) -> Path:
    """The folder of the dataset that a cell learns from, if there is one."""
    root = datasets / (cell.method.dataset or dataset_name(cell.task))
    if not (root / "meta/info.json").exists():
        records = f"--all --root {datasets}" if cell.method.dataset else f"--task {cell.task} --root {root}"
        raise FileNotFoundError(f"{root} holds no dataset; `gcdt record {records}` records one.")
    return root


def _check_once(what: str, values: Sequence[str | int]) -> None:
    """Raises ValueError unless there are values, all of them different, and no negative number."""
    if not values or len(set(values)) < len(values) or any(isinstance(value, int) and value < 0 for value in values):
        raise ValueError(f"A benchmark needs at least one {what}, each once and no negative one; got {[*values]}.")


def _check_folders(output: Path, methods: Sequence[Method]) -> None:
    """Raises ValueError if the name of a method stands for another one, or its folder holds something else."""
    for method in methods:
        file, settings = output / method.name / SETTINGS_FILE, method._asdict()
        held = json.loads(file.read_text()) if file.exists() else None
        if held is None and file.parent.exists() and any(file.parent.iterdir()):
            raise ValueError(f"{file.parent} exists and is no method of a benchmark; choose another --output.")
        if held not in (None, json.loads(json.dumps(settings))):
            raise ValueError(
                f"{file.parent} holds the method {held}, not {settings}; choose another name or another --output."
            )


def _claim_folders(output: Path, methods: Sequence[Method]) -> None:
    """Notes what each method stands for, so that its name never comes to stand for another."""
    for method in methods:
        file = output / method.name / SETTINGS_FILE
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(method._asdict(), indent=2) + "\n")


def _kept(output: Path, cells: Sequence[Cell], starts: Sequence[int]) -> pd.DataFrame:
    """The episodes that there are of these cells, their checkpoints and these starts."""
    if not (output / EPISODES_FILE).exists():
        return pd.DataFrame(columns=EPISODE)
    asked = pd.DataFrame(
        [(*cell.key, step) for cell in cells for step in cell.method.checkpoints], columns=EPISODE[:-1]
    )
    kept = pd.read_parquet(output / EPISODES_FILE)
    return asked.merge(kept[kept.seed.isin(starts)])


def _run_together(
    cells: Sequence[Cell], dataset: Path, output: Path, starts: Sequence[int], sensors: dict[str, float]
) -> None:
    """Runs cells that share a training."""
    for cell in cells:
        _run(cell, dataset, output, starts, sensors)


def _run(cell: Cell, dataset: Path, output: Path, starts: Sequence[int], sensors: dict[str, float]) -> pd.DataFrame:
    """Trains and evaluates one cell, or goes on with it; returns its episodes."""
    method, folder = cell.method, output / cell.folder
    every = method.checkpoints.step
    # A row of the loss file at each checkpoint, so that its seconds are known.
    row = min(n for n in range(min(every, max(1, method.steps // LOSSES)), every + 1) if every % n == 0)
    settings = [*method.options, f"--seed={cell.seed}", f"--save_freq={every}", f"--log_freq={row}"]
    train(dataset, folder, method.policy, None, method.start, method.steps, launcher=PROCESS, options=settings)
    points = []
    for step in method.checkpoints:
        checkpoint = get_step_checkpoint_dir(folder, method.steps, step) / "pretrained_model"
        file = None if sensors == PERFECT else checkpoint.parent / EPISODES_OF_SENSORS
        episodes = evaluate_checkpoint(checkpoint, [cell.task], starts, file=file, sensors=sensors)
        facts = dict(zip(CELL, cell.key, strict=True)) | {"step": step, "seconds": training_seconds(folder, step)}
        facts |= {} if sensors == PERFECT else sensors
        points.append(episodes.assign(**facts)[[*facts, "seed", "reached", "held", "steps"]])
    return pd.concat(points, ignore_index=True)
