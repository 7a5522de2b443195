"""Publishing and loading through the real client, against a Hub on this machine."""

import errno
import json
import os
import shutil
import subprocess
import sys
from functools import cache
from io import BytesIO
from pathlib import Path

import huggingface_hub
import pytest
import torch
from hub_server import TOKEN, HubServer, Repo
from huggingface_hub import constants
from huggingface_hub.utils._http import default_client_factory
from lerobot.configs.default import DatasetConfig
from lerobot.configs.train import TrainPipelineConfig
from lerobot.policies import make_policy
from PIL import Image
from safetensors.torch import load

import gcdt_cli as cli
from lerobot_gcdt import make_gcdt_pre_post_processors
from lerobot_gcdt.averaging import without_resting
from lerobot_gcdt.evaluation.pictures import halfway
from lerobot_gcdt.hub.checks import CHECKPOINT_FILES, DATASET_FILES

DATA_FILE = "data/chunk-000/file-000.parquet"
STATE_FILE = "policy_preprocessor_step_3_normalizer_processor.safetensors"
CHAIN = Path(__file__).with_name("hub_chain.py")


@pytest.fixture(scope="module", autouse=True)
def _pictures_are_drawn_once():
    """Every dataset is published with a picture of its task, in most of these tests of the same."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lerobot_gcdt.hub.publish.halfway", cache(halfway))
        yield


@pytest.fixture
def hub(monkeypatch, tmp_path):
    """An empty Hub that the client is logged in to, instead of the one on the internet."""
    server = HubServer()
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", False)
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(constants, "HF_TOKEN_PATH", str(tmp_path / "no token"))
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    huggingface_hub.set_client_factory(server.client)
    yield server
    huggingface_hub.set_client_factory(default_client_factory)
    server.shutdown()
    server.server_close()


@pytest.fixture
def dataset(needle_reach_root, tmp_path):
    """Folder of a dataset that a test may change."""
    return shutil.copytree(needle_reach_root, tmp_path / "needle_reach")


@pytest.fixture(scope="module")
def whole_training(make_tiny_config, opened, needle_reach_root, tmp_path_factory):
    """Output folder of a training whose last checkpoint is that of a new policy."""
    output, meta = tmp_path_factory.mktemp("training") / "output", opened(needle_reach_root)
    folder = output / "checkpoints" / "000010" / "pretrained_model"
    policy = make_policy(make_tiny_config(), ds_meta=meta)
    policy.save_pretrained(folder)
    for pipeline in make_gcdt_pre_post_processors(policy.config, meta.stats):
        pipeline.save_pretrained(folder)
    data = DatasetConfig("local/needle_reach", root=str(needle_reach_root), video_backend="pyav")
    TrainPipelineConfig(dataset=data, policy=policy.config)._save_pretrained(folder)
    (folder.parents[1] / "last").symlink_to("000010")
    return output


@pytest.fixture
def training(whole_training, tmp_path):
    """Such a folder that a test may change."""
    return shutil.copytree(whole_training, tmp_path / "output", symlinks=True)


@pytest.fixture
def model(training):
    """Folder of the training's checkpoint."""
    return training / "checkpoints" / "000010" / "pretrained_model"


def publish(folder, name="me/thing", *options) -> None:
    cli.main(["publish", str(folder), "--repo_id", name, *options])


def error_of(folder, name="me/thing", *options) -> str:
    """The one line that a publishing ends with which must not change the folder."""
    before = contents(folder)
    with pytest.raises(SystemExit) as end:
        publish(folder, name, *options)
    assert isinstance(end.value.code, str) and "\n" not in end.value.code
    assert contents(folder) == before
    return end.value.code


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def change_json(file: Path, **values) -> None:
    file.write_text(json.dumps(json.loads(file.read_text()) | values))


# The chain, as a stranger walks it.


def chain(home: Path, *arguments, offline: bool) -> None:
    environment = os.environ | {"HF_HOME": str(home), "HF_TOKEN": TOKEN, "HF_HUB_OFFLINE": str(int(offline))}
    environment.pop("HF_DATASETS_CACHE", None)
    command = [sys.executable, CHAIN, *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, errors="replace", timeout=500)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-5000:]


@pytest.fixture(scope="module")
def walked(needle_reach_root, tmp_path_factory):
    """Folder of what a stranger had done while the Hub was there, and the repositories that it held at the end."""
    folder, server = tmp_path_factory.mktemp("chain"), HubServer()
    arguments = [needle_reach_root, folder / "output", str(server.server_port)]
    chain(folder / "home", "online", *arguments, offline=False)
    server.shutdown()
    server.server_close()
    return folder, server.repos


def test_publishing_loading_training_and_evaluating_work_by_repository_id(walked):
    assert set(walked[1]) == {("datasets", "me/needle_reach"), ("models", "me/gcdt_reach")}


def test_our_card_replaces_the_one_that_lerobot_pushed(walked):
    repo = walked[1]["models", "me/gcdt_reach"]
    ours = repo.files("v1.0")["README.md"].decode()
    assert "This checkpoint has not been evaluated." in ours
    assert any(b"LeRobot" in files.get("README.md", b"") for files in repo.commits.values())
    assert "me/needle_reach" in ours.split("---")[1], "the front matter links the dataset"


def test_the_same_works_offline_from_the_cache(walked):
    folder = walked[0]
    chain(folder / "home", "offline", folder / "output", offline=True)


# What is published.


def test_a_dataset_goes_up_whole_in_one_commit_with_its_card_and_lerobots_tag(hub, dataset):
    publish(dataset)
    repo = hub.repos["datasets", "me/thing"]
    files = repo.files()
    card, picture = files.pop("README.md").decode(), files.pop("pictures/NeedleReach.png")
    assert files == contents(dataset)
    assert "(pictures/NeedleReach.png)" in card and 'LeRobotDataset("me/thing")' in card
    with Image.open(BytesIO(picture)) as image:
        assert image.size == (320, 240)
    assert len(repo.commits) == 2, "an empty one, and all at once"
    assert repo.tags == {"v3.0": repo.branches["main"]}
    assert "license: apache-2.0" in card and "LeRobot" in card


def test_a_checkpoint_goes_up_with_its_card(hub, training, model):
    publish(training)
    files = hub.repos["models", "me/thing"].files()
    card, weights, own = files.pop("README.md").decode(), load(files.pop("model.safetensors")), contents(model)
    whole = load(own.pop("model.safetensors"))
    assert files == own
    assert 'from_pretrained("me/thing")' in card
    assert set(weights) == without_resting(whole) < set(whole), "half of the file, and the same policy"
    assert all(torch.equal(weight, whole[name]) for name, weight in weights.items())


def test_a_checkpoint_folder_gives_the_same_as_its_training(hub, training, model):
    publish(training, "me/training")
    publish(model, "me/model")
    one, other = (hub.repos["models", name].files() for name in ("me/training", "me/model"))
    assert one.keys() == other.keys() and one["model.safetensors"] == other["model.safetensors"]


def test_a_merged_dataset_is_published(hub, uneven_root):
    publish(uneven_root)
    files = hub.repos["datasets", "me/thing"].files()
    assert {DATA_FILE, "pictures/NeedlePick.png", "pictures/NeedleReach.png"} <= set(files)


def test_a_card_of_ones_own_is_published_instead(hub, dataset):
    own = "---\nlicense: mit\ntags: [LeRobot, mine]\ntask_categories: [robotics]\n---\n# Mine\n"
    (dataset / "README.md").write_text(own)
    publish(dataset)
    files = hub.repos["datasets", "me/thing"].files()
    assert files["README.md"].decode() == own
    assert not any(file.startswith("pictures/") for file in files), "it shows none of ours"


def test_what_is_no_part_of_a_dataset_or_policy_stays_here(hub, model):
    (model / "weights.pkl").write_bytes(b"code in disguise")
    (model / ".cache").mkdir()
    (model / ".cache" / "notes.json").write_text("{}")
    publish(model)
    assert not {"weights.pkl", ".cache/notes.json"} & set(hub.repos["models", "me/thing"].files())


def test_publishing_again_changes_nothing(hub, dataset):
    publish(dataset, "me/thing", "--revision_tag", "v1.0")
    before = dict(hub.repos["datasets", "me/thing"].tags)
    publish(dataset, "me/thing", "--revision_tag", "v1.0")
    repo = hub.repos["datasets", "me/thing"]
    assert (len(repo.commits), repo.tags) == (2, before)


def test_a_new_state_replaces_the_old_one_and_takes_lerobots_tag(hub, dataset):
    publish(dataset)
    repo = hub.repos["datasets", "me/thing"]
    more = "data/chunk-000/file-001.parquet"
    repo.tags["v3.0"] = repo.commit("main", repo.files() | {more: b"frames that were dropped", ".gitattributes": b""})
    publish(dataset)
    assert more not in repo.files() and ".gitattributes" in repo.files()
    assert repo.tags["v3.0"] == repo.branches["main"]


def test_a_revision_keeps_its_state_for_ever(hub, dataset):
    publish(dataset, "me/thing", "--revision_tag", "v1.0")
    before = hub.repos["datasets", "me/thing"].tags["v1.0"]
    change_json(dataset / "meta/surrol.json", note="changed")
    assert "v1.0" in error_of(dataset, "me/thing", "--revision_tag", "v1.0")
    assert hub.repos["datasets", "me/thing"].tags["v1.0"] == before


def test_a_private_repository_is_private(hub, dataset):
    publish(dataset, "me/thing", "--private")
    assert hub.repos["datasets", "me/thing"].private


def test_nothing_private_is_sent_to_a_public_repository(hub, dataset):
    hub.repos["datasets", "me/thing"] = Repo(private=False)
    assert "public" in error_of(dataset, "me/thing", "--private")
    assert not hub.repos["datasets", "me/thing"].files()


def test_a_dry_run_shows_what_would_be_sent_and_asks_nobody(hub, dataset, monkeypatch, capsys):
    monkeypatch.delenv("HF_TOKEN")
    publish(dataset, "me/thing", "--dry_run", "--private", "--revision_tag", "v1.0")
    shown = capsys.readouterr().out
    for part in ("me/thing: a private dataset", "v3.0", "v1.0", DATA_FILE, "pictures/Needle", "license: apache-2.0"):
        assert part in shown
    assert f"{(dataset / DATA_FILE).stat().st_size:,} bytes" in shown
    assert hub.requests == []


def test_the_help_shows_a_valid_example(capsys, monkeypatch):
    calls = []
    monkeypatch.setattr("lerobot_gcdt.hub.publish.publish", lambda *arguments: calls.append(arguments))
    with pytest.raises(SystemExit):
        cli.main(["publish", "--help"])
    cli.main(" ".join(capsys.readouterr().out.split()).split("example: gcdt ")[1].split())
    assert calls


# Refused by the Hub: the local files stay as they are, and the message says what to do.


def test_without_a_token_it_says_how_to_log_in(hub, dataset, monkeypatch):
    monkeypatch.delenv("HF_TOKEN")
    said = error_of(dataset)
    assert "hf auth login" in said and "HF_TOKEN" in said
    assert not hub.repos


def test_a_wrong_token_is_told_from_a_missing_repository(hub, dataset, monkeypatch):
    monkeypatch.setenv("HF_TOKEN", "hf_of_nobody")
    assert "refuses the token (401)" in error_of(dataset)
    assert not hub.repos


def test_a_token_that_may_not_write_there_is_refused(hub, dataset):
    said = error_of(dataset, "somebody/thing")
    assert "refuses the token (403)" in said and "somebody/thing" in said


@pytest.mark.parametrize("status", [413, 500, 507], ids=["too large", "broken", "full"])
def test_a_refused_upload_says_so_and_succeeds_when_repeated(hub, dataset, status):
    hub.refuse = status
    said = error_of(dataset)
    assert str(status) in said and f"{dataset} is untouched; repeat the command" in said
    assert not hub.repos["datasets", "me/thing"].files()
    hub.refuse = 0
    publish(dataset)
    assert DATA_FILE in hub.repos["datasets", "me/thing"].files()


def test_what_the_hub_finds_wrong_with_a_card_is_passed_on(hub, dataset):
    hub.complaint = "license must be one of a list"
    assert "license must be one of a list" in error_of(dataset)
    assert not hub.repos["datasets", "me/thing"].files()


def test_a_large_file_that_is_not_taken_says_so(hub, dataset, monkeypatch):
    def fail(*_, **__):
        raise RuntimeError("Error while uploading a file")

    monkeypatch.setattr("lerobot_gcdt.hub.publish.HfApi.create_commit", fail)
    assert "Error while uploading a file. " in error_of(dataset)


def test_a_hub_that_is_out_of_reach_is_named(hub, dataset):
    hub.shutdown()
    hub.server_close()
    assert "untouched; repeat the command" in error_of(dataset)


def test_a_full_disk_leaves_the_dataset_whole_and_says_so(hub, dataset, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    publish(dataset)
    monkeypatch.setattr("lerobot_gcdt.hub.publish.HfApi.hf_hub_download", full)
    said = error_of(dataset)
    assert "No space left on device" in said and "untouched" in said


def test_a_repository_with_other_features_names_them(hub, dataset, needle_pick_root):
    publish(needle_pick_root)
    before = dict(hub.repos["datasets", "me/thing"].commits)
    said = error_of(dataset)
    assert "observation.state" in said and "observation.goal" in said and "next.reward" not in said
    assert hub.repos["datasets", "me/thing"].commits == before


# Refused before anything is sent.


@pytest.fixture
def silent(hub):
    """A Hub that must not be asked."""
    yield hub
    assert hub.requests == []


def test_a_folder_with_something_else_says_what_is_expected(silent, tmp_path):
    (tmp_path / "photos").mkdir()
    for folder in (tmp_path / "photos", tmp_path / "nowhere"):
        said = error_of(folder)
        assert "gcdt record" in said and "lerobot-train" in said and folder.name in said


@pytest.mark.parametrize("name", ["thing", "me/thing/v1", "me/a thing", "/thing"])
def test_a_name_that_is_no_repository_is_refused(silent, dataset, name):
    assert name in error_of(dataset, name)


@pytest.mark.parametrize("tag", ["v 1 ~", "-v1", "v1..2", "v1.lock", "v1.", "v/1"])
def test_a_tag_that_git_may_not_take_is_refused(silent, dataset, tag):
    assert repr(tag) in error_of(dataset, "me/thing", "--dry_run", f"--revision_tag={tag}")


@pytest.mark.parametrize("missing", DATASET_FILES)
def test_a_dataset_without_a_file_names_it(silent, dataset, missing):
    (dataset / missing).unlink()
    assert missing in error_of(dataset)


@pytest.mark.parametrize("file", [DATA_FILE, "meta/episodes/chunk-000/file-000.parquet", "meta/info.json"])
def test_a_truncated_file_of_a_dataset_is_named(silent, dataset, file):
    whole = (dataset / file).read_bytes()
    (dataset / file).write_bytes(whole[: len(whole) // 2])
    assert file in error_of(dataset)


def test_frames_that_are_missing_are_counted(silent, dataset):
    (dataset / DATA_FILE).unlink()
    said = error_of(dataset)
    assert "0 rows" in said and "total_frames = 200" in said


def test_a_dataset_of_another_environment_version_names_both(silent, dataset):
    change_json(dataset / "meta/surrol.json", env_id="surrol/NeedleReach-v7")
    said = error_of(dataset)
    assert "surrol/NeedleReach-v7" in said and "surrol/NeedleReach-v0" in said


def test_a_dataset_of_another_format_is_refused(silent, dataset):
    change_json(dataset / "meta/info.json", codebase_version="v2.1")
    said = error_of(dataset)
    assert "v2.1" in said and "v3.0" in said


@pytest.mark.parametrize("missing", [*CHECKPOINT_FILES, STATE_FILE])
def test_a_checkpoint_without_a_file_names_it(silent, model, missing):
    (model / missing).unlink()
    assert missing in error_of(model)


@pytest.mark.parametrize("file", ["model.safetensors", STATE_FILE])
@pytest.mark.parametrize("damaged", [lambda whole: whole[:-100], lambda _: b"a pickle"], ids=["truncated", "other"])
def test_a_file_that_is_not_safetensors_is_named(silent, model, file, damaged):
    (model / file).write_bytes(damaged((model / file).read_bytes()))
    assert file in error_of(model)


def test_a_policy_of_another_type_is_left_to_lerobot(silent, model):
    change_json(model / "config.json", type="act")
    assert "act" in error_of(model)


@pytest.mark.parametrize(
    ("card", "lacking"),
    [
        ("# Without front matter\n", "license"),
        ("---\ntags: [LeRobot]\ntask_categories: [robotics]\n---\n", "license"),
        ("---\nlicense: mit\ntags: [surrol]\ntask_categories: [robotics]\n---\n", "LeRobot"),
        ("---\nlicense: mit\ntags: [LeRobot]\n---\n", "task_categories"),
        ("---\nlicense: [mit\n---\n", "YAML"),
    ],
    ids=["no front matter", "no licence", "no tag", "no category", "no YAML"],
)
def test_a_card_without_required_metadata_says_what_it_lacks(silent, dataset, card, lacking):
    (dataset / "README.md").write_text(card)
    said = error_of(dataset)
    assert lacking in said and "README.md" in said


def test_a_model_card_without_its_library_is_refused(silent, model):
    (model / "README.md").write_text("---\nlicense: mit\npipeline_tag: robotics\n---\n")
    assert "library_name: lerobot" in error_of(model)
