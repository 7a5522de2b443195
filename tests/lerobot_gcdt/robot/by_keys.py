"""Runs commands of LeRobot's and ours, unmodified, while keys are pressed: ``by_keys.py FOLDER`` says what came of it.

All in one process, because loading LeRobot takes longer than all of it.
"""

import json
import sys
import threading
import time
from pathlib import Path

import gymnasium as gym
from lerobot.scripts import lerobot_record, lerobot_teleoperate
from person import Person, Watched, xdotool

import gcdt_cli
from lerobot_gcdt.robot.surrol_psm import SurRoLPSM

FOLDER = Path(sys.argv[1])
ROBOT = ("--robot.type=surrol_psm", "--robot.task=NeedlePick", "--robot.seed=3")
KEYBOARD = ("--teleop.type=psm_keyboard", "--teleop.task=NeedlePick")


def run(main, *arguments):
    sys.argv = [main.__module__, *arguments]
    main()


def at_start(*keys):
    """Holds keys down for a second as soon as the robot has taken its first steps; gives what it observed at last."""
    seen, send = [], SurRoLPSM.send_action

    def watched(robot, action):
        sent = send(robot, action)
        seen.append(robot.get_observation())
        return sent

    def press():
        while len(seen) < 2:
            time.sleep(0.02)
        xdotool("keydown", keys)
        time.sleep(1.0)
        xdotool("keyup", keys[::-1])

    SurRoLPSM.send_action = watched
    threading.Thread(target=press, daemon=True).start()
    return seen


def moved(seen):
    return {name: seen[-1][name] - seen[0][name] for name in seen[0] if name.startswith("psm1_")}


told = {}
teleoperate = (lerobot_teleoperate.main, *ROBOT, "--fps=5", "--teleop_time_s=2.5")
original = SurRoLPSM.send_action

seen = at_start("s", "q", "v")
run(*teleoperate, *KEYBOARD)
told["psm_keyboard"] = moved(seen)
SurRoLPSM.send_action = original

seen = at_start("Down", "Left", "Control_R")
run(*teleoperate, "--teleop.type=keyboard_ee")
told["keyboard_ee"] = moved(seen)
SurRoLPSM.send_action = original

at_start("s", "d")
run(
    *(lerobot_record.main, *ROBOT, *KEYBOARD, "--dataset.repo_id=local/by_hand", "--dataset.fps=5"),
    *(f"--dataset.root={FOLDER / 'by_hand'}", "--dataset.single_task=Pick up the needle.", "--dataset.num_episodes=1"),
    *("--dataset.episode_time_s=2", "--dataset.push_to_hub=false", "--play_sounds=false"),
)
SurRoLPSM.send_action = original


def make(*arguments, make=gym.make, **options):
    env = Watched(make(*arguments, **options))
    Person(env).start()
    return env


gym.make = make
gcdt_cli.main(
    ["record", "--teleop", "keyboard", "--task", "NeedlePick", "--episodes", "1", "--seed", "3", "--root"]
    + [str(FOLDER / "human")]
)
(FOLDER / "told.json").write_text(json.dumps(told))
