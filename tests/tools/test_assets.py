"""The URDF and OBJ files of the simulator are what their generator writes."""

import subprocess
import sys
from pathlib import Path

import pybullet
import pytest
from pybullet_utils.bullet_client import BulletClient

from surrol_gym.bullet import ASSETS

ROOT = Path(__file__).parents[2]
FILES = sorted(path.name for path in ASSETS.iterdir() if path.suffix in (".urdf", ".obj"))


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("assets")
    subprocess.run([sys.executable, "-m", "tools.assets.generate", folder], cwd=ROOT, check=True)
    return folder


def test_the_generator_writes_the_committed_files_and_no_others(generated):
    assert sorted(path.name for path in generated.iterdir()) == FILES
    assert FILES


@pytest.mark.parametrize("name", FILES)
def test_a_generated_file_has_the_committed_bytes(generated, name):
    assert (generated / name).read_bytes() == (ASSETS / name).read_bytes()


@pytest.mark.parametrize("name", [name for name in FILES if name.endswith(".urdf")])
def test_pybullet_loads_a_description_without_a_complaint(capfd, name):
    client = BulletClient(pybullet.DIRECT)
    capfd.readouterr()
    body = client.loadURDF(str(ASSETS / name), globalScaling=5)
    complaints = "".join(capfd.readouterr())
    client.disconnect()
    assert body == 0
    assert complaints == ""
