"""The processors: LeRobot's default steps by name, through which observations and actions pass unchanged."""

import pytest
import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.policies import make_pre_post_processors

from lerobot_gcdt import GCDTPolicy, make_gcdt_pre_post_processors


@pytest.fixture
def config(tiny_config, needle_pick_meta):
    """A configuration with the features of a dataset, as LeRobot's factory fills them in."""
    from lerobot.policies import make_policy

    return make_policy(tiny_config, ds_meta=needle_pick_meta).config


@pytest.fixture
def batch():
    """What LeRobot's loader gives for three frames, cut down to what matters here."""
    return {
        "observation.state": torch.randn(3, 19),
        "observation.environment_state": torch.randn(3, 3),
        "observation.goal": torch.randn(3, 3),
        "observation.achieved_goal": torch.randn(3, 3),
        "observation.time_to_goal": torch.rand(3),
        "action": torch.rand(3, 5),
        "index": torch.tensor([4, 5, 6]),
        "task": ["Pick up the needle and bring its middle to the goal."] * 3,
    }


def test_lerobots_factory_finds_the_processors_by_their_name(config, needle_pick_meta):
    ours = make_gcdt_pre_post_processors(config, needle_pick_meta.stats)
    found = make_pre_post_processors(policy_cfg=config, dataset_stats=needle_pick_meta.stats)
    assert [[type(s) for s in p.steps] for p in found] == [[type(s) for s in p.steps] for p in ours]


def test_the_steps_have_the_names_that_lerobot_overrides(config, tmp_path):
    for pipeline in make_gcdt_pre_post_processors(config):
        pipeline.save_pretrained(tmp_path)
    saved = "".join(path.read_text() for path in tmp_path.glob("*.json"))
    names = ("rename_observations_processor", "device_processor", "normalizer_processor", "unnormalizer_processor")
    assert [name for name in names if f'"{name}"' not in saved] == []


def test_a_batch_passes_unchanged(config, needle_pick_meta, batch):
    preprocessor, _ = make_gcdt_pre_post_processors(config, needle_pick_meta.stats)
    passed = preprocessor(batch)
    for key, value in batch.items():
        if key == "task":
            assert list(passed[key]) == value
        else:
            torch.testing.assert_close(passed[key], value, rtol=0, atol=0)


def test_an_action_passes_unchanged(config, needle_pick_meta):
    _, postprocessor = make_gcdt_pre_post_processors(config, needle_pick_meta.stats)
    action = torch.rand(3, 5) * 2 - 1
    torch.testing.assert_close(postprocessor(action), action, rtol=0, atol=0)


def test_saved_processors_accept_the_overrides_of_the_trainer(config, needle_pick_meta, tmp_path, batch):
    for pipeline in make_gcdt_pre_post_processors(config, needle_pick_meta.stats):
        pipeline.save_pretrained(tmp_path)
    features = {**config.input_features, **config.output_features}
    preprocessor, postprocessor = make_pre_post_processors(
        policy_cfg=config,
        pretrained_path=str(tmp_path),
        preprocessor_overrides={
            "device_processor": {"device": "cpu"},
            "rename_observations_processor": {"rename_map": {}},
            "normalizer_processor": {
                "stats": needle_pick_meta.stats,
                "features": features,
                "norm_map": config.normalization_mapping,
            },
        },
        postprocessor_overrides={
            "unnormalizer_processor": {
                "stats": needle_pick_meta.stats,
                "features": features,
                "norm_map": config.normalization_mapping,
            },
        },
    )
    torch.testing.assert_close(preprocessor(batch)["observation.state"], batch["observation.state"], rtol=0, atol=0)
    torch.testing.assert_close(postprocessor(batch["action"]), batch["action"], rtol=0, atol=0)


def test_a_single_frame_of_a_dataset_can_be_acted_on(tiny_config, needle_pick_root, needle_pick_meta):
    policy = GCDTPolicy(tiny_config, dataset_meta=needle_pick_meta).eval()
    preprocessor, postprocessor = make_gcdt_pre_post_processors(tiny_config, needle_pick_meta.stats)
    frame = LeRobotDataset("local/needle_pick", root=needle_pick_root, video_backend="pyav")[0]
    assert postprocessor(policy.select_action(preprocessor(frame))).shape == (1, 5)
