"""A task in a window, driven by the keys of a keyboard."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from surrol_gym.keyboard import HELP

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def played(on_display, tmp_path_factory):
    """What was printed while a person picked the needle by key presses, and a picture of the window at the end."""
    picture = tmp_path_factory.mktemp("played") / "window.png"
    printed = on_display(HERE / "play_by_keys.py", picture)
    return printed, np.asarray(Image.open(picture).convert("RGB"), dtype=int)


def test_a_person_picks_the_needle_by_key_presses(played):
    assert "Seed 15: the goal is reached" in played[0]


def test_the_keys_are_explained_where_it_starts(played):
    assert HELP in played[0]


def test_the_window_shows_the_scene_as_the_camera_sees_it(played):
    red, green, blue = np.moveaxis(played[1], -1, 0)
    goal = (red > 120) & (green < 60) & (blue < 60)
    tray = (red > 180) & (green > 130) & (green < 220) & (blue > 90) & (blue < 190)
    assert goal.sum() > 20
    rows, columns = np.nonzero(tray)
    assert len(rows) > 0.05 * tray.size
    assert abs(columns.mean() / tray.shape[1] - 0.5) < 0.1


def test_only_a_window_has_keys(make):
    with pytest.raises(ValueError, match="human"):
        make("NeedleReach").unwrapped.pressed_keys()


@pytest.mark.parametrize(
    ("arguments", "named"), [(["--task", "NeedleThread"], "NeedleThread"), (["--seed", "-1"], "-1")]
)
def test_a_bad_argument_is_named_in_one_line(arguments, named):
    done = subprocess.run([sys.executable, "-m", "surrol_gym.play", *arguments], capture_output=True, text=True)
    assert done.returncode != 0
    assert named in done.stderr.splitlines()[-1] and "Traceback" not in done.stderr


def test_without_a_display_the_way_out_is_named(no_display):
    done = subprocess.run([sys.executable, "-m", "surrol_gym.play"], capture_output=True, text=True)
    assert done.returncode != 0
    assert "display" in done.stderr.splitlines()[-1] and "Traceback" not in done.stderr
