"""What a stranger does with the Hub, in a process of its own: LeRobot reads its environment when it is imported.

python hub_chain.py online DATASET OUTPUT PORT  # publish, load, train, evaluate; the server listens at PORT
python hub_chain.py offline OUTPUT              # load, train and evaluate once more, from the cache
"""

import json
import sys
from pathlib import Path

import huggingface_hub
import torch
from hub_server import client
from lerobot.configs import parser
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.scripts import lerobot_eval, lerobot_train
from safetensors.torch import load_file

import gcdt_cli as cli
from lerobot_gcdt import GCDTPolicy
from lerobot_gcdt.averaging import without_resting
from lerobot_gcdt.training import checkpoint

DATASET, POLICY, FRAMES = "me/needle_reach", "me/gcdt_reach", 200

TINY = ["--policy.type=gcdt", *(f"--policy.{name}" for name in ("layers=2", "width=32", "heads=2", "inner_width=64"))]
SHORT = ["--policy.device=cpu", "--steps=2", "--batch_size=4", "--num_workers=0", "--env_eval_freq=0"]
# Without a revision, LeRobot asks the Hub for its version tags, even where everything is in the cache.
FROM_MAIN = [f"--dataset.repo_id={DATASET}", "--dataset.revision=main"]


def online(dataset: Path, output: Path) -> None:
    cli.main(["publish", str(dataset), "--repo_id", DATASET])
    assert LeRobotDataset(DATASET, video_backend="pyav").num_frames == FRAMES

    push = ["--policy.push_to_hub=true", f"--policy.repo_id={POLICY}"]
    run(lerobot_train, *TINY, *SHORT, *FROM_MAIN, *push, f"--output_dir={output / 'trained'}")
    cli.main(["publish", str(output / "trained"), "--repo_id", POLICY, "--revision_tag", "v1.0"])
    tuned = [f"--policy.path={POLICY}", *push, f"--output_dir={output / 'tuned'}"]
    run(lerobot_train, *SHORT, *FROM_MAIN, *tuned)

    assert evaluated(output / "evaluated")
    assert is_loaded(output / "trained", revision="v1.0")
    assert is_loaded(output / "tuned") and not is_loaded(output / "trained")


def offline(output: Path) -> None:
    assert LeRobotDataset(DATASET, revision="main", video_backend="pyav").num_frames == FRAMES
    assert is_loaded(output / "trained", revision="v1.0")
    assert is_loaded(output / "tuned")
    assert evaluated(output / "evaluated_offline")
    tuned = [f"--policy.path={POLICY}", "--policy.push_to_hub=false", f"--output_dir={output / 'tuned_offline'}"]
    run(lerobot_train, *SHORT, *FROM_MAIN, *tuned)


def run(command, *arguments) -> None:
    """Runs one of LeRobot's commands in this process."""
    sys.argv = [command.__name__, *arguments]
    parser._config_path_args.clear()
    parser._config_yaml_overrides.clear()
    command.main()


def evaluated(output: Path) -> bool:
    """Whether `lerobot-eval` runs the published policy."""
    episodes = ["--eval.n_episodes=2", "--eval.batch_size=2", "--eval.use_async_envs=false"]
    env = ["--env.type=surrol", "--env.task=NeedleReach-v0", "--env.width=64", "--env.height=64"]
    policy = [f"--policy.path={POLICY}", "--policy.device=cpu"]
    run(lerobot_eval, *policy, *env, *episodes, f"--output_dir={output}")
    return json.loads((output / "eval_info.json").read_text())["overall"]["n_episodes"] == 2


def is_loaded(training: Path, **options) -> bool:
    """Whether loading the published policy gives what a training acts with."""
    loaded = GCDTPolicy.from_pretrained(POLICY, **options).state_dict()
    saved = load_file(checkpoint(training) / "model.safetensors")
    return all(torch.equal(loaded[key], saved[key]) for key in without_resting(saved))


if __name__ == "__main__":
    if sys.argv[1] == "online":
        port = int(sys.argv[4])
        huggingface_hub.set_client_factory(lambda: client(port))
        online(Path(sys.argv[2]), Path(sys.argv[3]))
    else:
        offline(Path(sys.argv[2]))
