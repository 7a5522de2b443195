import runpy
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import surrol_gym
from lerobot_gcdt.hub.documents import read_section

ROOT = Path(__file__).parents[2]
GALLERY = runpy.run_path(str(ROOT / "examples/task_gallery.py"))


def test_the_readme_holds_the_table_that_the_script_writes():
    assert read_section(ROOT / "README.md", "tasks") == GALLERY["table"]()


@pytest.mark.parametrize("task", surrol_gym.TASKS)
def test_every_task_has_its_picture(task):
    with Image.open(ROOT / GALLERY["PICTURES"] / f"{task}.png") as picture:
        assert picture.size == (GALLERY["WIDTH"], GALLERY["HEIGHT"])
        assert len(np.unique(np.asarray(picture).reshape(-1, 3), axis=0)) > 100
