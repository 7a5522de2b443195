"""LeRobot finds the plugin without flags; the simulator stands without LeRobot, and the policies without PyBullet."""

import json
import subprocess
import sys
from importlib.metadata import distributions, packages_distributions

import pytest

import lerobot_gcdt
import surrol_gym


def run(code: str) -> dict:
    """Runs code in a new interpreter; it prints JSON in its last line."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def discovered():
    """What LeRobot knows after it looked for plugins, in a process that imported nothing of ours."""
    return run("""
import json, sys
from lerobot.configs.policies import PreTrainedConfig
from lerobot.envs.configs import EnvConfig
from lerobot.robots import RobotConfig
from lerobot.teleoperators import TeleoperatorConfig
from lerobot.utils.import_utils import register_third_party_plugins
before = "gcdt" in PreTrainedConfig.get_known_choices() or "surrol" in EnvConfig.get_known_choices()
register_third_party_plugins()
from lerobot.policies.factory import get_policy_class
import gymnasium
print(json.dumps({
    "before": before,
    "policy": PreTrainedConfig.get_choice_class("gcdt").__name__,
    "class": get_policy_class("gcdt").__name__,
    "env": EnvConfig.get_choice_class("surrol").__name__,
    "robots": sorted({"surrol_psm", "dvrk_psm"} & set(RobotConfig.get_known_choices())),
    "keyboard": "psm_keyboard" in TeleoperatorConfig.get_known_choices(),
    "simulated": "pybullet" in sys.modules,
    "ids": [spec for spec in gymnasium.registry if spec.startswith("surrol/")],
}))
""")


def test_nothing_is_known_before_the_search(discovered):
    assert discovered["before"] is False


def test_the_policy_type_is_found(discovered):
    assert discovered["policy"] == "GCDTConfig"
    assert discovered["class"] == "GCDTPolicy"


def test_the_environment_type_is_found(discovered):
    assert discovered["env"] == "SurRoLEnvConfig"


def test_the_robot_types_and_their_keyboard_are_found(discovered):
    assert discovered["robots"] == ["dvrk_psm", "surrol_psm"]
    assert discovered["keyboard"] is True


def test_nothing_of_this_loads_the_simulation(discovered):
    assert discovered["simulated"] is False


def test_the_environment_ids_are_registered_with_it(discovered):
    assert discovered["ids"] == [f"surrol/{task}-v0" for task in surrol_gym.TASKS]


def test_the_raw_name_of_the_distribution_is_the_one_lerobot_looks_for():
    names = {d.metadata["Name"] for d in distributions()}
    ours = {name for name in packages_distributions()["lerobot_gcdt"] if name in names}
    assert ours
    assert all(name.startswith("lerobot_policy_") for name in ours)


def test_the_module_named_like_the_distribution_exports_what_the_package_exports():
    import lerobot_policy_gcdt

    for name in lerobot_gcdt.__all__:
        assert getattr(lerobot_policy_gcdt, name) is getattr(lerobot_gcdt, name)


def test_the_package_exports_its_public_names():
    public = {"GCDTConfig", "GCDTPolicy", "SurRoLEnvConfig", "make_gcdt_pre_post_processors"}
    assert public <= set(lerobot_gcdt.__all__)
    assert all(hasattr(lerobot_gcdt, name) for name in lerobot_gcdt.__all__)


def test_the_simulator_needs_neither_torch_nor_lerobot():
    loaded = run("""
import json, sys
import gymnasium, surrol_gym
env = gymnasium.make("surrol/NeedleReach-v0")
observation, _ = env.reset(seed=0)
env.step(surrol_gym.make_expert(env).act(observation))
env.close()
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
""")
    assert "surrol_gym" in loaded
    assert not {"torch", "lerobot", "lerobot_gcdt", "datasets"} & set(loaded)


@pytest.fixture(scope="module")
def without_pybullet(needle_pick_root):
    """What works in a process in which PyBullet cannot be imported."""
    return run(f"""
import json, sys
sys.modules["pybullet"] = None  # so an import fails as if it was not installed
import lerobot_gcdt, lerobot_policy_gcdt
import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.policies.factory import get_policy_class, make_pre_post_processors

dataset = LeRobotDataset("local/needle_pick", root={str(needle_pick_root)!r}, video_backend="pyav")
batch = torch.utils.data.default_collate([dataset[i] for i in (0, 60)])
trained = {{}}
for kind, sizes in (("gcdt", {{"layers": 1, "width": 16, "heads": 2, "inner_width": 16}}), ("bc", {{}})):
    policy_class = get_policy_class(kind)
    config = policy_class.config_class(**sizes, device="cpu", push_to_hub=False)
    policy = policy_class(config, dataset_meta=dataset.meta).train()
    before = [parameter.clone() for parameter in policy.parameters()]
    optimizer = torch.optim.SGD(policy.parameters(), lr=0.1)
    preprocessor, _ = make_pre_post_processors(config)
    policy(preprocessor(batch))[0].backward()
    optimizer.step()
    trained[kind] = any(not torch.equal(a, b) for a, b in zip(before, policy.parameters()))
try:
    lerobot_gcdt.SurRoLEnvConfig
except ImportError as error:
    refused = str(error)
print(json.dumps({{
    "trained": trained,
    "refused": refused,
    "exported": lerobot_gcdt.__all__,
    "tasks": len(lerobot_gcdt.GCDTPolicy.from_pretrained(lerobot_gcdt.GENERALIST).config.task_dims),
}}))
""")


def test_policies_train_without_pybullet(without_pybullet):
    assert without_pybullet["trained"] == {"gcdt": True, "bc": True}


def test_the_built_in_policy_loads_without_pybullet(without_pybullet):
    assert without_pybullet["tasks"] == len(surrol_gym.TASKS)


def test_without_pybullet_the_environment_type_is_refused_with_the_reason(without_pybullet):
    assert "SurRoLEnvConfig" not in without_pybullet["exported"]
    assert "PyBullet" in without_pybullet["refused"]
