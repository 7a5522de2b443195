"""Films a trained policy: by default the generalist that comes with the package, which knows all ten tasks.

python examples/watch.py --task PegTransfer
python examples/watch.py --task NeedlePick --policy outputs/quickstart/training
"""

import argparse
from pathlib import Path

import surrol_gym
from gcdt_cli.options import BUILT_IN, checkpoint_of
from lerobot_gcdt.evaluation import load_policy
from lerobot_gcdt.evaluation.pictures import film


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="PegTransfer", choices=surrol_gym.TASKS, metavar="TASK")
    parser.add_argument("--policy", default=BUILT_IN, help="training, folder or repository of a checkpoint")
    parser.add_argument("--episodes", type=int, default=2, help="starts to film (default 2)")
    parser.add_argument("--seed", type=int, default=100_000, help="seed of the first start (default 100000)")
    parser.add_argument("--output", type=Path, help="the film (default outputs/watch/TASK.mp4)")
    options = parser.parse_args()
    try:
        policy = load_policy(checkpoint_of(options.policy))
    except (OSError, ValueError) as error:
        parser.error(f"--policy: {error}")
    output = options.output or Path("outputs/watch") / f"{options.task}.mp4"
    output.parent.mkdir(parents=True, exist_ok=True)
    seeds = range(options.seed, options.seed + options.episodes)
    for seed, held in zip(seeds, film(policy, options.task, seeds, output), strict=True):
        print(f"{options.task}, seed {seed}: {'the goal is held at the end' if held else 'the goal is missed'}")
    print(f"The film is {output}.")


if __name__ == "__main__":
    main()
