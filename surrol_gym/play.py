"""Plays a task by hand: ``python -m surrol_gym.play --task NeedlePick`` opens a window whose keys move the arms."""

import argparse
import sys

import gymnasium as gym
import numpy as np

import surrol_gym
from surrol_gym.by_hand import BeginAgain, Stop, act_out
from surrol_gym.display import check_display
from surrol_gym.envs.psm_env import PSMEnv, unwrapped
from surrol_gym.keyboard import AGAIN, HELP, Hands
from surrol_gym.registry import task_spec


class WindowKeys:
    """A person at the keys of an environment's own window.

    Args:
        task: The environment, in render mode ``"human"``.
    """

    def __init__(self, task: PSMEnv):
        self._task, self._hands = task, Hands(type(task))

    def __call__(self) -> np.ndarray:
        """Returns the action that the pressed keys command.

        Raises:
            BeginAgain: Enter is pressed.
            WindowClosed: The window was closed, as Esc does.
        """
        pressed = self._task.pressed_keys()
        if AGAIN in pressed:
            self._hands.reset()
            raise BeginAgain
        return self._hands.act(pressed)


def play(task: str, seed: int = 0, camera: str = "closeup", episodes: int | None = None) -> list[bool]:
    """Lets a person play episodes of a task, from one seed after the other.

    Args:
        task: Name of the task; see ``surrol_gym.find_task``.
        seed: Seed of the first episode.
        camera: What the window shows at first, one of the task's cameras.
        episodes: How many; None to go on until the window is closed.

    Returns:
        Whether the goal was reached and held, of every episode that was not left.

    Raises:
        ValueError: The task, the seed or the camera is none, or no window can be opened.
    """
    env_id = surrol_gym.find_task(task)
    if seed < 0:
        raise ValueError(f"Seeds count from 0, got {seed}.")
    check_display()
    env = gym.make(env_id, render_mode="human", camera=camera)
    shown = unwrapped(env)
    print(f"{shown.task}: {shown.task_description}\n{HELP}", flush=True)
    outcomes: list[bool] = []
    limit = task_spec(task).max_episode_steps
    try:
        while episodes is None or len(outcomes) < episodes:
            print(f"Seed {seed}: go.", flush=True)
            outcomes.append(act_out(env, seed, WindowKeys(shown)))
            how = "the goal is reached" if outcomes[-1] else "the goal was not reached"
            print(f"Seed {seed}: {how} after {shown.elapsed_steps} steps; the expert has {limit}.", flush=True)
            seed += 1
    except Stop:
        print("Bye.")
    finally:
        env.close()
    return outcomes


def main(arguments: list[str] | None = None) -> None:
    """Runs ``python -m surrol_gym.play``; a bad argument ends with one line and an exit status other than 0."""
    parser = argparse.ArgumentParser(
        prog="python -m surrol_gym.play",
        description="Play a task by hand, in a window.",
        epilog=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--task", default="NeedlePick", help="name of the task, such as NeedlePick (the default)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first episode (default 0)")
    parser.add_argument("--camera", default="closeup", help="closeup (default), overview or, of two arms, both_arms")
    parser.add_argument("--episodes", type=int, help="how many (default: until you press Esc)")
    try:
        play(**vars(parser.parse_args(arguments)))
    except (ValueError, RuntimeError) as error:
        sys.exit(f"python -m surrol_gym.play: {error}")


if __name__ == "__main__":
    main()
