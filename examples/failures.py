"""Shows what a policy still does wrong: films and strips of pictures of episodes that did not hold their goal.

    python examples/failures.py
    python examples/failures.py outputs/needle_pick --tasks NeedlePick --starts 200

Without a policy it is the built-in generalist. Starts are those that nothing is reported on, from seed 20000 on.
"""

import argparse
from pathlib import Path

from lerobot_gcdt import GENERALIST
from lerobot_gcdt.evaluation import evaluate, load_policy
from lerobot_gcdt.evaluation.pictures import film, plot_goals, strips
from lerobot_gcdt.evaluation.tasks import tasks_of
from lerobot_gcdt.training import checkpoint


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", nargs="?", default=str(GENERALIST), help="training, or folder of a checkpoint")
    parser.add_argument("--tasks", help="names, separated by commas (default: all that the policy knows)")
    parser.add_argument("--starts", type=int, default=100, help="episodes to run of each task (default 100)")
    parser.add_argument("--show", type=int, default=3, help="failures of each task to show, at most (default 3)")
    parser.add_argument("--output", type=Path, default=Path("outputs/failures"), help="folder of the pictures")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    folder = checkpoint(options.policy)
    policy = load_policy(folder)
    seeds = range(20_000, 20_000 + options.starts)
    for task in tasks_of(folder, options.tasks and options.tasks.split(",")):
        # One by one, because in larger batches numbers are rounded otherwise, and what is filmed might end otherwise.
        episodes = evaluate(policy, [task], seeds, batch_size=1)
        failed = episodes[~episodes.held]
        reached = failed.reached.sum()
        print(f"{task}: {len(failed)} of {len(episodes)} failed, {reached} of these after they had reached the goal.")
        shown = failed.seed.head(options.show).to_list()
        if shown:
            plot_goals(episodes, options.output / f"{task}_goals.png")
            strips(policy, task, shown, options.output / f"{task}.png")
            film(policy, task, shown, options.output / f"{task}.mp4")
    print(f"Pictures and films are in {options.output}.")


if __name__ == "__main__":
    main()
