"""LeRobot's own commands do the whole job: train, resume, fine-tune, evaluate; and refuse bad input clearly.

One training runs as a stranger runs it, as a command of its own. The others call the same entry points in this process,
which saves ten seconds of imports each.
"""

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from lerobot.configs import parser
from lerobot.configs.policies import PreTrainedConfig
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from safetensors.torch import load_file

from lerobot_gcdt import GCDTPolicy
from lerobot_gcdt.environment.policy_input import observation_batch

COMMANDS = Path(sys.executable).parent
STEPS, SAVED = 8, 4

SIZES = ("layers=2", "width=32", "heads=2", "inner_width=64")
TINY = ["--policy.type=gcdt", "--policy.dtype=float32", *(f"--policy.{size}" for size in SIZES)]
ON_CPU = ["--policy.device=cpu", "--policy.push_to_hub=false"]
SHORT = [f"--steps={STEPS}", f"--save_freq={SAVED}", "--batch_size=8", "--num_workers=0", "--log_freq=2"]
TWO_EPISODES = ["--eval.n_episodes=2", "--eval.batch_size=2", "--eval.use_async_envs=false"]


def dataset(root: Path) -> list[str]:
    return [f"--dataset.repo_id=local/{root.name}", f"--dataset.root={root}"]


def environment(*tasks: str) -> list[str]:
    """The simulator, filming small pictures."""
    names = ",".join(f"{task}-v0" for task in tasks)
    return ["--env.type=surrol", f"--env.task={names}", "--env.width=64", "--env.height=64"]


@pytest.fixture(scope="module")
def trained(needle_pick_root, tmp_path_factory):
    """Output folder of a NeedlePick training of eight steps, and what it logged."""
    output = tmp_path_factory.mktemp("trained") / "output"
    arguments = [
        *(*TINY, *ON_CPU, *SHORT, *TWO_EPISODES),
        *(*dataset(needle_pick_root), *environment("NeedlePick")),
        *(f"--env_eval_freq={STEPS}", f"--output_dir={output}"),
    ]
    done = subprocess.run(
        [COMMANDS / "lerobot-train", *arguments], capture_output=True, text=True, errors="replace", timeout=300
    )
    assert done.returncode == 0, done.stderr[-5000:]
    return output, done.stdout + done.stderr


@pytest.fixture(scope="module")
def checkpoint(trained):
    """Folder of the trained model."""
    return trained[0] / "checkpoints" / "last" / "pretrained_model"


@pytest.fixture(scope="module")
def tuned(checkpoint, needle_reach_root, tmp_path_factory, train):
    """Folder of the same model after fine-tuning on another task, NeedleReach."""
    output = tmp_path_factory.mktemp("tuned") / "output"
    train(
        *(f"--policy.path={checkpoint}", *ON_CPU, *dataset(needle_reach_root), "--batch_size=8", "--num_workers=0"),
        *("--steps=2", f"--output_dir={output}"),
    )
    return output / "checkpoints" / "last" / "pretrained_model"


@pytest.fixture
def copy_of_the_checkpoint(checkpoint, tmp_path):
    """A checkpoint that a test may damage."""
    return Path(shutil.copytree(checkpoint, tmp_path / "checkpoint"))


def weights(model: Path) -> dict[str, torch.Tensor]:
    return load_file(model / "model.safetensors")


def in_training(model: Path) -> dict[str, torch.Tensor]:
    """The weights that training goes on with, beside those of the policy that acts."""
    return {key.removeprefix("resting."): value for key, value in weights(model).items() if key.startswith("resting.")}


def assert_equal_weights(a: dict, b: dict):
    assert a.keys() == b.keys()
    for key in a:
        torch.testing.assert_close(a[key], b[key], rtol=0, atol=0, msg=lambda text, key=key: f"{key}: {text}")


# Training.


def test_training_writes_checkpoints_that_lerobot_can_load(trained):
    checkpoints = trained[0] / "checkpoints"
    assert sorted(path.name for path in checkpoints.iterdir()) == [f"{SAVED:06}", f"{STEPS:06}", "last"]
    for model in checkpoints.glob("*/pretrained_model"):
        names = {path.name for path in model.iterdir()}
        assert {"config.json", "model.safetensors", "train_config.json"} <= names
        assert {"policy_preprocessor.json", "policy_postprocessor.json"} <= names
        assert not [name for name in names if Path(name).suffix not in (".json", ".safetensors")]


def test_training_changes_the_weights(trained):
    early, late = (weights(trained[0] / "checkpoints" / f"{step:06}" / "pretrained_model") for step in (SAVED, STEPS))
    changed = {key for key in early if not torch.equal(early[key], late[key])}
    assert any(key.startswith("transformer.") for key in changed)
    assert any("action_head" in key for key in changed)


def test_training_logs_the_loss_of_the_actions(trained):
    assert "action_loss:" in trained[1]


def test_training_evaluates_in_the_simulator(trained):
    assert "pc_success" in trained[1]
    videos = list((trained[0] / "eval").rglob("*.mp4"))
    assert len(videos) == 2
    assert all(video.stat().st_size for video in videos)


def test_the_checkpoint_knows_the_task_of_the_dataset(checkpoint, needle_pick_root):
    meta = LeRobotDataset("local/x", root=needle_pick_root).meta
    config = PreTrainedConfig.from_pretrained(checkpoint)
    [sentence] = meta.tasks.index
    steps = json.loads((needle_pick_root / "meta" / "surrol.json").read_text())["steps_to_success"]
    dims = [meta.features[key]["shape"][0] for key in ("observation.state", "observation.goal", "action")]
    assert config.task_dims == {sentence: dims}
    assert config.expected_steps == {sentence: pytest.approx(np.mean(steps))}


def test_a_resumed_training_ends_with_the_weights_of_an_uninterrupted_one(trained, tmp_path, train):
    output = Path(shutil.copytree(trained[0], tmp_path / "output", symlinks=True))
    shutil.rmtree(output / "checkpoints" / f"{STEPS:06}")
    config = output / "checkpoints" / f"{SAVED:06}" / "pretrained_model" / "train_config.json"
    train(f"--config_path={config}", "--resume=true", f"--output_dir={output}", "--env_eval_freq=0")
    assert_equal_weights(
        weights(output / "checkpoints" / f"{STEPS:06}" / "pretrained_model"),
        weights(trained[0] / "checkpoints" / f"{STEPS:06}" / "pretrained_model"),
    )


def test_a_resumed_training_goes_on_to_more_steps(trained, tmp_path, train):
    output = Path(shutil.copytree(trained[0], tmp_path / "output", symlinks=True))
    config = output / "checkpoints" / "last" / "pretrained_model" / "train_config.json"
    more = STEPS + 2
    train(f"--config_path={config}", "--resume=true", f"--steps={more}", f"--output_dir={output}", "--env_eval_freq=0")
    state = output / "checkpoints" / f"{more:06}" / "training_state"
    assert json.loads((state / "training_step.json").read_text())["step"] == more
    updates = {int(v) for k, v in load_file(state / "optimizer_state.safetensors").items() if k.endswith("step")}
    assert updates == {more}


def test_a_pretraining_that_was_killed_ends_with_the_weights_of_an_uninterrupted_one(uneven_root, tmp_path, train):
    arguments = [
        *(*TINY, *ON_CPU, *dataset(uneven_root), "--policy.training_stage=pretrain"),
        *("--steps=40", "--save_freq=10", "--batch_size=4", "--num_workers=0"),
    ]
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    command = [COMMANDS / "lerobot-train", *arguments, f"--output_dir={killed}"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while process.poll() is None and not (killed / "checkpoints" / "last").exists():
            time.sleep(0.01)
        process.kill()
    assert process.returncode == -signal.SIGKILL
    train(f"--config_path={killed}/checkpoints/last/pretrained_model/train_config.json", "--resume=true")
    parser._config_path_args.clear()
    train(*arguments, f"--output_dir={whole}")
    last = Path("checkpoints") / "000040" / "pretrained_model"
    assert_equal_weights(weights(killed / last), weights(whole / last))


def test_two_processes_train_as_one_with_the_same_batches(needle_pick_root, tmp_path, train):
    # Relabelled trajectories are of different lengths, so one process has more steps to average over than the other.
    arguments = [
        *(*TINY, *ON_CPU, *dataset(needle_pick_root), "--policy.context_length=100"),
        *("--policy.training_stage=pretrain", "--policy.hindsight_ratio=1"),
        *("--steps=5", "--num_workers=0", "--seed=3"),
    ]
    two, one = tmp_path / "two", tmp_path / "one"
    launch = [COMMANDS / "torchrun", "--standalone", "--nproc_per_node=2", "-m", "lerobot.scripts.lerobot_train"]
    done = subprocess.run(
        [*launch, *arguments, "--batch_size=4", f"--output_dir={two}"], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert "4 x 2 = 8" in done.stderr + done.stdout
    train(*arguments, "--batch_size=8", f"--output_dir={one}")
    last = Path("checkpoints") / "last" / "pretrained_model"
    alone, together = weights(one / last), weights(two / last)
    for key, value in alone.items():
        torch.testing.assert_close(together[key], value, rtol=0, atol=1e-5, msg=lambda text, key=key: f"{key}: {text}")


def test_a_held_out_share_of_the_episodes_gives_an_evaluation_loss(needle_pick_root, tmp_path, train, capfd):
    train(
        *(*TINY, *ON_CPU, *dataset(needle_pick_root), "--batch_size=8", "--num_workers=0", "--steps=2"),
        *("--dataset.eval_split=0.25", "--eval_steps=2", f"--output_dir={tmp_path / 'output'}"),
    )
    captured = capfd.readouterr()
    [loss] = re.findall(r"eval_loss=(\S+)", captured.out + captured.err)
    assert 0 < float(loss) < float("inf")


def test_fine_tuning_on_another_task_keeps_the_first(checkpoint, tuned, needle_reach_root):
    before, after = PreTrainedConfig.from_pretrained(checkpoint), PreTrainedConfig.from_pretrained(tuned)
    new = set(LeRobotDataset("local/x", root=needle_reach_root).meta.tasks.index)
    assert set(after.task_dims) == set(before.task_dims) | new
    first = {key: value for key, value in in_training(checkpoint).items() if key.startswith("tasks/")}
    assert first
    assert_equal_weights({key: in_training(tuned)[key] for key in first}, first)


def test_fine_tuning_starts_from_the_checkpoint(checkpoint, needle_pick_root, tmp_path, train):
    train(
        *(f"--policy.path={checkpoint}", *ON_CPU, *dataset(needle_pick_root), "--batch_size=8", "--num_workers=0"),
        *("--steps=1", "--policy.optimizer_lr=1e-30", f"--output_dir={tmp_path / 'output'}"),
    )
    tuned = tmp_path / "output" / "checkpoints" / "last" / "pretrained_model"
    assert weights(tuned)["training_step"] == weights(checkpoint)["training_step"] + 1
    assert_equal_weights(in_training(tuned), in_training(checkpoint))


# Evaluation.


def test_lerobot_eval_writes_the_success_rate(checkpoint, tmp_path, evaluate):
    evaluate(
        *(f"--policy.path={checkpoint}", "--policy.device=cpu", *environment("NeedlePick"), *TWO_EPISODES),
        f"--output_dir={tmp_path / 'eval'}",
    )
    info = json.loads((tmp_path / "eval" / "eval_info.json").read_text())
    assert info["overall"]["n_episodes"] == 2
    assert 0 <= info["overall"]["pc_success"] <= 100


def test_a_policy_of_two_tasks_is_evaluated_in_both(tuned, tmp_path, evaluate):
    evaluate(
        *(f"--policy.path={tuned}", "--policy.device=cpu", *environment("NeedleReach", "NeedlePick"), *TWO_EPISODES),
        f"--output_dir={tmp_path / 'eval'}",
    )
    info = json.loads((tmp_path / "eval" / "eval_info.json").read_text())
    assert [entry["task_group"] for entry in info["per_task"]] == ["NeedleReach-v0", "NeedlePick-v0"]


def test_a_checkpoint_loads_and_acts_in_plain_python(checkpoint):
    policy = GCDTPolicy.from_pretrained(checkpoint)
    env = gym.make("surrol/NeedlePick-v0")
    observation, _ = env.reset(seed=0)
    row = {key: value[None] for key, value in observation.items()}
    batch = observation_batch(policy, row, env.unwrapped.task_description)
    env.close()
    policy.reset()
    first = policy.select_action(batch)
    assert first.shape == (1, *env.action_space.shape)
    assert first.abs().max() <= 1
    policy.reset()
    assert torch.equal(policy.select_action(batch), first)


def test_a_loaded_checkpoint_has_the_saved_weights(checkpoint):
    loaded = GCDTPolicy.from_pretrained(checkpoint).state_dict()
    assert_equal_weights({key: loaded[key] for key in weights(checkpoint)}, weights(checkpoint))


# Bad input: one clear error each.


def errors(raised: pytest.ExceptionInfo) -> str:
    """The message of an error and of what caused it."""
    message, error = "", raised.value
    while error is not None:
        message, error = f"{message}\n{error}", error.__cause__
    return message


def test_evaluating_in_another_task_names_the_tasks_that_the_policy_knows(checkpoint, evaluate, tmp_path):
    known = list(PreTrainedConfig.from_pretrained(checkpoint).task_dims)
    with pytest.raises((KeyError, ValueError)) as raised:
        evaluate(
            *(f"--policy.path={checkpoint}", "--policy.device=cpu", *environment("NeedleReach"), *TWO_EPISODES),
            f"--output_dir={tmp_path / 'eval'}",
        )
    for sentence in known:
        assert sentence in errors(raised)


@pytest.mark.parametrize("task", ["NeedleThread", "needlepick"])
def test_an_unknown_environment_names_the_known_ones(checkpoint, evaluate, tmp_path, task, capsys):
    with pytest.raises((Exception, SystemExit)) as raised:
        evaluate(
            *(f"--policy.path={checkpoint}", "--policy.device=cpu", *environment(task), *TWO_EPISODES),
            f"--output_dir={tmp_path / 'eval'}",
        )
    said = errors(raised) + capsys.readouterr().err
    assert f"{task}-v0" in said and "NeedlePick, PegTransfer" in said
    assert not (tmp_path / "eval").exists()


def test_a_streamed_dataset_is_refused(needle_pick_root, tmp_path, train):
    with pytest.raises((ValueError, FileNotFoundError), match="streaming"):
        train(
            *(*TINY, *ON_CPU, *dataset(needle_pick_root), "--batch_size=8", "--steps=1"),
            *("--num_workers=1", "--dataset.streaming=true", f"--output_dir={tmp_path / 'output'}"),
        )


def small_dataset(root: Path, task: str, sizes: dict[str, int]) -> Path:
    """Writes a dataset of one episode of three zero frames."""
    features = {
        key: {"dtype": "float32", "shape": (size,), "names": [f"{key}_{i}" for i in range(size)]}
        for key, size in sizes.items()
    }
    made = LeRobotDataset.create(f"local/{root.name}", fps=5, features=features, root=root, use_videos=False)
    for _ in range(3):
        made.add_frame({key: np.zeros(size, dtype=np.float32) for key, size in sizes.items()} | {"task": task})
    made.save_episode()
    made.finalize()
    return root


@pytest.mark.parametrize("missing", ["observation.goal", "observation.achieved_goal", "observation.time_to_goal"])
def test_a_dataset_without_goal_keys_names_what_it_lacks(missing, tmp_path, train):
    sizes = {
        "observation.state": 7,
        "observation.goal": 3,
        "observation.achieved_goal": 3,
        "observation.time_to_goal": 1,
        "action": 5,
    }
    del sizes[missing]
    root = small_dataset(tmp_path / "goalless", "Reach.", sizes)
    with pytest.raises((KeyError, ValueError), match=f"goalless lacks {missing};"):
        train(
            *(*TINY, *ON_CPU, *dataset(root), "--batch_size=2", "--num_workers=0", "--steps=1"),
            f"--output_dir={tmp_path / 'output'}",
        )


def test_a_dataset_of_other_dimensions_for_a_known_task_names_both(checkpoint, tmp_path, train):
    [(sentence, dims)] = PreTrainedConfig.from_pretrained(checkpoint).task_dims.items()
    sizes = {
        "observation.state": dims[0] - 4,
        "observation.goal": dims[1],
        "observation.achieved_goal": dims[1],
        "observation.time_to_goal": 1,
        "action": dims[2],
    }
    root = small_dataset(tmp_path / "other", sentence, sizes)
    with pytest.raises(ValueError) as raised:
        train(
            *(f"--policy.path={checkpoint}", *ON_CPU, *dataset(root), "--batch_size=2", "--num_workers=0"),
            *("--steps=1", f"--output_dir={tmp_path / 'output'}"),
        )
    assert sentence in str(raised.value)
    assert str(dims) in str(raised.value) and str([dims[0] - 4, *dims[1:]]) in str(raised.value)


def change_config(model: Path, **values):
    file = model / "config.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | values))


@pytest.mark.parametrize(
    "values",
    [{"width": 64}, {"inner_width": 32}, {"max_timesteps": 50}, {"layers": 3}, {"layers": 1}],
    ids=["wider", "narrower inside", "fewer timesteps", "a layer more", "a layer less"],
)
def test_weights_that_do_not_fit_their_configuration_are_refused(copy_of_the_checkpoint, values):
    change_config(copy_of_the_checkpoint, **values)
    with pytest.raises(ValueError, match="do not fit"):
        GCDTPolicy.from_pretrained(copy_of_the_checkpoint)


def test_weights_of_other_task_dimensions_are_refused(copy_of_the_checkpoint):
    [(sentence, dims)] = PreTrainedConfig.from_pretrained(copy_of_the_checkpoint).task_dims.items()
    change_config(copy_of_the_checkpoint, task_dims={sentence: [dims[0] + 1, *dims[1:]]})
    with pytest.raises(ValueError, match="do not fit"):
        GCDTPolicy.from_pretrained(copy_of_the_checkpoint)


def test_an_existing_output_folder_is_not_overwritten(trained, needle_pick_root, train):
    output = trained[0]
    before = {path: path.stat().st_mtime_ns for path in output.rglob("*")}
    with pytest.raises(FileExistsError):
        train(*(*TINY, *ON_CPU, *SHORT, *dataset(needle_pick_root), f"--output_dir={output}"))
    assert {path: path.stat().st_mtime_ns for path in output.rglob("*")} == before
