"""Trains GCDT on everything, each stage from the one before it:

    pretrain           all ten tasks, all four objectives
    generalist         all ten tasks, actions only
    NeedleReach, ...   one task, actions only

Needs the ten datasets (`gcdt record --all --root datasets`), but no simulator. Every stage goes on where it was
interrupted and is skipped when it is complete, so any part can be run on any machine:

    python examples/train_all.py --datasets datasets --output outputs/all --device cuda
    python examples/train_all.py --datasets datasets --output outputs/all --stages NeedlePick,PegTransfer
    python examples/train_all.py --datasets datasets --output outputs/bc --stages PegTransfer --scratch bc

Several GPUs: `--launcher "accelerate launch --multi_gpu --num_processes=4 -m"`.
"""

import argparse
import os
import shlex
import subprocess
import sys
from pathlib import Path

import surrol_gym
from lerobot_gcdt.recording import merge
from lerobot_gcdt.recording.collection import CROSS_TASK
from lerobot_gcdt.recording.demonstrations import dataset_name
from lerobot_gcdt.training import arguments_to_reach, checkpoint

SHARED = ("pretrain", "generalist")
STAGES = (*SHARED, *surrol_gym.TASKS)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--datasets", type=Path, default=Path("datasets"), help="folder of the ten datasets")
    parser.add_argument("--output", type=Path, default=Path("outputs/all"), help="folder of the trainings")
    parser.add_argument("--stages", default=",".join(STAGES), help="what to train, separated by commas")
    parser.add_argument(
        "--scratch", choices=["gcdt", "bc"], help="train each stage from random weights, with this type of policy"
    )
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--pretrain_steps", type=int, default=20_000)
    parser.add_argument(
        "--generalist_steps", type=int, default=30_000, help="0 leaves the stage out, as the paper does"
    )
    parser.add_argument(
        "--finetune_steps", type=int, help="steps on one task, from scratch too (default 2000, of bc 15000)"
    )
    parser.add_argument("--save_freq", type=int, default=500)
    parser.add_argument("--launcher", default=f"{shlex.quote(sys.executable)} -m", help="command that runs a module")
    parser.add_argument("options", nargs="*", help="more arguments of lerobot-train, after --")
    options = parser.parse_args()
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # of the trainings; see examples/quickstart.py
    stages = options.stages.split(",")
    unknown = set(stages) - set(STAGES)
    if unknown:
        parser.error(f"unknown stages {sorted(unknown)}; choose from {', '.join(STAGES)}")
    shared = [stage for stage in SHARED if stage in stages]
    if shared and options.scratch == "bc":
        parser.error(f"bc learns one task; leave {', '.join(shared)} out of --stages")
    used = surrol_gym.TASKS if shared else stages
    needed = [name for name in map(dataset_name, used) if not (options.datasets / name).exists()]
    if needed:
        command = f"gcdt record --all --root {options.datasets}"
        parser.error(f"{options.datasets} lacks {', '.join(needed)}; record them with `{command}`")
    if options.generalist_steps == 0:
        stages = [stage for stage in stages if stage != "generalist"]
    for stage in stages:
        start = start_of(options, stage)
        if start and start.name not in stages and not checkpoint(start).exists():
            parser.error(
                f"{stage} starts from the stage {start.name}, but there is no checkpoint in {start}; add {start.name} "
                "to the stages, or pass --scratch gcdt"
            )
    for stage in STAGES:
        if stage in stages:
            train(options, stage)


def start_of(options: argparse.Namespace, stage: str) -> Path | None:
    """Returns the training whose last checkpoint a stage begins with, None for random weights."""
    if options.scratch or stage == "pretrain":
        return None
    return options.output / ("pretrain" if stage == "generalist" or options.generalist_steps == 0 else "generalist")


def train(options: argparse.Namespace, stage: str):
    """Runs `lerobot-train` to the last step of one stage."""
    dataset = options.datasets / (CROSS_TASK if stage in SHARED else dataset_name(stage))
    if stage in SHARED and not dataset.exists():
        merge([options.datasets / dataset_name(task) for task in surrol_gym.TASKS], dataset)
    start = start_of(options, stage)
    if start is None:
        begin = [f"--policy.type={options.scratch or 'gcdt'}"]
    else:
        begin = [f"--policy.path={checkpoint(start)}", "--policy.training_stage=finetune"]
        if stage not in SHARED:
            begin.append("--policy.optimizer_lr=5e-4")  # the full rate would undo what is learned
    if stage == "pretrain":
        begin.append("--policy.training_stage=pretrain")
    begin += [
        f"--dataset.repo_id=local/{dataset.name}",
        f"--dataset.root={dataset}",
        "--policy.push_to_hub=false",
        f"--policy.device={options.device}",
        f"--save_freq={options.save_freq}",
        "--log_freq=100",
        f"--batch_size={8 if stage == 'generalist' or options.scratch == 'bc' else 4}",
        "--num_workers=0",
        *options.options,
    ]
    steps = {"pretrain": options.pretrain_steps, "generalist": options.generalist_steps}
    on_one_task = options.finetune_steps or (15_000 if options.scratch == "bc" else 2_000)
    output = options.output / stage
    arguments = arguments_to_reach(steps.get(stage, on_one_task), output, begin)
    if arguments is None:
        print(f"{output} is complete already.")
        return
    command = [*shlex.split(options.launcher), "lerobot.scripts.lerobot_train", *arguments]
    print(shlex.join(command), flush=True)
    subprocess.run(command, check=True)


if __name__ == "__main__":
    main()
