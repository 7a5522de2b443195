"""``gcdt record --all``: all tasks side by side, merged, resumable, and the same as one by one."""

import json
import os
import signal
import subprocess
import sys

import pytest
from lerobot.datasets.lerobot_dataset import LeRobotDataset

import gcdt_cli as cli
import surrol_gym
from lerobot_gcdt.recording import collection, record
from lerobot_gcdt.recording.features import Extras
from lerobot_gcdt.recording.manifest import differing_episodes


@pytest.fixture(scope="module")
def two_tasks():
    """A world of two tasks, to be quick."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(surrol_gym, "TASKS", ("NeedleReach", "NeedleRegrasp"))
        yield


@pytest.fixture(scope="module")
def recorded(two_tasks, tmp_path_factory):
    """Folder of the datasets of two tasks, two episodes each, and of their merger."""
    root = tmp_path_factory.mktemp("collection") / "datasets"
    collection.record_all(root, episodes=2, workers=2)
    return root


def files(folder):
    """Every file of the datasets in a folder, or of one, by relative path."""
    paths = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
    return {str(path): (folder / path).read_bytes() for path in paths if path.parts[0] != "executor"}


def test_there_is_a_dataset_a_task_and_their_merger(recorded):
    assert sorted(path.name for path in recorded.iterdir()) == [
        "surrol_cross_task",
        "surrol_needle_reach",
        "surrol_needle_regrasp",
    ]
    assert LeRobotDataset("local/x", root=recorded / "surrol_cross_task", video_backend="pyav").num_episodes == 4


def test_datasets_recorded_side_by_side_are_those_recorded_one_by_one(recorded, tmp_path):
    alone = record("NeedleRegrasp", 2, 0, tmp_path / "alone", 0.3)
    assert files(recorded / "surrol_needle_regrasp") == files(alone)


def test_by_default_episodes_are_the_published_ones(recorded):
    for name in ("surrol_needle_reach", "surrol_needle_regrasp"):
        assert differing_episodes(recorded / name) == []


def test_what_is_complete_stays_as_it_is(recorded, two_tasks, capsys):
    before = {path: path.stat().st_mtime_ns for path in recorded.rglob("*")}
    collection.record_all(recorded, episodes=2)
    assert {path: path.stat().st_mtime_ns for path in recorded.rglob("*")} == before
    assert "surrol_cross_task is complete already" in capsys.readouterr().out


def test_an_interrupted_recording_goes_on_to_the_same_bytes(recorded, two_tasks, tmp_path, monkeypatch):
    root = tmp_path / "datasets"
    with monkeypatch.context() as patch:

        def interrupted(bar, number=1):
            raise KeyboardInterrupt

        patch.setattr(collection.tqdm, "update", interrupted)
        with pytest.raises(KeyboardInterrupt):
            collection.record_all(root, episodes=2, workers=1)
    assert not (root / "surrol_cross_task").exists()
    collection.record_all(root, episodes=2, workers=1)
    assert files(root) == files(recorded)


def test_one_bar_shows_all_episodes(two_tasks, tmp_path, capfd):
    collection.record_all(tmp_path / "datasets", episodes=1, workers=2)
    shown = capfd.readouterr().err
    assert "2/2" in shown
    assert "Writing the dataset" not in shown


def test_films_of_all_tasks_are_recorded_and_left_out_of_the_merger(two_tasks, tmp_path, capsys):
    collection.record_all(tmp_path, episodes=1, extras=Extras(["openh"], ["overview", "closeup"], 32), workers=2)
    films = LeRobotDataset("local/x", root=tmp_path / "surrol_needle_regrasp", video_backend="pyav").meta
    merged = LeRobotDataset("local/x", root=tmp_path / "surrol_cross_task", video_backend="pyav").meta
    assert films.camera_keys == ["observation.images.overview", "observation.images.closeup"]
    assert not merged.camera_keys
    assert "Left out" in capsys.readouterr().out


# Bad input and bad luck: one clear error each.


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"workers": 0}, "0"),
        ({"episodes": 0}, "0"),
        ({"disturb": 2.0}, "2.0"),
        ({"extras": Extras(cameras=["both_arms"])}, "NeedleReach.*closeup, overview"),
    ],
    ids=["no workers", "no episodes", "disturbed too much", "a camera that one task lacks"],
)
def test_bad_arguments_leave_no_trace(two_tasks, tmp_path, options, named):
    with pytest.raises(ValueError, match=named):
        collection.record_all(tmp_path / "datasets", **options)
    assert not list(tmp_path.iterdir())


def test_other_recordings_in_the_folder_are_refused(recorded, two_tasks):
    before = files(recorded)
    with pytest.raises(ValueError, match="seed"):
        collection.record_all(recorded, episodes=2, seed=5)
    assert files(recorded) == before


def test_a_merger_of_other_recordings_is_not_taken_for_this_one(recorded, two_tasks, tmp_path):
    (tmp_path / "surrol_cross_task/meta").mkdir(parents=True)
    (tmp_path / "surrol_cross_task/meta/surrol.json").write_text(json.dumps({"merged_from": []}))
    for name in ("surrol_needle_reach", "surrol_needle_regrasp"):
        (tmp_path / name).symlink_to(recorded / name)
    with pytest.raises(ValueError, match="surrol_cross_task was not merged from these recordings"):
        collection.record_all(tmp_path, episodes=2)


def test_something_else_in_the_place_of_a_recording_is_told_before_any_task_is_begun(two_tasks, tmp_path):
    (tmp_path / "surrol_needle_regrasp.recording").mkdir()
    (tmp_path / "surrol_needle_regrasp.recording/thesis.txt").write_text("ten years of work")
    with pytest.raises(ValueError, match="surrol_needle_regrasp.recording exists and was not written by"):
        collection.record_all(tmp_path, episodes=1, workers=2)
    assert files(tmp_path) == {"surrol_needle_regrasp.recording/thesis.txt": b"ten years of work"}
    assert len(list(tmp_path.iterdir())) == 1


def test_a_second_command_in_the_same_folder_is_refused(two_tasks, tmp_path, at_work):
    at_work(tmp_path / "surrol_needle_regrasp.recording")
    with pytest.raises(OSError, match="another `gcdt` command is at work in .*surrol_needle_regrasp.recording"):
        collection.record_all(tmp_path, episodes=1, workers=2)
    assert not (tmp_path / "surrol_cross_task").exists()


# Units, under datatrove's executors.

ALONE = """
import surrol_gym

surrol_gym.TASKS = ("NeedleReach", "NeedleRegrasp")

import sys

import gcdt_cli

gcdt_cli.main(sys.argv[1:])
"""


def test_a_unit_records_one_task_and_what_was_not_done_is_done_in_the_end(recorded, two_tasks, tmp_path):
    unit, _ = collection.recording_units(tmp_path / "datasets", episodes=2)
    unit()
    assert [path.name for path in (tmp_path / "datasets").iterdir()] == ["surrol_needle_regrasp"]
    collection.record_all(tmp_path / "datasets", episodes=2, workers=1)
    assert files(tmp_path / "datasets") == files(recorded)


def test_units_are_refused_before_anything_is_written(recorded, two_tasks, tmp_path):
    with pytest.raises(ValueError, match="at least one episode"):
        collection.recording_units(tmp_path / "datasets", episodes=0)
    with pytest.raises(ValueError, match="holds a recording with seed = 0, not 5"):
        collection.recording_units(recorded, episodes=2, seed=5)
    assert not list(tmp_path.iterdir())


@pytest.mark.study  # every worker imports the package anew
def test_a_command_that_was_killed_goes_on_under_an_executor_to_the_same_bytes(recorded, two_tasks, tmp_path, capsys):
    pytest.importorskip("datatrove")
    root = tmp_path / "datasets"
    command = ["record", "--all", "--episodes", "2", "--root", str(root), "--executor", "local"]
    killed = subprocess.Popen([sys.executable, "-c", ALONE, *command, "--workers", "2"], start_new_session=True)
    while not list(root.glob("*.recording/*.npz")):
        assert killed.poll() is None
    os.killpg(killed.pid, signal.SIGKILL)
    killed.wait()
    assert not (root / "surrol_cross_task").exists()
    cli.main([*command, "--workers", "1"])
    assert files(root) == files(recorded)
    assert capsys.readouterr().out.count("matches the manifest") == 2


def test_a_dry_run_shows_the_jobs_of_slurm(two_tasks, tmp_path, capsys):
    pytest.importorskip("datatrove")
    command = ["record", "--all", "--root", str(tmp_path / "datasets"), "--executor", "slurm", "--dry_run"]
    cli.main([*command, "--partition", "cpu", "--time", "01:00:00"])
    shown = capsys.readouterr().out
    for line in ("--array=0-1\n", "--partition=cpu\n", "--dependency=afterok:JOB_1\n"):
        assert line in shown
    assert not list(tmp_path.iterdir())


# The command.


def test_the_command_compares_with_the_manifest(recorded, two_tasks, capsys):
    cli.main(["record", "--all", "--episodes", "2", "--root", str(recorded)])
    assert capsys.readouterr().out.count("matches the manifest") == 2


def test_a_difference_from_the_manifest_is_told_and_ends_with_status_1(recorded, two_tasks, tmp_path, capsys):
    manifest = tmp_path / "manifest.json"
    command = ["record", "--all", "--episodes", "2", "--root", str(recorded), "--manifest", str(manifest)]
    cli.main([*command, "--write_manifest"])
    entries = json.loads(manifest.read_text())
    seeds = list(entries["surrol_needle_regrasp"]["sha256_by_seed"])
    entries["surrol_needle_regrasp"]["sha256_by_seed"][seeds[1]] = "0"
    manifest.write_text(json.dumps(entries))
    before = files(recorded)
    with pytest.raises(SystemExit) as end:
        cli.main(command)
    printed = capsys.readouterr().out
    assert "surrol_needle_reach matches the manifest" in printed
    assert "surrol_needle_regrasp differs from the manifest in 1 episodes: 1" in printed
    assert "differ from the published ones" in end.value.code
    assert files(recorded) == before


def test_without_a_manifest_the_command_says_that_nothing_was_compared(recorded, two_tasks, tmp_path, capsys):
    nowhere = str(tmp_path / "manifest.json")
    cli.main(["record", "--all", "--episodes", "2", "--root", str(recorded), "--manifest", nowhere])
    assert f"There is no {nowhere}" in capsys.readouterr().out


def test_the_name_of_a_dataset_is_that_of_its_task_in_small_letters():
    assert collection.dataset_name("NeedlePick") == "surrol_needle_pick"
    assert len({collection.dataset_name(task) for task in surrol_gym.TASKS}) == len(surrol_gym.TASKS)
