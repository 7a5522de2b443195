"""Films show every step of every episode, and say when the goal is reached."""

import importlib
from types import SimpleNamespace

import av
import matplotlib
import numpy as np
import pandas as pd
import pytest
import torch
from PIL import Image

import surrol_gym
from lerobot_gcdt.evaluation import pictures
from lerobot_gcdt.evaluation.pictures import film, halfway, strips


class Still:
    """A policy that does nothing."""

    def reset(self):
        pass

    def select_action(self, batch):
        return torch.zeros(len(batch["observation.state"]), 5)


class Straight(Still):
    """A policy that moves the tool straight to the goal."""

    def select_action(self, batch):
        way = (batch["observation.goal"] - batch["observation.achieved_goal"]) / 0.05
        return torch.nn.functional.pad(way.clamp(-1, 1), (0, 2))


def frames(path):
    with av.open(str(path)) as container:
        assert container.streams.video[0].average_rate == 10
        return np.stack([frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]).astype(int)


@pytest.mark.parametrize(("policy", "held"), [(Still(), False), (Straight(), True)], ids=["still", "straight"])
def test_a_film_shows_every_step_and_whether_the_goal_is_held(policy, held, tmp_path):
    assert film(policy, "NeedleReach", [0, 1], tmp_path / "film.mp4", size=96) == [held, held]
    seen = frames(tmp_path / "film.mp4")
    assert seen.shape == (2 * (51 + 5), 96, 96, 3)
    bar = seen[:, -4:, -20:].mean((1, 2))  # red, green, blue
    is_green = bar[:, 1] > bar[:, 0] + 50
    assert not is_green[0] and is_green[50] == held


def test_strips_go_from_the_first_step_of_each_episode_to_its_last(tmp_path):
    path = strips(Straight(), "NeedleReach", [0, 1], tmp_path / "strips.png", columns=3, size=96)
    strip = np.asarray(Image.open(path)).astype(int)
    assert strip.shape == (2 * 96, 3 * 96, 3)
    bars = strip[[92, 188], 90::96]  # below the right edge of each picture
    is_green = bars[..., 1] > bars[..., 0] + 50
    assert is_green.tolist() == [[False, True, True]] * 2


def test_a_task_is_drawn_even_if_its_expert_misses_the_goal(monkeypatch):
    left = [np.zeros(5, dtype=np.float32)] * 100
    monkeypatch.setattr(surrol_gym, "make_expert", lambda env: SimpleNamespace(act=lambda observation: left.pop()))
    assert halfway("NeedleReach", 64, 48).size == (64, 48)
    assert len(left) == 50


def test_the_backend_of_a_notebook_stays_as_it_is(tmp_path, monkeypatch):
    monkeypatch.setitem(matplotlib.rcParams, "backend", "svg")
    importlib.reload(pictures)
    curve = pd.DataFrame({"step": [1, 2], "loss": [0.2, 0.1]})
    assert pictures.plot_training(curve, tmp_path / "curve.png").read_bytes().startswith(b"\x89PNG")
    assert matplotlib.get_backend() == "svg"
