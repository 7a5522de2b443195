"""Draws every task and writes the table of tasks into the README.

    python examples/task_gallery.py

The pictures show the moment at which the expert is half way to its first success.
"""

import argparse
from pathlib import Path

import gymnasium as gym

import surrol_gym
from lerobot_gcdt.evaluation.pictures import halfway
from lerobot_gcdt.hub.documents import write_section

ROOT = Path(__file__).parent.parent
PICTURES = Path("examples/tasks")
WIDTH, HEIGHT = 320, 240


def table():
    """Returns the table of tasks as Markdown."""
    lines = ["| | id | observation, goal, action | steps | the task |", "| --- | --- | --- | --- | --- |"]
    for task in surrol_gym.TASKS:
        env = gym.make(f"surrol/{task}-v0")
        bare = env.unwrapped
        sizes = f"{len(bare.observation_names)}, {len(bare.goal_names)}, {len(bare.action_names)}"
        picture = f"![{task}]({PICTURES.as_posix()}/{task}.png)"
        lines.append(
            f"| {picture} | `surrol/{task}-v0` | {sizes} | {env.spec.max_episode_steps} | {bare.task_description} |"
        )
        env.close()
    return "\n".join(lines) + "\n"


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    (ROOT / PICTURES).mkdir(exist_ok=True)
    for task in surrol_gym.TASKS:
        halfway(task, WIDTH, HEIGHT).save(ROOT / PICTURES / f"{task}.png", optimize=True)
        print(f"{PICTURES}/{task}.png")
    write_section(ROOT / "README.md", "tasks", table())


if __name__ == "__main__":
    main()
