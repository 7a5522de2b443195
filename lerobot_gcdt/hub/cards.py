"""The card of a dataset: what every number means, how it was made, how often the expert succeeded.

A card is a function of the facts of a recording and of the docstring of its environment, so it cannot drift from them.
The manifest keeps the facts of the published datasets, whose cards can thus be written without the data.
"""

import shlex
import textwrap
from collections import Counter
from dataclasses import asdict
from pathlib import Path

from huggingface_hub import DatasetCardData

from lerobot_gcdt.hub.card_tables import number_tables, other_keys
from lerobot_gcdt.hub.docstrings import sections
from lerobot_gcdt.keys import PADDED
from lerobot_gcdt.recording.collection import dataset_name
from lerobot_gcdt.recording.facts import card_facts, frames_of, is_human, is_imported, recordings, task_named, task_of
from lerobot_gcdt.recording.features import NO_EXTRAS
from surrol_gym.quantities import table
from surrol_gym.registry import env_class, find_law, task_spec

PICTURES = "pictures"
"""Folder of a published dataset that holds a picture of each task."""

SIZES = ("n<1K", "1K<n<10K", "10K<n<100K", "100K<n<1M", "1M<n<10M", "10M<n<100M")
"""The Hub's words for less than a thousand frames, and for up to ten times as many each."""

CITATION = """\
Xu et al., "SurRoL: An Open-source Reinforcement Learning Centered and dVRK Compatible Platform for Surgical Robot
Learning", IROS 2021. Fu et al., "Multi-objective Cross-task Learning via Goal-conditioned GPT-based Decision
Transformers for Surgical Robot Task Automation", ICRA 2024."""
"""Of the tasks and of the method."""

CARD = """\
---
{data}
---

# {title}

{summary}

{body}

## How to use it

```python
from lerobot.datasets.lerobot_dataset import LeRobotDataset

dataset = LeRobotDataset("{repo_id}")
```

With the plugin `lerobot-policy-gcdt` installed:

```bash
lerobot-train --policy.type=gcdt --policy.push_to_hub=false --dataset.repo_id={repo_id} \\
  {stage} --num_workers=0 --output_dir=outputs/{title}
```

## Limits

{limits}

## Licence and citation

{licence}. Please cite the tasks and the method:

{citation}
"""

BODY = """\
![{seen}]({picture})

## The task

{description}

**Reward.** {reward}

**Start.** {start}

## How it was made

```bash
{commands}
```

{origin}

## What the numbers mean

{frames}

{numbers}

### Other keys

{others}"""

MERGED_BODY = """\
{tasks}

## How it was made

```bash
{commands}
```

{origin}

## What the numbers mean

{frames}

{padding}

{others}

{numbers}"""

EXPERTS = """\
The experts are feedback laws that read from the observation what to do next; attempts that failed are left out. Every
episode goes on to the time limit of its task. `gcdt record --all --root datasets` makes all of the published datasets.\
"""

FRAMES = """\
Positions are in the world frame, whose x axis points from the robot towards the camera and whose z axis points up, in
scaled units: 1 su = 0.2 m. Angles are radians. A frame holds what was observed before a step of 0.2 s, the action and
its outcome. Numbers of an action lie in [-1, 1]; a disturbance is added to it, in the same units.
`observation.achieved_goal` is the achieved goal and `observation.goal` the desired one, which
`observation.environment_state` repeats, because LeRobot's own policies look for it there."""

REPLAY = """\
`meta/surrol.json` keeps the seed of every episode, which replays it:

```python
env = gymnasium.make({env_id})  # after `import surrol_gym`
env.reset(seed=seed)
env.step(action + disturbance)  # of each frame
```"""


def dataset_card(root: Path, repo_id: str | None = None) -> str:
    """Writes the card of a dataset of ``gcdt record``, ``gcdt import`` or ``gcdt merge``.

    Args:
        root: Folder of the dataset.
        repo_id: Repository that it is published as; None for the name of the folder.

    Returns:
        Markdown with YAML front matter. It shows ``pictures/<task>.png`` of each task.
    """
    return card(card_facts(root), repo_id or f"user/{root.name}", PICTURES)


def card(facts: dict, repo_id: str, pictures: str) -> str:
    """Writes a card.

    Args:
        facts: What ``card_facts`` returns.
        repo_id: Repository that the card names.
        pictures: Folder of the pictures of the tasks, seen from the card.

    Returns:
        Markdown with YAML front matter.
    """
    parts, merged, name = recordings(facts), "merged_from" in facts, repo_id.split("/")[-1]
    episodes, frames = sum(part["episodes"] for part in parts), sum(map(frames_of, parts))
    imported, human = any(map(is_imported, parts)), any(map(is_human, parts))
    tasks = len({part["env_id"] for part in parts})
    of = f"{tasks} task{'s' * (tasks > 1)}" if merged else f"`{facts['env_id']}`"
    if imported:
        made = f"of {of}, {'recorded and ' * merged}imported"
    elif human:
        made = f"by {'scripted experts and ' * (not all(map(is_human, parts)))}a person, of {of}"
    else:
        made = f"by the scripted expert{'s' * merged} of {of}"
    told = "" if merged else f' The task in a sentence: "{env_class(facts["env_id"]).task_description}"'
    return CARD.format(
        data=_metadata("cross-task" if merged else task_of(facts), imported, human, frames).to_yaml(),
        title=name,
        summary=_fill(
            f"{episodes:,} demonstrations {made}, after SurRoL, in simulation: {frames:,} frames, 5 "
            f"a second, as a dataset of [LeRobot](https://github.com/huggingface/lerobot).{told}"
        ),
        body=(_merged_body if merged else _body)(facts, name, pictures),
        repo_id=repo_id,
        stage="--policy.training_stage=pretrain --steps=20000 --batch_size=4"
        if merged
        else "--steps=12000 --batch_size=2",
        limits="\n".join(textwrap.fill(f"* {limit}", 120, subsequent_indent="  ") for limit in _limits(parts)),
        licence="Apache-2.0, but for imported episodes, whose licence is that of their files"
        if imported
        else "Apache-2.0",
        citation=CITATION,
    )


def recording_commands(facts: dict, root: str) -> list[str]:
    """Returns the commands that make a dataset in the folder ``root``, by what ``meta/surrol.json`` says of it."""
    if "merged_from" in facts:
        parts: dict[str, dict] = {}
        folders: Counter[str] = Counter()
        for part in recordings(facts):
            folder = f"datasets/{dataset_name(task_of(part))}{'_imported' * is_imported(part)}"
            parts[f"{folder}_{folders[folder]}" if folder in folders else folder] = part
            folders[folder] += 1
        made = [command for folder, part in parts.items() for command in recording_commands(part, folder)]
        return [*made, " \\\n  ".join(["gcdt merge", *parts, f"--root {root}"])]
    if is_imported(facts):
        files = " ".join(shlex.quote(note["file"]) for note in facts["imported_from"])
        return [f"gcdt import {files} --task {task_named(facts)} --root {root}"]
    told = [name for name in ("episodes", "seed", "disturb", "policy", "mix") if name in facts]
    options = {"task": task_named(facts)} | {name: shlex.quote(str(facts[name])) for name in told}
    if is_human(facts):
        options = {"teleop": facts["human"]} | {name: options[name] for name in options if name != "disturb"}
    extras = facts["extras"]
    options |= {name: ",".join(extras[name]) for name in ("fields", "cameras") if extras[name]}
    options |= {"camera_size": extras["camera_size"]} if extras["cameras"] else {}
    options |= _imperfections(facts)
    return [" ".join(["gcdt record", *(f"--{name} {value}" for name, value in options.items()), f"--root {root}"])]


def success_rate(facts: dict) -> str:
    """Returns how many attempts of the expert succeeded."""
    return f"{facts['episodes']} of {facts['attempts']} ({_percent(facts['episodes'] / facts['attempts'])})"


def steps_to_success(facts: dict) -> str:
    """Returns the mean, smallest and largest number of steps to the first success."""
    return "{mean} on average, {min} to {max}".format(**facts["steps_to_success"])


def _metadata(subject: str, imported: bool, human: bool, frames: int) -> DatasetCardData:
    return DatasetCardData(
        license="other" if imported else "apache-2.0",
        task_categories=["robotics"],
        tags=["LeRobot", "surgical-robotics", "surrol", "dvrk"],
        pretty_name=f"SurRoL {subject}, {'imported' if imported else 'human' if human else 'scripted'} demonstrations",
        size_categories=[SIZES[max(len(str(frames)) - 3, 0)]],
        configs=[{"config_name": "default", "data_files": "data/*/*.parquet"}],
    )


def _body(facts: dict, name: str, pictures: str) -> str:
    task_class = env_class(facts["env_id"])
    told = sections(task_class)
    return BODY.format(
        seen=f"{task_of(facts)}, the expert half way" if find_law(task_class) else f"{task_of(facts)} at the start",
        picture=f"{pictures}/{task_of(facts)}.png",
        description=told["Description"],
        reward=told["Rewards"],
        start=told["Starting State"],
        commands="\n".join(recording_commands(facts, f"datasets/{name}")),
        origin=_origin(facts),
        frames=FRAMES,
        numbers=number_tables(task_class, facts["statistics"], "###"),
        others=other_keys(task_class, facts["extras"], facts["statistics"]),
    )


def _merged_body(facts: dict, name: str, pictures: str) -> str:
    parts, rows, lengths = recordings(facts), [], []
    for part in parts:
        task, task_class = task_of(part), env_class(part["env_id"])
        names = (task_class.observation_names, task_class.goal_names, task_class.action_names)
        lengths.append([len(numbers) for numbers in names])
        sizes = ", ".join(map(str, lengths[-1]))
        seen = [f"![{task}]({pictures}/{task}.png)", f"`{part['env_id']}`", task_class.task_description, sizes]
        rows.append([*seen, f"{frames_of(part):,}", success_rate(part), steps_to_success(part)])
    env_ids = {task_of(part): part["env_id"] for part in parts}
    numbers = [f"### {task}\n\n{number_tables(env_class(env_id), {}, '####')}" for task, env_id in env_ids.items()]
    titles = ["", "task", "`task`", "observation, goal, action", "frames", "successful attempts", "steps to success"]
    observation, goal, action = map(max, zip(*lengths, strict=True))
    padded = zip(PADDED, (observation, goal, goal, goal, action, action), strict=True)
    sizes = ", ".join(f"{size} in `{key}`" for key, size in padded)
    return MERGED_BODY.format(
        tasks=table(titles, rows),
        commands="\n".join(recording_commands(facts, f"datasets/{name}")),
        origin="\n\n".join(_merged_origin(parts)),
        frames=FRAMES,
        padding=_fill(
            f"Vectors are padded with zeros, to {sizes}. Their numbers are named by position, such as `state_0`, and "
            "mean what the tables below say of each task; `meta/info.json` keeps their sizes without padding in the "
            "description of `observation.state`. `meta/stats.json` is over all tasks and the padding; statistics of "
            "each task are in the card of its own dataset."
        ),
        others=other_keys(env_class(parts[0]["env_id"]), asdict(NO_EXTRAS), {}),
        numbers="\n\n".join(numbers),
    )


def _origin(facts: dict) -> str:
    """Where the episodes of a part come from."""
    if is_imported(facts):
        return _fill(
            f"The {task_of(facts)} episodes were imported by lerobot-policy-gcdt {facts['package_version']} from files "
            "whose names and SHA-256 sums `meta/surrol.json` keeps. Who acted there, and in which simulator, the files "
            f"do not say. {success_rate(facts)} of their episodes reach the goal by the test of `{facts['env_id']}`, "
            "from which success and time to goal follow; the others are left out. Steps to the first success: "
            f"{steps_to_success(facts)}. What may have been added to the actions is not known; `disturbance` is 0."
        )
    last, limit = facts["seed"] + facts["attempts"] - 1, task_spec(facts["env_id"]).max_episode_steps
    if is_human(facts):
        person = _fill(
            f"A person acted, with LeRobot's teleoperator {facts['human']}, and saw the scene in a window. Time stood "
            "still while they commanded nothing, and an episode ended when the goal had been held for a second; so "
            f"episodes have their own lengths. {success_rate(facts)} attempts succeeded, the seeds {facts['seed']} to "
            f"{last}; the others are left out, and so is what the person began anew. Steps to the first success: "
            f"{steps_to_success(facts)}. Recorded with lerobot-policy-gcdt {facts['package_version']}."
        )
        return "\n\n".join([person, *_sensors([facts]), _pushes([facts])])
    expert = _fill(
        "The expert is a feedback law that reads from the observation what to do next. It succeeded in "
        f"{success_rate(facts)} attempts, the seeds {facts['seed']} to {last}; those that failed are left out. "
        f"Steps to the first success: {steps_to_success(facts)}; every episode goes on to the time limit of "
        f"{limit} steps. Recorded with lerobot-policy-gcdt {facts['package_version']}, whose command writes the "
        "same numbers again."
    )
    return "\n\n".join([expert, *_policies([facts]), *_sensors([facts]), _pushes([facts])])


def _merged_origin(parts: list[dict]) -> list[str]:
    """Where the episodes of a merged dataset come from: the experts, and what was imported."""
    others = [part for part in parts if is_imported(part) or is_human(part)]
    recorded = [part for part in parts if part not in others]
    by_experts = [EXPERTS, *_policies(recorded), *_sensors(recorded), _pushes(recorded)] if recorded else []
    return [*by_experts, *map(_origin, others)]


def _policies(parts: list[dict]) -> list[str]:
    """What the policies did that acted in the expert's place, a paragraph each."""
    return [
        _fill(
            f"In {part['episodes']:,} episodes of {task_of(part)} the policy `{part['policy']}` acted from the start "
            "to a step that was drawn from the whole episode, and from there on the expert. Where the policy acted, "
            f"the expert's action was executed with probability {part['mix']:g}. `action` is always what the expert "
            "would have done, and `disturbance` what was done minus that."
        )
        for part in parts
        if "policy" in part
    ]


def _sensors(parts: list[dict]) -> list[str]:
    """What the sensors were that recordings were made through, a paragraph each."""
    return [
        _fill(
            f"Observations and achieved goals of {part['episodes']:,} episodes of {task_of(part)} are what imperfect "
            f"sensors showed (`surrol_gym.wrappers.ImperfectSensors`): {named}. Success, reward and "
            "time to goal go by the truth, by which an expert acts, too."
        )
        for part in parts
        if (named := ", ".join(f"{name} = {value}" for name, value in _imperfections(part).items()))
    ]


def _imperfections(facts: dict) -> dict:
    """The settings of the sensors, without those that change nothing."""
    return {name: value for name, value in facts.get("sensors", {}).items() if value}


def _pushes(parts: list[dict]) -> str:
    """What the pushes were, where there were any, and how to replay an episode."""
    levels = sorted({part["disturb"] for part in parts} - {0})
    size = " or ".join(f"{level:g}" for level in levels)
    rates = sorted({part["push_rate"] for part in parts if "push_rate" in part})
    often = f"in {' or '.join(map(_percent, rates))} of the steps, " if rates else ""
    pushes = _fill(
        f"Now and then an arm was pushed for one step: {often}by up to {size} of a full action in each direction and "
        "in the turn, but never ahead, where the jaws point. `action` is always the expert's own and `disturbance` "
        "what was added to it, so the data show how to correct."
    )
    replay = REPLAY.format(env_id=f'"{parts[0]["env_id"]}"' if len(parts) == 1 else "env_id")
    return f"{pushes}\n\n{replay}" if levels else replay


def _limits(parts: list[dict]) -> list[str]:
    recorded = [part for part in parts if not is_imported(part)]
    limits = []
    if recorded:
        limits += [
            "Simulation only: nothing here was tried on a robot. The scenes are rebuilt from measured dimensions, not "
            "copied; contacts are close to SurRoL's, not equal.",
            "One person's skill, with coarse controls and without depth to see."
            if any(map(is_human, recorded))
            else "Scripted experts only: no person's skill, and one way to do a task.",
        ]
    if len(recorded) < len(parts):
        limits.append(
            "Imported episodes are what their files say: scenes and contacts of other versions of SurRoL differ from "
            "those of this package, in which policies are evaluated."
        )
    worst = min(parts, key=lambda part: part["episodes"] / part["attempts"])
    if failed := 1 - worst["episodes"] / worst["attempts"]:
        limits.append(
            f"{_percent(failed)} of the attempts{f' at {task_of(worst)}' if len(parts) > 1 else ''} failed and are not "
            "in the data: the episodes are a selection, poor in starts and pushes that the expert did not save."
        )
    if any("policy" in part for part in parts):
        limits.append("The errors are those of the policies that acted, as far as the expert could save the episode.")
    elif any(part["disturb"] for part in parts):
        limits.append("The errors are pushes of a single step; failed grasps and their repair are rare.")
    elif recorded and not any(map(is_human, recorded)):
        limits.append("Nothing diverts the expert, so how to correct is hardly in the data.")
    return limits


def _percent(share: float) -> str:
    return f"{100 * share:.1f}".removesuffix(".0") + " %"


def _fill(text: str) -> str:
    return textwrap.fill(text, 120, break_long_words=False, break_on_hyphens=False)
