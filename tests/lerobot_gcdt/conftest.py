"""Small recorded datasets and a small model, shared by the tests of ``lerobot_gcdt``.

The datasets are made once a session. Tests read them and must not write into them.
"""

import copy
import logging
import multiprocessing
import os
import sys
import time
from functools import cache

import datasets
import pytest
import torch
from accelerate.state import AcceleratorState
from draccus.wrappers import docstring
from lerobot.configs import parser
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.scripts import lerobot_eval, lerobot_train

from lerobot_gcdt import GCDTConfig
from lerobot_gcdt.keys import REQUIRED_KEYS
from lerobot_gcdt.locking import alone_in
from lerobot_gcdt.recording import merge, record

EPISODES = 4


@pytest.fixture(scope="session", autouse=True)
def _datasets_cache(tmp_path_factory):
    """Keeps what Hugging Face Datasets caches of the small datasets out of the home folder."""
    cache = tmp_path_factory.mktemp("datasets_cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HF_DATASETS_CACHE", str(cache))
        patch.setattr(datasets.config, "HF_DATASETS_CACHE", cache)
        yield


@pytest.fixture(scope="session", autouse=True)
def _help_is_looked_up_once():
    """Whenever Draccus reads one of LeRobot's commands, it searches the sources for the help of 1600 options.

    That takes most of the time of the many tests in which a command is only read.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(docstring, "get_attribute_docstring", cache(docstring.get_attribute_docstring))
        yield


@pytest.fixture(scope="session")
def needle_pick_root(tmp_path_factory):
    """Folder of a NeedlePick dataset of four episodes."""
    return record("NeedlePick", EPISODES, 0, tmp_path_factory.mktemp("datasets") / "needle_pick")


@pytest.fixture(scope="session")
def needle_reach_root(tmp_path_factory):
    """Folder of a NeedleReach dataset of four episodes."""
    return record("NeedleReach", EPISODES, 0, tmp_path_factory.mktemp("datasets") / "needle_reach")


@pytest.fixture(scope="session")
def uneven_root(tmp_path_factory, needle_pick_root):
    """Folder of a merged dataset: four episodes of NeedlePick, one of NeedleReach."""
    folder = tmp_path_factory.mktemp("datasets")
    return merge([needle_pick_root, record("NeedleReach", 1, 0, folder / "one_reach")], folder / "uneven")


@pytest.fixture(scope="session")
def opened():
    """Opens the metadata of a dataset, as LeRobot hands them to a policy: once, but each test gets its own copy."""
    metadata = cache(lambda root: LeRobotDatasetMetadata(f"local/{root.name}", root=root))
    return lambda root: copy.copy(metadata(root))


@pytest.fixture
def needle_pick_meta(opened, needle_pick_root):
    """Metadata of the NeedlePick dataset."""
    return opened(needle_pick_root)


@pytest.fixture
def needle_reach_meta(opened, needle_reach_root):
    """Metadata of the NeedleReach dataset."""
    return opened(needle_reach_root)


@pytest.fixture
def uneven_meta(opened, uneven_root):
    """Metadata of the merged dataset."""
    return opened(uneven_root)


@pytest.fixture(scope="session")
def needle_pick_windows(needle_pick_root):
    """Windows of 50 steps of the NeedlePick dataset that end with its frames 49, 99 and 119, from LeRobot's loader."""
    offsets = [i / 5 for i in range(-49, 1)]
    dataset = LeRobotDataset(
        "local/needle_pick",
        root=needle_pick_root,
        delta_timestamps=dict.fromkeys((*REQUIRED_KEYS, "frame_index"), offsets),
        video_backend="pyav",
    )
    return torch.utils.data.default_collate([dataset[i] for i in (49, 99, 119)])


@pytest.fixture(scope="session")
def make_tiny_config():
    """Makes the configuration of a model of 2 layers and 32 numbers a token that sees its whole past, on the CPU."""
    sizes = {"layers": 2, "width": 32, "heads": 2, "inner_width": 64, "context_length": 100}
    return lambda: GCDTConfig(**sizes, device="cpu", dtype="float32", push_to_hub=False)


@pytest.fixture
def tiny_config(make_tiny_config):
    """Such a configuration; each test gets its own."""
    return make_tiny_config()


@pytest.fixture(scope="session")
def command():
    """Runs the entry point of a command with arguments, and tidies up what it leaves behind in the process."""

    def run(main, *arguments):
        root_logger = logging.getLogger()
        handlers, level = root_logger.handlers[:], root_logger.level
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", [main.__module__, *map(str, arguments)])
            try:
                main()
            finally:
                parser._config_path_args.clear()
                parser._config_yaml_overrides.clear()
                AcceleratorState._reset_state(reset_partial_state=True)
                root_logger.handlers[:] = handlers
                root_logger.setLevel(level)

    return run


@pytest.fixture(scope="session")
def train(command):
    """Runs ``lerobot-train`` in this process."""
    return lambda *arguments: command(lerobot_train.main, *arguments)


@pytest.fixture(scope="session")
def evaluate(command):
    """Runs ``lerobot-eval`` in this process."""
    return lambda *arguments: command(lerobot_eval.main, *arguments)


@pytest.fixture
def at_work():
    """Lets another process be at work in a folder; returns the process."""
    if not hasattr(os, "fork"):
        pytest.skip("forks the other process")
    fork = multiprocessing.get_context("fork")
    processes = []

    def start(folder):
        begun = fork.Event()
        processes.append(fork.Process(target=_stay_in, args=(folder, begun), daemon=True))
        processes[-1].start()
        assert begun.wait(60)
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        process.join()


def _stay_in(folder, begun):
    with alone_in(folder):
        begun.set()
        time.sleep(600)
