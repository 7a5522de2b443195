"""Draws every task and writes the table of tasks into the README.

    python examples/task_gallery.py

The pictures show the moment at which the expert is half way to its first success.
"""

import argparse
from pathlib import Path

import surrol_gym
from lerobot_gcdt.evaluation.pictures import halfway
from lerobot_gcdt.hub.documents import write_section
from surrol_gym.registry import env_class, task_spec

ROOT = Path(__file__).parent.parent
PICTURES = Path("examples/tasks")
WIDTH, HEIGHT = 320, 240


def table() -> str:
    """Returns the table of tasks as Markdown."""
    lines = ["| | id | observation, goal, action | steps | the task |", "| --- | --- | --- | --- | --- |"]
    for task in surrol_gym.TASKS:
        env, spec = env_class(task), task_spec(task)
        sizes = f"{len(env.observation_names)}, {len(env.goal_names)}, {len(env.action_names)}"
        picture = f"![{task}]({PICTURES.as_posix()}/{task}.png)"
        lines.append(f"| {picture} | `{spec.id}` | {sizes} | {spec.max_episode_steps} | {env.task_description} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    (ROOT / PICTURES).mkdir(exist_ok=True)
    for task in surrol_gym.TASKS:
        halfway(task, WIDTH, HEIGHT).save(ROOT / PICTURES / f"{task}.png", optimize=True)
        print(f"{PICTURES}/{task}.png")
    write_section(ROOT / "README.md", "tasks", table())


if __name__ == "__main__":
    main()
