"""The card of a trained policy: what it was trained on, how, and how often it succeeds.

The docstring of its class says, in the first line, what the policy is. Everything else is read from the checkpoint's
folder, so the card of a checkpoint can be written at any time.
"""

import dataclasses
import inspect
import json
import shlex
import subprocess
from functools import partial
from importlib.metadata import version
from pathlib import Path

import draccus
import pandas as pd
from huggingface_hub import EvalResult, ModelCardData
from lerobot.configs.default import DatasetConfig
from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.utils.import_utils import register_third_party_plugins

from lerobot_gcdt.evaluation.checkpoints import episodes_file
from lerobot_gcdt.evaluation.statistics import by_starts, wilson_interval
from lerobot_gcdt.hub.cards import CITATION, recording_commands
from lerobot_gcdt.recording.facts import RECORDING_FILE, recordings, task_named
from surrol_gym.registry import env_class, registered_tasks

NOT_CHOSEN = (
    "type", "input_features", "output_features", "device", "push_to_hub", "repo_id", "private", "tags", "license",
    "pretrained_path", "pretrained_revision", "task_dims", "expected_steps", "root", "video_backend",
)  # fmt: skip
"""Settings that LeRobot or the dataset fills in, or that say where a training ran and not what it was."""

CARD = """\
---
{data}
---

# {title}

{description},
for the surgical tasks of SurRoL in simulation: a policy of [LeRobot](https://github.com/huggingface/lerobot), trained
and loaded with the plugin `lerobot-policy-gcdt`. It knows these tasks by these sentences:

{tasks}

## Success

{success}

## Training

On the demonstrations in `{data_name}`, by

```bash
{commands}
```

{versions}

## How to use it

```python
{loading}.from_pretrained("{repo_id}")
```

```bash
lerobot-eval --policy.path={repo_id} --policy.device=cpu --env.type=surrol --env.task={env_task} \\
  --eval.n_episodes=100 --eval.batch_size=25 --eval.use_async_envs=false
```

## Limits

Trained on scripted demonstrations in simulation and evaluated in the same simulation; it has never moved a robot. It
acts on the simulator's state (poses of tools and objects), not on pictures, and only in the tasks above.

## Citation

{citation}
"""


def model_card(checkpoint: Path, repo_id: str | None = None) -> str:
    """Writes the card of a checkpoint.

    Args:
        checkpoint: Folder ``pretrained_model`` of a checkpoint of `lerobot-train`. Where evaluations left episodes
            beside it, the card shows their success rates.
        repo_id: Repository that it is published as; None for the name of the folder.

    Returns:
        Markdown with YAML front matter.
    """
    config = json.loads((checkpoint / "train_config.json").read_text())
    policy = json.loads((checkpoint / "config.json").read_text())
    repo_id = repo_id or checkpoint.name
    known = {task: told for told, task in _sentences(config["dataset"]).items() if told in policy["task_dims"]}
    episodes = episodes_file(checkpoint)
    table = pd.read_parquet(episodes) if episodes.exists() else None
    revision = config["dataset"]["revision"]
    policy_class = find_policy(policy["type"])
    return CARD.format(
        data=_metadata(repo_id, policy, config["dataset"]["repo_id"], table).to_yaml(),
        title=repo_id.split("/")[-1],
        description=(inspect.getdoc(policy_class) or "").partition("\n")[0].removesuffix("."),
        tasks="\n".join(f'* {task}: "{sentence}"' for task, sentence in known.items()),
        success=_success(table),
        data_name=config["dataset"]["repo_id"] + (f" at {revision}" if revision else ""),
        commands="\n".join(dict.fromkeys(_commands(checkpoint, config))),
        versions=_versions(),
        loading=_loading(policy_class),
        repo_id=repo_id,
        env_task=",".join(f"{task}-v0" for task in known),
        citation=CITATION,
    )


def find_policy(kind: str) -> type[PreTrainedPolicy]:
    """Finds the class of a type of policy, of this package or of an installed plugin.

    Raises:
        ValueError: There is none.
    """
    if kind not in PreTrainedConfig.get_known_choices():
        register_third_party_plugins()
    return get_policy_class(kind)


def _loading(policy_class: type[PreTrainedPolicy]) -> str:
    """The beginning of what loads a policy."""
    package, _, _ = policy_class.__module__.partition(".")
    if package == "lerobot_gcdt":
        return f"import lerobot_gcdt\n\npolicy = lerobot_gcdt.{policy_class.__name__}"
    return f"from {policy_class.__module__} import {policy_class.__name__}\n\npolicy = {policy_class.__name__}"


def _sentences(dataset: dict) -> dict[str, str]:
    """The task that each sentence tells, of those that are registered and those of a training's dataset."""
    note = _note(dataset)
    recorded = {part["env_id"]: task_named(part) for part in (recordings(note) if note else ())}
    tasks = {task: task for task in registered_tasks()} | recorded
    return {env_class(task).task_description: named for task, named in tasks.items()}


def _metadata(repo_id: str, policy: dict, dataset: str, table: pd.DataFrame | None) -> ModelCardData:
    """The front matter; a dataset that was never published has no name on the Hub.

    Of each task it tells the success on the last run of seeds: policies are chosen on lower ones.
    """
    last = {} if table is None else {task: rows for task, _, rows in by_starts(table)}
    results = [
        EvalResult(
            task_type="robotics",
            dataset_type=f"surrol/{task}-v0",  # tells the results apart
            dataset_name=f"surrol/{task}-v0",
            metric_type="success_rate",
            metric_name=f"success rate, {figure}",
            metric_value=round(float(rows[figure].mean()), 4),
        )
        for task, rows in last.items()
        for figure in ("reached", "held")
    ]
    return ModelCardData(
        license="apache-2.0",
        library_name="lerobot",
        pipeline_tag="robotics",
        tags=["LeRobot", "robotics", "surgical-robotics", "surrol", "dvrk", policy["type"]],
        datasets=None if dataset.startswith("local/") else dataset,
        model_name=repo_id.split("/")[-1] if results else None,
        eval_results=results or None,
    )


def _success(table: pd.DataFrame | None) -> str:
    if table is None:
        return "This checkpoint has not been evaluated."
    lines = [
        "Success rates with 95 % Wilson intervals: `reached` counts success at any step, `held` at the last one.",
        "",
        "| task | reached | held | starts | seeds |",
        "| --- | --- | --- | --- | --- |",
    ]
    for task, seeds, rows in by_starts(table):
        figures = [_figure(int(rows[figure].sum()), len(rows)) for figure in ("reached", "held")]
        lines.append(f"| {task} | {' | '.join(figures)} | {len(rows)} | {seeds} |")
    return "\n".join(lines)


def _figure(successes: int, starts: int) -> str:
    low, high = wilson_interval(successes, starts)
    return f"{successes / starts:.2f} ({low:.3f}-{high:.3f})"


def _recordings(dataset: dict) -> list[str]:
    """The commands that make a training's dataset, where its folder is still there to tell."""
    note = _note(dataset)
    return recording_commands(note, _folder(dataset)) if note else []


def _note(dataset: dict) -> dict:
    """What a training's dataset says of how it was recorded; nothing where its folder is not there to tell."""
    note = Path(dataset["root"] or "") / RECORDING_FILE
    return json.loads(note.read_text()) if note.exists() else {}


def _folder(dataset: dict) -> str:
    """The folder that the card's commands call the dataset's, wherever it was."""
    return f"datasets/{dataset['repo_id'].split('/')[-1]}"


def _commands(checkpoint: Path, config: dict) -> list[str]:
    """The commands that record a training's data and train, as one even where the training was interrupted.

    Those of the checkpoint that it started from come first, where that is on this machine.
    """
    policy, dataset = config["policy"], config["dataset"]
    start = _before_resuming(checkpoint, config)["policy"]["pretrained_path"]
    earlier, begin, before = [], f"--policy.type={policy['type']}", {}
    if start:
        begin, before = f"--policy.path={start}", _settings_of(start)
    if start and _is_checkpoint(start):
        folder = Path(start).resolve()
        output, step = f"outputs/{folder.parents[2].name}", folder.parent.name
        [*earlier, last] = _commands(folder, json.loads((folder / "train_config.json").read_text()))
        earlier.append(f"{last} \\\n  --output_dir={output}")
        begin = f"--policy.path={output}/checkpoints/{step}/pretrained_model"
    arguments = [
        begin,
        *_changed("policy", policy, PreTrainedConfig.get_choice_class(policy["type"]), before),
        f"--dataset.repo_id={dataset['repo_id']}",
        *([f"--dataset.root={_folder(dataset)}"] if dataset["root"] else []),
        *_changed("dataset", dataset, DatasetConfig, {}),
        *(f"--{name}={config[name]}" for name in ("steps", "batch_size", "seed")),
        "--policy.push_to_hub=false",
    ]
    return [*earlier, *_recordings(dataset), " \\\n  ".join(["lerobot-train", *map(shlex.quote, arguments)])]


def _settings_of(start: str) -> dict:
    """The settings of the policy that a training started from; what a repository has is not looked up."""
    file = Path(start) / "config.json"
    return json.loads(file.read_text()) if file.exists() else {"training_stage": None}  # the stage is always told


def _is_checkpoint(start: str) -> bool:
    """Whether a training started from a checkpoint of `lerobot-train` on this machine."""
    folder = Path(start).resolve()
    return folder.parent.parent.name == "checkpoints" and (folder / "train_config.json").exists()


def _before_resuming(checkpoint: Path, config: dict) -> dict:
    """The configuration of a training's first checkpoint: a resumed one only says that it goes on from itself."""
    first = sorted(checkpoint.resolve().parents[1].glob("*/pretrained_model/train_config.json"))
    return json.loads(first[0].read_text()) if config["resume"] and first else config


def _changed(group: str, values: dict, config_class: type, before: dict) -> list[str]:
    """The options of a group that were chosen: those that are not what they were before, or else their defaults."""
    options = []
    for field in dataclasses.fields(config_class):
        if field.name in values and field.name not in NOT_CHOSEN:
            default = field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
            value = values[field.name]
            if value != before.get(field.name, draccus.encode(default)):
                options.append(f"--{group}.{field.name}={value if isinstance(value, str) else json.dumps(value)}")
    return options


def _versions() -> str:
    commit = _commit()
    ours = f"lerobot-policy-gcdt {version('lerobot_policy_gcdt')}" + (f" at commit\n`{commit}`" if commit else "")
    return f"This card was written with {ours}, LeRobot {version('lerobot')} and PyTorch {version('torch')}."


def _commit() -> str | None:
    """The commit that this package is checked out at, marked where files differ from it; None for an installed one."""
    tracked = ["git", "ls-files", "--error-unmatch", "."]  # an installed package may lie in a foreign repository
    describe = ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    run = partial(subprocess.run, cwd=Path(__file__).parent, capture_output=True, check=True, text=True)
    try:
        run(tracked)
        return run(describe).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None
