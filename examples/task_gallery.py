"""Draws every task and writes the table of tasks into the README.

    python examples/task_gallery.py

The pictures show the moment at which the expert is half way to its first success.
"""

import argparse
from pathlib import Path

import gymnasium as gym
from PIL import Image

import surrol_gym

ROOT = Path(__file__).parent.parent
PICTURES = Path("examples/tasks")
BEGIN, END = "<!-- tasks: written by examples/task_gallery.py -->\n", "<!-- end of tasks -->\n"
WIDTH, HEIGHT = 320, 240


def halfway(env, seed=0):
    """Plays the expert's episode to the half of its steps to success and returns a picture."""
    expert = surrol_gym.make_expert(env)
    observation, _ = env.reset(seed=seed)
    actions, success = [], False
    while not success:
        actions.append(expert.act(observation))
        observation, _, _, _, info = env.step(actions[-1])
        success = info["is_success"]
    env.reset(seed=seed)
    for action in actions[: len(actions) // 2]:
        env.step(action)
    picture = Image.fromarray(env.unwrapped.picture("closeup", 2 * WIDTH, 2 * HEIGHT))
    return picture.resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)


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
        env = gym.make(f"surrol/{task}-v0")
        halfway(env).save(ROOT / PICTURES / f"{task}.png", optimize=True)
        env.close()
        print(f"{PICTURES}/{task}.png")
    readme = ROOT / "README.md"
    before, rest = readme.read_text().split(BEGIN)
    readme.write_text(before + BEGIN + table() + END + rest.split(END)[1])


if __name__ == "__main__":
    main()
