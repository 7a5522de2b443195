"""Trains GCDT on everything, each stage from the one before it:

    pretrain           all ten tasks, all four objectives
    generalist         all ten tasks, actions only
    NeedleReach, ...   one task, actions only

Every stage goes on where it was interrupted and is skipped when it is complete, so any part can be run on any machine:

    python examples/train_all.py --datasets datasets --output outputs/all --device cuda
    python examples/train_all.py --datasets datasets --output outputs/all --stages NeedlePick,PegTransfer

`gcdt train` runs a single stage, with other settings, or another policy; `gcdt evaluate` evaluates what was trained.
"""

import argparse
import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # see examples/quickstart.py

import surrol_gym
from lerobot_gcdt.recording.collection import CROSS_TASK, dataset_name
from lerobot_gcdt.training import train

STARTS = {"pretrain": None, "generalist": "pretrain"} | dict.fromkeys(surrol_gym.TASKS, "generalist")
"""The stages in their order, each with the one that it begins with."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--datasets", type=Path, default=Path("datasets"), help="folder of the datasets")
    parser.add_argument("--output", type=Path, default=Path("outputs/all"), help="folder of the trainings")
    parser.add_argument("--stages", default=",".join(STARTS), help="what to train, separated by commas")
    parser.add_argument("--device", help="where to train, such as cuda")
    parser.add_argument("--launcher", help='for several GPUs: "accelerate launch --multi_gpu --num_processes=4 -m"')
    options = parser.parse_args()
    stages = options.stages.split(",")
    if unknown := set(stages) - set(STARTS):
        parser.error(f"unknown stages {sorted(unknown)}; choose from {', '.join(STARTS)}")
    datasets = {stage: CROSS_TASK if stage not in surrol_gym.TASKS else dataset_name(stage) for stage in stages}
    if missing := sorted(name for name in set(datasets.values()) if not (options.datasets / name).exists()):
        parser.error(f"there is no {', '.join(missing)}; `gcdt record --all --root {options.datasets}` records them")
    for stage in (stage for stage in STARTS if stage in stages):
        kind = stage if stage in ("pretrain", "generalist") else "finetune"
        start = STARTS[stage] and options.output / STARTS[stage]
        data, output = options.datasets / datasets[stage], options.output / stage
        try:
            train(data, output, None, kind, start, device=options.device, launcher=options.launcher)
        except (ValueError, OSError, RuntimeError) as error:
            sys.exit(f"{stage}: {error}")


if __name__ == "__main__":
    main()
