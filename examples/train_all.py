"""Trains GCDT on everything: cross-task pretraining on all ten tasks, then fine-tuning on each.

Needs the ten datasets (`gcdt record --all --root datasets`), but no simulator. Every stage goes on where it was
interrupted and is skipped when it is complete, so any part can be run on any machine:

    python examples/train_all.py --datasets datasets --output outputs/all --device cuda
    python examples/train_all.py --datasets datasets --output outputs/all --stages NeedlePick,PegTransfer
    python examples/train_all.py --datasets datasets --output outputs/bc --stages PegTransfer --scratch bc

Several GPUs: `--launcher "accelerate launch --multi_gpu --num_processes=4 -m"`.
"""

import argparse
import shlex
import subprocess
import sys
from pathlib import Path

import surrol_gym
from lerobot_gcdt.collection import CROSS_TASK
from lerobot_gcdt.merging import merge
from lerobot_gcdt.recording import dataset_name
from lerobot_gcdt.training import arguments_to_reach, checkpoint


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--datasets", type=Path, default=Path("datasets"), help="folder of the ten datasets")
    parser.add_argument("--output", type=Path, default=Path("outputs/all"), help="folder of the trainings")
    parser.add_argument(
        "--stages", default=",".join(["pretrain", *surrol_gym.TASKS]), help="what to train, separated by commas"
    )
    parser.add_argument(
        "--scratch", choices=["gcdt", "bc"], help="train tasks from random weights, with this type of policy"
    )
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--pretrain_steps", type=int, default=20_000)
    parser.add_argument("--finetune_steps", type=int, default=1_000)
    parser.add_argument("--save_freq", type=int, default=500)
    parser.add_argument("--launcher", default=f"{shlex.quote(sys.executable)} -m", help="command that runs a module")
    parser.add_argument("options", nargs="*", help="more arguments of lerobot-train, after --")
    options = parser.parse_args()
    stages = options.stages.split(",")
    unknown = set(stages) - {"pretrain", *surrol_gym.TASKS}
    if unknown:
        parser.error(f"unknown stages {sorted(unknown)}; choose from pretrain, {', '.join(surrol_gym.TASKS)}")
    used = surrol_gym.TASKS if "pretrain" in stages else stages
    needed = [name for name in map(dataset_name, used) if not (options.datasets / name).exists()]
    if needed:
        command = f"gcdt record --all --root {options.datasets}"
        parser.error(f"{options.datasets} lacks {', '.join(needed)}; record them with `{command}`")
    pretrained = options.output / "pretrain"
    if not options.scratch and "pretrain" not in stages and not checkpoint(pretrained).exists():
        parser.error(f"there is no checkpoint in {pretrained}; add the stage pretrain, or pass --scratch gcdt")

    if "pretrain" in stages:
        merged = options.datasets / CROSS_TASK
        if not merged.exists():
            merge([options.datasets / dataset_name(task) for task in surrol_gym.TASKS], merged)
        begin = ["--policy.type=gcdt", "--policy.training_stage=pretrain", *on(merged)]
        train(options, pretrained, options.pretrain_steps, begin)
    for task in surrol_gym.TASKS:
        if task in stages:
            if options.scratch:
                start = [f"--policy.type={options.scratch}"]
            else:
                start = [f"--policy.path={checkpoint(pretrained)}", "--policy.training_stage=finetune"]
                start.append("--policy.optimizer_lr=5e-4")  # the full rate would undo what is learned
            begin = [*start, *on(options.datasets / dataset_name(task))]
            train(options, options.output / task, options.finetune_steps, begin)


def on(dataset: Path) -> list[str]:
    """Arguments that name a dataset."""
    return [f"--dataset.repo_id=local/{dataset.name}", f"--dataset.root={dataset}"]


def train(options: argparse.Namespace, output: Path, steps: int, begin: list[str]):
    """Runs `lerobot-train` to the last step of one training."""
    common = [
        "--policy.push_to_hub=false",
        f"--policy.device={options.device}",
        f"--save_freq={options.save_freq}",
        "--log_freq=100",
        "--batch_size=4",
        "--num_workers=0",
        *options.options,
    ]
    arguments = arguments_to_reach(steps, output, [*begin, *common])
    if arguments is None:
        print(f"{output} is complete already.")
        return
    command = [*shlex.split(options.launcher), "lerobot.scripts.lerobot_train", *arguments]
    print(shlex.join(command), flush=True)
    subprocess.run(command, check=True)


if __name__ == "__main__":
    main()
