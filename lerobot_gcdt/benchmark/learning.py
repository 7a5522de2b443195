"""How fast methods learn: success from validation starts against the seconds of training.

A cell is one training: of a method, on a task or some of its demonstrations, with a seed. What it gave stands in
``episodes.parquet``, a row an episode; the tables and the figures are drawn from nothing else.
"""

import json
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from lerobot.common.train_utils import get_step_checkpoint_dir
from tqdm import tqdm

from lerobot_gcdt.benchmark.methods import EXPERT, Method, parse_method
from lerobot_gcdt.benchmark.report import write_report
from lerobot_gcdt.evaluation import evaluate, evaluate_checkpoint
from lerobot_gcdt.evaluation.checkpoints import keep_episodes, keeps_other_sensors
from lerobot_gcdt.evaluation.expert import ExpertPolicy
from lerobot_gcdt.evaluation.tasks import check_starts
from lerobot_gcdt.recording.collection import dataset_name
from lerobot_gcdt.recording.facts import RECORDING_FILE, recordings, task_of
from lerobot_gcdt.training import train, training_seconds
from lerobot_gcdt.training.learned_data import fingerprint, note_datasets, noted_datasets
from surrol_gym.registry import find_task, task_name
from surrol_gym.wrappers import IDEAL, complete_sensors

EPISODES_FILE = "episodes.parquet"
EPISODES_OF_SENSORS = "episodes_of_sensors.parquet"
SETTINGS_FILE = "method.json"

CELL = ["method", "task", "demonstrations", "training_seed"]
EPISODE = [*CELL, "step", "seed"]
"""Columns that tell cells and episodes apart."""

PROCESS = f"{shlex.quote(sys.executable)} -m"
"""A training takes a process of its own, because a process keeps the precision of its first one."""

LOSSES = 80
"""Rows in the loss file of a training, at most."""


class Cell(NamedTuple):
    """One training.

    Attributes:
        method: What is trained.
        task: Name of the task.
        seed: Seed of the training.
        dataset: Folder of the dataset.
        demonstrations: Episodes of the task that it learns from.
        some: Whether it learns from the first ones only.
    """

    method: Method
    task: str
    seed: int
    dataset: Path
    demonstrations: int
    some: bool = False

    @property
    def key(self) -> tuple[str, str, int, int]:
        """What its rows have in the columns ``CELL``."""
        return self.method.name, self.task, self.demonstrations, self.seed

    @property
    def folder(self) -> Path:
        """Where the training lies in the output folder; tasks that are learned together share it."""
        data = self.method.dataset or self.task
        return Path(self.method.name, f"{data}_{self.demonstrations}" if self.some else data, str(self.seed))


class Plan(NamedTuple):
    """What a benchmark has to do.

    Attributes:
        methods: The methods.
        cells: All cells.
        unfinished: Those that lack episodes.
        sensors: All arguments of the sensors.
        datasets: The fingerprint of each dataset, by its name.
    """

    methods: list[Method]
    cells: list[Cell]
    unfinished: list[Cell]
    sensors: dict[str, float]
    datasets: dict[str, str | None]


@dataclass(frozen=True)
class Benchmark:
    """Methods on tasks, trained with several seeds, and checkpoints along the way evaluated from the same starts.

    Attributes:
        datasets: Folder of the datasets, named as the published ones.
        output: Folder of the trainings, ``METHOD/TASK/SEED``, ``METHOD/DATASET/SEED`` or
            ``METHOD/TASK_DEMONSTRATIONS/SEED``, and of the results.
        tasks: Names of the tasks.
        methods: As ``lerobot_gcdt.benchmark.methods.parse_method`` takes them.
        seeds: Seeds of the trainings.
        steps: Optimiser steps of the methods that do not say their own; None for those of
            ``lerobot_gcdt.training.recipes.RECIPES``.
        points: Checkpoints of each training that are evaluated, at equal distances up to its end.
        starts: Seeds of the starts that each is evaluated from. Demonstrations count up from 0; those from 100000 on
            are for reporting.
        demonstrations: Numbers of episodes, the first ones of a dataset, each of which a training of its own learns
            from; None for one with all of them.
        options: Arguments of `lerobot-train` for all methods.
        sensors: As ``lerobot_gcdt.evaluation.evaluate`` takes them; the datasets should have been recorded through the
            same.
    """

    datasets: str | Path
    output: str | Path
    tasks: Sequence[str]
    methods: Sequence[str] = ("gcdt", "bc")
    seeds: Sequence[int] = (0, 1, 2)
    steps: int | None = None
    points: int = 4
    starts: Sequence[int] = range(20_000, 20_200)
    demonstrations: Sequence[int] | None = None
    options: Sequence[str] = ()
    sensors: Mapping[str, Any] | None = None

    def run(self) -> pd.DataFrame:
        """Does what is not finished yet; an interrupted cell goes on.

        After each cell the episodes, the tables and figures are brought up to date
        (``lerobot_gcdt.benchmark.report``); they also hold what earlier benchmarks gave.

        Returns:
            The episodes of these cells, points and starts: ``method``, ``task``, ``demonstrations``, ``training_seed``,
            ``step``, ``seconds`` of training up to there (``lerobot_gcdt.training.training_seconds``), ``seed`` of the
            start, ``reached``, ``held`` and ``steps`` to the first success.

        Raises:
            ValueError: A method, a task, a number or an option is bad, or the output folder holds another method or
                other data under one of the names.
            FileNotFoundError: There is no dataset of a task, or no checkpoint to start from.
        """
        output, plan = Path(self.output), self._plan()
        _claim_folders(output, plan)
        done = len(plan.cells) - len(plan.unfinished)
        with tqdm(total=len(plan.cells), initial=done, desc="Benchmark", unit="training") as bar:
            for cell in plan.unfinished:
                keep_episodes(output / EPISODES_FILE, _run(cell, output, self.starts, plan.sensors), EPISODE)
                write_report(pd.read_parquet(output / EPISODES_FILE), output)
                bar.update()
        return self._kept(plan.cells)

    def units(self, write: bool = True) -> list[partial[None]]:
        """Returns the trainings that are not finished, with their evaluation, for ``lerobot_gcdt.executors.run_units``.

        Each keeps its episodes beside its own checkpoints alone; ``run`` then collects them.

        Args:
            write: Whether to note in the output folder what the names of the methods and the datasets stand for, as
                ``run`` does.

        Raises:
            ValueError, FileNotFoundError: As ``run`` does.
        """
        output, plan = Path(self.output), self._plan()
        if write:
            _claim_folders(output, plan)
        trainings: dict[Path, list[Cell]] = {}
        for cell in plan.unfinished:
            trainings.setdefault(cell.folder, []).append(cell)
        return [partial(_run_together, cells, output, self.starts, plan.sensors) for cells in trainings.values()]

    def _plan(self) -> Plan:
        """Checks what is asked for; writes nothing."""
        tasks = [task_name(find_task(task)) for task in self.tasks]
        check_starts(tasks, self.starts)
        methods = [parse_method(text, self.points, self.steps, self.options) for text in self.methods]
        _check_once("method", [method.name for method in methods])
        _check_once("task", tasks)
        _check_once("seed", self.seeds)
        if self.demonstrations is not None:
            _check_once("number of demonstrations", self.demonstrations)
        numbers: Sequence[int | None] = self.demonstrations or [None]
        # With the seed outermost, all methods and tasks can be compared as soon as the first seed is through.
        cells = [
            _cell(Path(self.datasets), method, task, seed, number)
            for seed in self.seeds
            for task in tasks
            for method in methods
            for number in numbers
        ]
        cells = [*dict.fromkeys(cells)]  # an expert has one for all seeds and numbers
        file, sensors = Path(self.output) / EPISODES_FILE, complete_sensors(self.sensors, IDEAL)
        if keeps_other_sensors(file, sensors):
            raise ValueError(f"{self.output} keeps episodes of other sensors than {sensors}; choose another --output.")
        _check_folders(Path(self.output), methods)
        held = noted_datasets(Path(self.output))
        found = {dataset.name: fingerprint(dataset) for dataset in dict.fromkeys(cell.dataset for cell in cells)}
        if other := [name for name in found if found[name] != held.get(name, found[name])]:
            raise ValueError(
                f"{self.output} holds trainings on other data than those of {', '.join(other)} in {self.datasets}; "
                "choose another --output."
            )
        kept, starts = self._kept(cells).groupby(CELL).size(), len(self.starts)
        unfinished = [cell for cell in cells if kept.get(cell.key) != cell.method.points * starts]
        return Plan(methods, cells, unfinished, sensors, found)

    def _kept(self, cells: Sequence[Cell]) -> pd.DataFrame:
        """The episodes that there are of these cells, their checkpoints and the starts."""
        file = Path(self.output) / EPISODES_FILE
        if not file.exists():
            return pd.DataFrame(columns=EPISODE)
        points = [(*cell.key, step) for cell in cells for step in cell.method.checkpoints]
        kept = pd.read_parquet(file)
        if not set(CELL) <= set(kept.columns):
            raise ValueError(f"{file} was written by an earlier version; choose another --output.")
        return pd.DataFrame(points, columns=EPISODE[:-1]).merge(kept[kept.seed.isin(self.starts)])


def _cell(datasets: Path, method: Method, task: str, seed: int, demonstrations: int | None) -> Cell:
    """A cell, if there is a dataset that it can learn from."""
    root = datasets / (method.dataset or dataset_name(task))
    if not (root / "meta/info.json").exists():
        records = f"--all --root {datasets}" if method.dataset else f"--task {task} --root {root}"
        raise FileNotFoundError(f"{root} holds no dataset; `gcdt record {records}` records one.")
    if method.policy == EXPERT:
        ExpertPolicy(task)  # raises ValueError for a task that has none
        return Cell(method, task, 0, root, 0)
    there = _demonstrations(root, task)
    if demonstrations is None:
        return Cell(method, task, seed, root, there)
    if method.dataset:
        raise ValueError(f"The method {method.name} learns several tasks together, from all their demonstrations.")
    if not 1 <= demonstrations <= there:
        raise ValueError(f"{root} holds {there} demonstrations, so a training cannot learn from {demonstrations}.")
    return Cell(method, task, seed, root, demonstrations, some=demonstrations < there)


def _demonstrations(root: Path, task: str) -> int:
    """The episodes of a task in a dataset, or all where it does not tell them apart."""
    facts = root / RECORDING_FILE
    parts = recordings(json.loads(facts.read_text())) if facts.exists() else []
    of_task = sum(part["episodes"] for part in parts if task_of(part) == task)
    return of_task or json.loads((root / "meta/info.json").read_text())["total_episodes"]


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


def _claim_folders(output: Path, plan: Plan) -> None:
    """Notes what each method and each dataset stands for, so that its name never comes to stand for another."""
    note_datasets(output, plan.datasets)
    for method in plan.methods:
        file = output / method.name / SETTINGS_FILE
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(method._asdict(), indent=2) + "\n")


def _run_together(cells: Sequence[Cell], output: Path, starts: Sequence[int], sensors: dict[str, float]) -> None:
    """Runs cells that share a training."""
    for cell in cells:
        _run(cell, output, starts, sensors)


def _run(cell: Cell, output: Path, starts: Sequence[int], sensors: dict[str, float]) -> pd.DataFrame:
    """Trains and evaluates one cell, or goes on with it; returns its episodes."""
    method, folder = cell.method, output / cell.folder
    if method.policy == EXPERT:
        return _table(cell, _expert_episodes(cell.task, folder / EPISODES_FILE, starts, sensors), 1, 0.0, sensors)
    every = method.checkpoints.step
    # A row of the loss file at each checkpoint, so that its seconds are known.
    row = min(n for n in range(min(every, max(1, method.steps // LOSSES)), every + 1) if every % n == 0)
    settings = [*method.options, f"--seed={cell.seed}", f"--save_freq={every}", f"--log_freq={row}"]
    settings += [f"--dataset.episodes={[*range(cell.demonstrations)]}"] if cell.some else []
    train(cell.dataset, folder, method.policy, None, method.start, method.steps, launcher=PROCESS, options=settings)
    points = []
    for step in method.checkpoints:
        checkpoint = get_step_checkpoint_dir(folder, method.steps, step) / "pretrained_model"
        file = None if sensors == IDEAL else checkpoint.parent / EPISODES_OF_SENSORS
        episodes = evaluate_checkpoint(checkpoint, [cell.task], starts, file=file, sensors=sensors)
        points.append(_table(cell, episodes, step, training_seconds(folder, step), sensors))
    return pd.concat(points, ignore_index=True)


def _expert_episodes(task: str, file: Path, starts: Sequence[int], sensors: dict[str, float]) -> pd.DataFrame:
    """Runs the expert of a task from the starts that its file does not keep yet; returns its episodes."""
    kept = pd.read_parquet(file).seed if file.exists() else ()
    if missing := sorted({*starts} - {*kept}):
        evaluate(ExpertPolicy(task), [task], missing, on_batch=partial(keep_episodes, file), sensors=sensors)
    return pd.read_parquet(file).set_index("seed").loc[[*starts]].reset_index()


def _table(cell: Cell, episodes: pd.DataFrame, step: int, seconds: float, sensors: dict[str, float]) -> pd.DataFrame:
    """The episodes of a checkpoint, as a benchmark keeps them."""
    facts = dict(zip(CELL, cell.key, strict=True)) | {"step": step, "seconds": seconds}
    facts |= {} if sensors == IDEAL else sensors
    return episodes.assign(**facts)[[*facts, "seed", "reached", "held", "steps"]]
