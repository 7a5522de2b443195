"""The task of ``examples/new_task.py``: recorded, trained, evaluated and described by the ordinary commands."""

import json
from pathlib import Path

import gymnasium as gym
import pytest

import gcdt_cli
import surrol_gym
from lerobot_gcdt.environment.surrol_env import SurRoLEnvConfig
from lerobot_gcdt.evaluation import evaluate, load_policy
from lerobot_gcdt.hub.cards import dataset_card
from lerobot_gcdt.hub.checks import check_dataset
from lerobot_gcdt.hub.model_card import model_card
from lerobot_gcdt.recording import record
from surrol_gym import registry

EXAMPLE = Path(__file__).parents[2] / "examples/new_task.py"
TASK, ENV_ID, SENTENCE = "new_task:PushBlock", "new_task:surrol/PushBlock-v0", "Push the block to the goal."


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """Folder of a dataset of two episodes."""
    root = tmp_path_factory.mktemp("new_task") / "push_block"
    gcdt_cli.main(["record", "--task", TASK, "--episodes", "2", "--root", str(root)])
    return root


@pytest.fixture(scope="module")
def checkpoint(root, train):
    """A model that was trained for two steps."""
    sizes = ("layers=2", "width=32", "heads=2", "inner_width=64", "dtype=float32", "device=cpu", "push_to_hub=false")
    output = root.with_name("training")
    train(
        "--policy.type=gcdt",
        *(f"--policy.{size}" for size in sizes),
        *("--dataset.repo_id=local/push_block", f"--dataset.root={root}", f"--output_dir={output}"),
        *("--steps=2", "--batch_size=2", "--num_workers=0"),
    )
    return output / "checkpoints/last/pretrained_model"


def test_a_recording_keeps_what_finds_its_environment_again(root):
    facts = json.loads((root / "meta/surrol.json").read_text())
    assert facts["env_id"] == ENV_ID
    assert gym.make(facts["env_id"]).unwrapped.task_description == SENTENCE
    check_dataset(root)


def test_its_card_names_every_number_and_the_command(root):
    card = dataset_card(root)
    assert f"gcdt record --task {TASK} --episodes 2 " in card
    assert "| 7 | `block_x` | centre of the block | su |" in card
    assert "has to push it to the goal" in card


def test_a_policy_learns_it_and_is_evaluated(checkpoint):
    episodes = evaluate(load_policy(checkpoint), [TASK], [100])
    assert (episodes.task.tolist(), episodes.seed.tolist()) == (["PushBlock"], [100])
    assert f'* {TASK}: "{SENTENCE}"' in model_card(checkpoint)
    assert f"--env.task={TASK}-v0 " in model_card(checkpoint)


def test_lerobots_own_evaluation_finds_it(checkpoint, request, tmp_path):
    request.getfixturevalue("evaluate")(
        f"--policy.path={checkpoint}",
        *("--policy.device=cpu", "--env.type=surrol", f"--env.task={TASK}-v0", "--env.width=64", "--env.height=64"),
        *("--eval.n_episodes=1", "--eval.batch_size=1", "--eval.use_async_envs=false", f"--output_dir={tmp_path}"),
    )
    assert json.loads((tmp_path / "eval_info.json").read_text())["overall"]["n_episodes"] == 1


def test_the_environment_type_knows_its_sizes():
    config = SurRoLEnvConfig(task=f"{TASK}-v0")
    assert config.features["observation.state"].shape == (10,)
    assert (config.package_name, config.gym_id) == ("new_task", "surrol/PushBlock-v0")
    [(name, envs)] = config.create_envs(1).items()
    assert name == "PushBlock-v0"
    envs[0].close()


@pytest.fixture
def no_expert(root, monkeypatch):
    """Lets the task have no expert."""
    monkeypatch.setitem(registry._laws, "new_task:PushBlockEnv", None)


def test_without_an_expert_nothing_is_recorded_and_it_is_told(no_expert, tmp_path):
    with pytest.raises(SystemExit, match="PushBlock-v0 has no scripted expert; register it .* --teleop"):
        gcdt_cli.main(["record", "--task", TASK, "--root", str(tmp_path / "push_block")])
    assert not list(tmp_path.iterdir())


def test_without_an_expert_a_dataset_is_published_with_a_picture_of_the_start(no_expert, root, capsys):
    gcdt_cli.main(["publish", str(root), "--repo_id", "me/push_block", "--dry_run"])
    assert "pictures/PushBlock.png" in capsys.readouterr().out
    assert "![PushBlock at the start](pictures/PushBlock.png)" in dataset_card(root)


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package that registers the task of one of its modules; gone after the test."""
    source = EXAMPLE.read_text().replace("PushBlock", "NudgeBlock")
    source, _, _ = source.rpartition("surrol_gym.register_task")
    folder = tmp_path / "my_tasks"
    folder.mkdir()
    (folder / "nudge_block.py").write_text(source)
    place = "my_tasks.nudge_block"
    registration = f"surrol_gym.register_task('{place}:NudgeBlockEnv', 50, '{place}:law')"
    (folder / "__init__.py").write_text(f"import surrol_gym\n\n{registration}\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "_ids", [*registry._ids])
    yield "my_tasks"
    del gym.registry["surrol/NudgeBlock-v0"]


def test_the_task_may_lie_in_a_package_of_its_own(package, tmp_path):
    root = record(f"{package}:NudgeBlock", 1, 0, tmp_path / "nudge_block")
    assert json.loads((root / "meta/surrol.json").read_text())["env_id"] == "my_tasks:surrol/NudgeBlock-v0"
    assert f"gcdt record --task {package}:NudgeBlock " in dataset_card(root)
    assert surrol_gym.registered_tasks()[-1] == "NudgeBlock"


def test_a_recording_of_a_task_that_is_not_found_says_how_to_name_its_module(root, tmp_path):
    note = tmp_path / "meta/surrol.json"
    note.parent.mkdir()
    note.write_text((root / "meta/surrol.json").read_text().replace("new_task:surrol/PushBlock", "surrol/DragBlock"))
    (tmp_path / "meta/stats.json").write_text("{}")
    with pytest.raises(ValueError, match="'surrol/DragBlock-v0'.*my_module:MyTask"):
        dataset_card(tmp_path)
