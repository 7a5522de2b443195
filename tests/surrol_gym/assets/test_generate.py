from pathlib import Path

import pybullet
import pytest
from pybullet_utils.bullet_client import BulletClient

from surrol_gym.assets import generate
from surrol_gym.bullet import ASSETS

FILES = sorted(path.name for path in ASSETS.iterdir() if path.suffix in (".urdf", ".obj"))


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("assets")
    generate.main(folder)
    return folder


def test_the_generator_writes_the_committed_files_and_no_others(generated):
    assert sorted(path.name for path in generated.iterdir()) == FILES
    assert FILES


@pytest.mark.parametrize("name", FILES)
def test_a_generated_file_has_the_committed_bytes(generated, name):
    assert (generated / name).read_bytes() == (ASSETS / name).read_bytes()


def test_by_default_the_generator_writes_into_the_package():
    assert generate.main.__defaults__ == (Path(ASSETS),)


@pytest.mark.parametrize("name", [name for name in FILES if name.endswith(".urdf")])
def test_pybullet_loads_a_generated_description_without_a_complaint(generated, capfd, name):
    client = BulletClient(pybullet.DIRECT)
    capfd.readouterr()
    body = client.loadURDF(str(generated / name), globalScaling=5)
    complaints = "".join(capfd.readouterr())
    client.disconnect()
    assert body == 0
    assert complaints == ""
