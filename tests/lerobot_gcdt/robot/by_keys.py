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
from person import Keys, Person, Watched

import gcdt_cli
from lerobot_gcdt.robot.surrol_psm import SurRoLPSM

FOLDER = Path(sys.argv[1])
ROBOT = ("--robot.type=surrol_psm", "--robot.task=NeedlePick", "--robot.seed=3")
SEND, KEYS = SurRoLPSM.send_action, Keys()
KEYBOARD = ("--teleop.type=psm_keyboard", "--teleop.task=NeedlePick")


def run(main, *arguments):
    sys.argv = [main.__module__, *arguments]
    main()


def move(*keys, by, then):
    """Holds keys down until the robot's x has grown by some su, and then calls ``then``; gives what the robot observed.

    Nothing here waits for a time or counts steps, so it does not matter how late keys are heard on a busy machine.
    """
    seen, ended = [], threading.Event()

    def watched(robot, action):
        sent = SEND(robot, action)
        seen.append(robot.get_observation())
        if ended.is_set():
            raise KeyboardInterrupt  # by which a person ends lerobot-teleoperate
        return sent

    def after(steps):
        end = len(seen) + steps
        while len(seen) < end:
            time.sleep(0.01)

    def press():
        after(2)
        KEYS.hold(keys, lambda: moved(seen)["psm1_x.pos"] > by)
        after(2)
        then(ended)

    SurRoLPSM.send_action = watched
    threading.Thread(target=press, daemon=True).start()
    return seen


def moved(seen):
    return {name: seen[-1][name] - seen[0][name] for name in seen[0] if name.startswith("psm1_")}


told = {}
seen = move("s", "q", "v", by=0.08, then=threading.Event.set)
run(lerobot_teleoperate.main, *ROBOT, "--fps=5", *KEYBOARD)
told["psm_keyboard"] = moved(seen)

seen = move("Down", "Left", "Control_R", by=0.04, then=threading.Event.set)
run(lerobot_teleoperate.main, *ROBOT, "--fps=5", "--teleop.type=keyboard_ee")
told["keyboard_ee"] = moved(seen)

move("s", "d", by=0.08, then=lambda _: KEYS.tap("Right"))  # by which a person ends an episode of lerobot-record
run(
    *(lerobot_record.main, *ROBOT, *KEYBOARD, "--dataset.repo_id=local/by_hand", "--dataset.fps=5"),
    *(f"--dataset.root={FOLDER / 'by_hand'}", "--dataset.single_task=Pick up the needle.", "--dataset.num_episodes=1"),
    *("--dataset.episode_time_s=300", "--dataset.push_to_hub=false", "--play_sounds=false"),
)


def make(*arguments, make=gym.make, **options):
    env = Watched(make(*arguments, **options))
    Person(env).start()
    return env


gym.make = make
gcdt_cli.main(
    ["record", "--teleop", "keyboard", "--task", "NeedlePick", "--episodes", "1", "--seed", "15", "--root"]
    + [str(FOLDER / "human")]
)
(FOLDER / "told.json").write_text(json.dumps(told))
