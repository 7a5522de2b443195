"""How fast methods learn: success from validation starts against the seconds of training.

A cell is one training: of a method, on a task, with a seed. What it gave stands in ``episodes.parquet``, a row an
episode; the table and the figure are drawn from nothing else.
"""

import json
import shlex
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from lerobot.common.train_utils import get_step_checkpoint_dir
from tqdm import tqdm

from lerobot_gcdt.benchmark.report import write_report
from lerobot_gcdt.evaluation import evaluate_checkpoint
from lerobot_gcdt.evaluation.checkpoints import keep_episodes
from lerobot_gcdt.evaluation.tasks import check_starts
from lerobot_gcdt.recording.demonstrations import dataset_name
from lerobot_gcdt.training import train, training_seconds
from lerobot_gcdt.training.stages import recipe, steps_to_train
from lerobot_gcdt.training.trainer import check_options
from surrol_gym.registry import find_task, task_name

EPISODES_FILE = "episodes.parquet"
SETTINGS_FILE = "method.json"
CELL = ["method", "task", "training_seed"]
EPISODE = [*CELL, "step", "seed"]
"""Columns that tell cells and episodes apart."""

PROCESS = f"{shlex.quote(sys.executable)} -m"
"""A training takes a process of its own, because a process keeps the precision of its first one."""

STEPS, LOSSES = "--steps=", 80
"""How a method says its own steps; rows in the loss file of a training, at most."""


class Method(NamedTuple):
    """A way to train a policy from scratch.

    Attributes:
        name: Its name, also of its folder.
        policy: Type of the policy.
        steps: Optimiser steps.
        points: Checkpoints that are evaluated.
        options: Further arguments of `lerobot-train`.
    """

    name: str
    policy: str
    steps: int
    points: int
    options: tuple[str, ...]

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


def parse_method(text: str, points: int, steps: int | None = None, options: Iterable[str] = ()) -> Method:
    """Reads a method.

    Args:
        text: A type of policy, such as ``bc``, or a name and what it stands for, such as
            ``long=gcdt --policy.context_length=100 --steps=8000``.
        points: Checkpoints that are evaluated, as far as there are steps.
        steps: Steps where the text says none; None for those of ``lerobot_gcdt.training.stages.RECIPES``.
        options: Arguments of `lerobot-train` for all methods; those of the text win.

    Returns:
        The method.

    Raises:
        ValueError: The name cannot be that of a folder, or the type, the steps, the points or an option is bad.
    """
    first, *own = shlex.split(text) or [""]
    name, named, policy = first.partition("=")
    policy = policy if named else name
    if not name.replace("-", "_").isidentifier():
        raise ValueError(
            f"{text!r} is no method; write a type of policy, such as gcdt, or a name and what it stands for, such as "
            "'long=gcdt --policy.context_length=100'."
        )
    for option in own:
        if option.startswith(STEPS):
            if not option.removeprefix(STEPS).isdigit():
                raise ValueError(f"The method {name} has {option}, which is no number of steps.")
            steps = int(option.removeprefix(STEPS))
    steps = steps_to_train(policy, recipe(policy, "scratch"), steps)
    points = min(points, steps)
    if points < 1 or steps % points:
        raise ValueError(f"The {steps} steps of the method {name} cannot be divided into {points} equal parts.")
    settings = (*options, *(option for option in own if not option.startswith(STEPS)))
    try:
        check_options([f"--policy.type={policy}", "--policy.push_to_hub=false", "--dataset.repo_id=any", *settings])
    except ValueError as error:
        raise ValueError(f"lerobot-train does not take the options of the method {name}: {error}") from None
    return Method(name, policy, steps, points, settings)


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
) -> pd.DataFrame:
    """Trains methods on tasks with several seeds, and evaluates checkpoints along the way.

    Cells that are finished are not repeated, and one that was interrupted goes on. After each, the episodes, the table
    ``success.md`` and the figure ``success.png`` are brought up to date; they also hold what earlier calls gave.

    Args:
        datasets: Folder of the datasets, named as the published ones.
        output: Folder of the trainings, ``METHOD/TASK/SEED``, and of the results.
        tasks: Names of the tasks.
        methods: As ``parse_method`` takes them.
        seeds: Seeds of the trainings.
        steps: Optimiser steps of the methods that do not say their own; None for those of
            ``lerobot_gcdt.training.stages.RECIPES``.
        points: Checkpoints of each training that are evaluated, at equal distances up to its end.
        starts: Seeds of the starts that each is evaluated from. Demonstrations count up from 0; those from 100000 on
            are for reporting.
        options: Arguments of `lerobot-train` for all methods.

    Returns:
        The episodes of these cells, points and starts: ``method``, ``task``, ``training_seed``, ``step``, ``seconds``
        of training up to there (``lerobot_gcdt.training.training_seconds``), ``seed`` of the start, ``reached``,
        ``held`` and ``steps`` to the first success.

    Raises:
        ValueError: A method, a task, a number or an option is bad, or the output folder holds another method under one
            of the names.
        FileNotFoundError: There is no dataset of a task.
    """
    datasets, output = Path(datasets), Path(output)
    names = [task_name(find_task(task)) for task in tasks]
    check_starts(names, starts)
    roots = {task: _dataset(datasets, task) for task in names}
    chosen = [parse_method(text, points, steps, options) for text in methods]
    _check_once("method", [method.name for method in chosen])
    _check_once("task", names)
    _check_once("seed", seeds)
    _claim_folders(output, chosen)
    # With the seed outermost, all methods and tasks can be compared as soon as the first seed is through.
    cells = [Cell(method, task, seed) for seed in seeds for task in names for method in chosen]
    numbers = _kept(output, cells, starts).groupby(CELL).size()
    finished = {cell for cell in cells if numbers.get(cell.key) == cell.method.points * len(starts)}
    with tqdm(total=len(cells), initial=len(finished), desc="Benchmark", unit="training") as bar:
        for cell in cells:
            if cell not in finished:
                keep_episodes(output / EPISODES_FILE, _run(cell, roots[cell.task], output, starts), EPISODE)
                write_report(pd.read_parquet(output / EPISODES_FILE), output)
                bar.update()
    return _kept(output, cells, starts)


def _dataset(datasets: Path, task: str) -> Path:
    """The folder of a task's dataset, if there is one."""
    root = datasets / dataset_name(task)
    if not (root / "meta/info.json").exists():
        raise FileNotFoundError(f"{root} holds no dataset; `gcdt record --task {task} --root {root}` records one.")
    return root


def _check_once(what: str, values: Sequence[str | int]) -> None:
    """Raises ValueError unless there are values, all of them different, and no negative number."""
    if not values or len(set(values)) < len(values) or any(isinstance(value, int) and value < 0 for value in values):
        raise ValueError(f"A benchmark needs at least one {what}, each once and no negative one; got {[*values]}.")


def _claim_folders(output: Path, methods: Sequence[Method]) -> None:
    """Notes what each method stands for, so that its name never comes to stand for another."""
    files = {output / method.name / SETTINGS_FILE: method._asdict() for method in methods}
    for file, settings in files.items():
        held = json.loads(file.read_text()) if file.exists() else None
        if held is None and file.parent.exists() and any(file.parent.iterdir()):
            raise ValueError(f"{file.parent} exists and is no method of a benchmark; choose another --output.")
        if held not in (None, json.loads(json.dumps(settings))):
            raise ValueError(
                f"{file.parent} holds the method {held}, not {settings}; choose another name or another --output."
            )
    for file, settings in files.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(settings, indent=2) + "\n")


def _kept(output: Path, cells: Sequence[Cell], starts: Sequence[int]) -> pd.DataFrame:
    """The episodes that there are of these cells, their checkpoints and these starts."""
    if not (output / EPISODES_FILE).exists():
        return pd.DataFrame(columns=EPISODE)
    asked = pd.DataFrame(
        [(*cell.key, step) for cell in cells for step in cell.method.checkpoints], columns=EPISODE[:-1]
    )
    kept = pd.read_parquet(output / EPISODES_FILE)
    return asked.merge(kept[kept.seed.isin(starts)])


def _run(cell: Cell, dataset: Path, output: Path, starts: Sequence[int]) -> pd.DataFrame:
    """Trains and evaluates one cell, or goes on with it; returns its episodes."""
    method, folder = cell.method, output / cell.method.name / cell.task / str(cell.seed)
    every = method.checkpoints.step
    # A row of the loss file at each checkpoint, so that its seconds are known.
    row = min(n for n in range(min(every, max(1, method.steps // LOSSES)), every + 1) if every % n == 0)
    settings = [*method.options, f"--seed={cell.seed}", f"--save_freq={every}", f"--log_freq={row}"]
    train(dataset, folder, method.policy, "scratch", steps=method.steps, launcher=PROCESS, options=settings)
    points = []
    for step in method.checkpoints:
        checkpoint = get_step_checkpoint_dir(folder, method.steps, step) / "pretrained_model"
        episodes = evaluate_checkpoint(checkpoint, [cell.task], starts)
        facts = dict(zip(CELL, cell.key, strict=True)) | {"step": step, "seconds": training_seconds(folder, step)}
        points.append(episodes.assign(**facts)[[*EPISODE[:-1], "seconds", "seed", "reached", "held", "steps"]])
    return pd.concat(points, ignore_index=True)
