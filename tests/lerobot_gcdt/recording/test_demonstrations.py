"""A recording holds successful, replayable episodes, and the same command always ends with the same bytes."""

import errno
import itertools
import json
import os
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pyarrow.parquet as pq
import pytest
from lerobot.datasets.lerobot_dataset import LeRobotDataset

import surrol_gym
from lerobot_gcdt.recording import demonstrations, writing

ROOTS = ["needle_pick_root", "needle_reach_root", "disturbed_root"]


def files(folder: Path) -> dict[str, bytes]:
    """Every file under a folder, by relative path."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in Path(folder).rglob("*") if p.is_file()}


def facts(root: Path) -> dict:
    return json.loads((root / "meta" / "surrol.json").read_text())


def episodes(root: Path) -> list[dict[str, np.ndarray]]:
    """The dataset's columns, an entry an episode, read without LeRobot."""
    table = pq.read_table(root / "data")
    columns = {name: np.stack(table[name].to_numpy()) for name in table.column_names}
    order = np.lexsort((columns["frame_index"], columns["episode_index"]))
    columns = {name: column[order] for name, column in columns.items()}
    return [
        {name: column[columns["episode_index"] == i] for name, column in columns.items()}
        for i in np.unique(columns["episode_index"])
    ]


@pytest.fixture(params=ROOTS)
def root(request):
    """Each of the recorded datasets."""
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="module")
def disturbed_root(tmp_path_factory):
    """The folder of a NeedleRegrasp dataset of two episodes in which the arms were pushed."""
    return demonstrations.record("NeedleRegrasp", 2, 0, tmp_path_factory.mktemp("disturbed") / "needle_regrasp", 0.3)


@pytest.fixture(scope="module")
def reach_pair(tmp_path_factory):
    """The folder of a NeedleReach dataset of two episodes."""
    return demonstrations.record("NeedleReach", 2, 0, tmp_path_factory.mktemp("pair") / "needle_reach")


# What a dataset holds.


def test_every_episode_reaches_the_goal(root):
    assert all(episode["next.success"].any() for episode in episodes(root))


def test_as_many_episodes_as_asked_for(root):
    assert len(episodes(root)) == facts(root)["episodes"]


def test_episodes_run_to_the_time_limit(root):
    limit = gym.spec(facts(root)["env_id"]).max_episode_steps
    assert {len(episode["action"]) for episode in episodes(root)} == {limit}


def test_failed_attempts_are_left_out(tmp_path, monkeypatch):
    run_episode = demonstrations.run_episode

    def fails_at_seed_1(env, seed, *options):
        episode = run_episode(env, seed, *options)
        return episode | {"success": episode["success"] & (seed != 1)}

    monkeypatch.setattr(demonstrations, "run_episode", fails_at_seed_1)
    root = demonstrations.record("NeedleReach", 2, 0, tmp_path / "reach")
    assert facts(root)["seeds"] == [0, 2]
    assert facts(root)["attempts"] == 3
    np.testing.assert_array_equal(episodes(root)[1]["action"], replay(root, 2)["action"])


@pytest.mark.parametrize("successes", [0, 2])
def test_an_expert_that_fails_again_and_again_is_an_error_that_keeps_what_is_finished(tmp_path, monkeypatch, successes):
    ran = []

    def fails_after_successes(env, seed, *options):
        ran.append(seed)
        assert len(ran) < 200, "it never ends"
        return {"success": np.array([seed < successes])}

    monkeypatch.setattr(demonstrations, "run_episode", fails_after_successes)
    for _ in range(2):  # the second time, no attempt is repeated
        advice = f"with --episodes {successes}, or start" if successes else "Start"
        told = f"NeedleReach.* 50 times in a row.* the {successes} successful .*{advice} from another seed"
        with pytest.raises(RuntimeError, match=told):
            demonstrations.record("NeedleReach", 3, 0, tmp_path / "reach")
        assert ran == list(range(successes + 50))
    assert not (tmp_path / "reach").exists()
    assert len(list((tmp_path / "reach.recording").glob("*.npz"))) == len(ran)


def test_failures_that_are_not_in_a_row_are_no_error(tmp_path, monkeypatch):
    run_episode = demonstrations.run_episode

    def succeeds_every_thirtieth_time(env, seed, *options):
        return run_episode(env, seed, *options) if seed % 30 == 29 else {"success": np.array([False])}

    monkeypatch.setattr(demonstrations, "run_episode", succeeds_every_thirtieth_time)
    assert facts(demonstrations.record("NeedleReach", 2, 0, tmp_path / "reach"))["seeds"] == [29, 59]


def test_the_summary_tells_success_rate_and_steps(tmp_path, monkeypatch, capsys):
    run_episode = demonstrations.run_episode

    def fails_at_seed_0(env, seed, *options):
        episode = run_episode(env, seed, *options)
        return episode | {"success": episode["success"] & (seed != 0)}

    monkeypatch.setattr(demonstrations, "run_episode", fails_at_seed_0)
    root = demonstrations.record("NeedleReach", 1, 0, tmp_path / "reach")
    printed = capsys.readouterr().out
    assert "0.500" in printed
    assert str(facts(root)["steps_to_success"][0]) in printed


def test_features_are_those_of_the_design(root):
    env = gym.make(facts(root)["env_id"])
    o, g, a = (len(getattr(env.unwrapped, f"{kind}_names")) for kind in ("observation", "goal", "action"))
    env.close()
    features = LeRobotDataset("local/x", root=root).features
    bookkeeping = {"timestamp", "frame_index", "episode_index", "index", "task_index"}
    assert {key: (f["dtype"], *f["shape"]) for key, f in features.items() if key not in bookkeeping} == {
        "observation.state": ("float32", o),
        "observation.environment_state": ("float32", g),
        "observation.goal": ("float32", g),
        "observation.achieved_goal": ("float32", g),
        "observation.time_to_goal": ("float32", 1),
        "action": ("float32", a),
        "disturbance": ("float32", a),
        "next.reward": ("float32", 1),
        "next.success": ("bool", 1),
    }


def test_every_number_has_a_name_of_its_own(root):
    features = LeRobotDataset("local/x", root=root).features
    for key in [key for key in features if key.startswith(("observation.", "action", "disturbance", "next."))]:
        assert len(set(features[key]["names"])) == features[key]["shape"][0], key


def test_a_frame_is_one_control_step(root):
    env = gym.make(facts(root)["env_id"])
    fps = env.metadata["render_fps"]
    env.close()
    assert LeRobotDataset("local/x", root=root).fps == fps == 5


def test_the_task_is_the_sentence_of_the_environment(root):
    env = gym.make(facts(root)["env_id"])
    sentence = env.unwrapped.task_description
    env.close()
    assert list(LeRobotDataset("local/x", root=root).meta.tasks.index) == [sentence]


def test_time_to_goal_counts_down_to_the_first_success_and_stays_zero(root):
    for episode in episodes(root):
        to_first = np.flatnonzero(episode["next.success"])[0] + 1 - np.arange(len(episode["next.success"]))
        np.testing.assert_array_equal(episode["observation.time_to_goal"], np.maximum(to_first, 0))


def test_steps_to_success_are_where_time_to_goal_starts(root):
    starts = [episode["observation.time_to_goal"][0] for episode in episodes(root)]
    assert facts(root)["steps_to_success"] == starts


def test_reward_is_zero_in_success_and_minus_one_otherwise(root):
    for episode in episodes(root):
        np.testing.assert_array_equal(episode["next.reward"], np.where(episode["next.success"], 0, -1))


def test_the_goal_appears_for_lerobots_own_policies_too(root):
    for episode in episodes(root):
        np.testing.assert_array_equal(episode["observation.environment_state"], episode["observation.goal"])


# Replaying.


def replay(root: Path, seed: int, actions=None) -> dict[str, np.ndarray]:
    """Runs an episode from its seed in a new environment, by the given actions or the expert's."""
    env = gym.make(facts(root)["env_id"])
    try:
        if actions is None:
            return demonstrations.run_episode(env, seed, facts(root)["disturb"])
        observation, _ = env.reset(seed=seed)
        frames = []
        for action in actions:
            following, reward, _, _, info = env.step(action)
            frames.append(observation | {"reward": reward, "success": info["is_success"]})
            observation = following
        return {key: np.stack([frame[key] for frame in frames]) for key in frames[0]}
    finally:
        env.close()


def test_every_episode_replays_from_its_seed_and_its_columns_to_the_same_numbers(root):
    for seed, episode in zip(facts(root)["seeds"], episodes(root), strict=True):
        replayed = replay(root, seed, episode["action"] + episode["disturbance"])
        np.testing.assert_array_equal(episode["observation.state"], replayed["observation"])
        np.testing.assert_array_equal(episode["observation.goal"], replayed["desired_goal"])
        np.testing.assert_array_equal(episode["observation.achieved_goal"], replayed["achieved_goal"])
        np.testing.assert_array_equal(episode["next.reward"], replayed["reward"])
        np.testing.assert_array_equal(episode["next.success"], replayed["success"])


def test_the_expert_repeats_its_actions_from_the_seed(root):
    seed, episode = facts(root)["seeds"][-1], episodes(root)[-1]
    np.testing.assert_array_equal(episode["action"], replay(root, seed)["action"])


def test_episodes_without_pushes_have_no_disturbance(needle_pick_root):
    for episode in episodes(needle_pick_root):
        assert not episode["disturbance"].any() and not np.signbit(episode["disturbance"]).any()


# Disturbed demonstrations.


def test_a_disturbed_recording_holds_what_run_episode_gives(tmp_path):
    root = demonstrations.record("NeedleReach", 1, 0, tmp_path / "reach", disturb=0.5)
    seed = facts(root)["seeds"][0]
    env = gym.make("surrol/NeedleReach-v0")
    clean, disturbed = demonstrations.run_episode(env, seed), demonstrations.run_episode(env, seed, disturb=0.5)
    env.close()
    assert not np.array_equal(disturbed["observation"], clean["observation"])
    assert np.array_equal(episodes(root)[0]["observation.state"], disturbed["observation"])
    assert np.array_equal(episodes(root)[0]["action"], disturbed["action"])


def test_a_disturbed_dataset_differs_and_tells_how_much_it_was_disturbed(reach_pair, tmp_path):
    root = demonstrations.record("NeedleReach", 2, 0, tmp_path / "reach", disturb=0.5)
    assert (facts(root)["disturb"], facts(reach_pair)["disturb"]) == (0.5, 0)
    data = "data/chunk-000/file-000.parquet"
    assert files(root)[data] != files(reach_pair)[data]
    with pytest.raises(ValueError, match="disturb"):
        demonstrations.record("NeedleReach", 2, 0, root)


@pytest.mark.parametrize("disturb", [-0.1, 1.5, float("nan")])
def test_a_disturbance_out_of_range_leaves_no_trace(tmp_path, disturb):
    with pytest.raises(ValueError, match=str(disturb)):
        demonstrations.record("NeedleReach", 1, 0, tmp_path / "reach", disturb=disturb)
    assert not list(tmp_path.iterdir())


# Other programs read it.


def test_imperfect_sensors_show_the_data_and_not_the_expert(reach_pair, tmp_path):
    root = demonstrations.record("NeedleReach", 2, 0, tmp_path / "noisy", sensors={"position_std": 0.01})
    assert facts(root)["sensors"]["position_std"] == 0.01
    for perfect, shown in zip(episodes(reach_pair), episodes(root), strict=True):
        for key in ("action", "next.success", "observation.goal"):
            assert np.array_equal(perfect[key], shown[key])
        noise = shown["observation.achieved_goal"] - perfect["observation.achieved_goal"]
        assert noise.std() == pytest.approx(0.01, rel=0.3)


@pytest.mark.parametrize(
    ("sensors", "told"), [({"delay": -1}, "delay must be a whole number"), ({"action_std": 0.1}, "have no action_std")]
)
def test_bad_sensors_leave_no_trace(tmp_path, sensors, told):
    with pytest.raises(ValueError, match=told):
        demonstrations.record("NeedleReach", 2, 0, tmp_path / "noisy", sensors=sensors)
    assert not list(tmp_path.iterdir())


def test_lerobot_loads_the_dataset(root):
    dataset = LeRobotDataset("local/x", root=root)
    stored = episodes(root)
    assert dataset.num_episodes == len(stored)
    assert len(dataset) == sum(len(episode["action"]) for episode in stored)
    np.testing.assert_array_equal(dataset[len(stored[0]["action"])]["action"], stored[1]["action"][0])


# The same command, the same bytes.


def test_the_same_arguments_give_the_same_bytes_in_another_folder(reach_pair, tmp_path):
    again = demonstrations.record("NeedleReach", 2, 0, tmp_path / "another_name")
    assert files(again) == files(reach_pair)


def test_another_seed_gives_other_data(reach_pair, tmp_path):
    other = demonstrations.record("NeedleReach", 2, 5, tmp_path / "other")
    assert files(other)["data/chunk-000/file-000.parquet"] != files(reach_pair)["data/chunk-000/file-000.parquet"]


def test_every_episode_is_told_once_and_nothing_printed(tmp_path, capfd):
    told = []
    for _ in range(2):  # the second call finds the dataset complete
        demonstrations.record("NeedleReach", 2, 0, tmp_path / "reach", on_episode=lambda: told.append(None))
    assert len(told) == 4
    assert not "".join(capfd.readouterr()).replace("argv[0]=\n", "")


def test_recording_leaves_nothing_beside_the_dataset(reach_pair):
    assert [path.name for path in reach_pair.parent.iterdir()] == [reach_pair.name]


def test_a_second_call_changes_nothing(reach_pair, capsys):
    def state():
        return {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in sorted(reach_pair.parent.rglob("*"))}

    before, contents = state(), files(reach_pair)
    assert demonstrations.record("NeedleReach", 2, 0, reach_pair) == reach_pair
    assert state() == before
    assert files(reach_pair) == contents
    assert "complete" in capsys.readouterr().out


def test_a_dataset_goes_into_a_folder_whose_parents_do_not_exist(tmp_path):
    root = demonstrations.record("NeedleReach", 1, 0, tmp_path / "deep" / "deeper" / "reach")
    assert len(episodes(root)) == 1


# Interruptions.

# Ends the recording with SIGKILL: before the k-th time that Python touches the folder, in the middle of an episode, and
# at random moments, one after the other as long as the dataset is not whole. Children are forked, so that the imports
# are paid for once.
_KILLED = """
import os, random, signal, sys, time
from lerobot_gcdt.recording import demonstrations
from surrol_gym.envs.psm_env import PSMEnv

TOUCHES = ("open", "os.mkdir", "os.rename", "os.rmdir", "os.remove", "shutil.rmtree")

def die():
    os.kill(os.getpid(), signal.SIGKILL)

def count_touches(folder, at, call):
    seen = 0
    def hook(event, arguments):
        nonlocal seen
        if event in TOUCHES and any(str(a).startswith(folder) for a in arguments[:2]):
            seen += 1
            if seen == at:
                call()
    sys.addaudithook(hook)
    return lambda: seen

def count_steps(at, call):
    apply, seen = PSMEnv._apply_action, 0
    def counting(self, action):
        nonlocal seen
        seen += 1
        if seen == at:
            call()
        return apply(self, action)
    PSMEnv._apply_action = counting

def in_child(work):
    child = os.fork()
    if child:
        return os.waitpid(child, 0)[1]
    work()
    sys.stdout.flush()
    os._exit(0)

def record(folder):
    demonstrations.record("NeedleReach", 2, 0, folder, 0.3)

def new(name):
    os.mkdir(os.path.join(sys.argv[1], name))
    return os.path.join(sys.argv[1], name, "dataset")

def killed(name, arm):
    folder = new(name)
    status = in_child(lambda: (arm(folder), record(folder)))
    assert os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL, (name, status)
    assert in_child(lambda: record(folder)) == 0, name

def killed_at_random(times, seconds):
    draw, kills, runs = random.Random(0), 0, 0
    while kills < times:
        folder, runs = new(f"random_{runs}"), runs + 1
        while kills < times and not os.path.exists(folder):
            child = os.fork()
            if not child:
                record(folder)
                os._exit(0)
            time.sleep(draw.uniform(0, seconds))
            os.kill(child, signal.SIGKILL)
            kills += os.WIFSIGNALED(os.waitpid(child, 0)[1])
        assert in_child(lambda: record(folder)) == 0, folder

def uninterrupted():
    folder = new("uninterrupted")
    seen = count_touches(folder, 0, die)
    record(folder)
    with open(os.path.join(sys.argv[1], "touches"), "w") as stream:
        stream.write(str(seen()))

started = time.monotonic()
assert in_child(uninterrupted) == 0
duration = time.monotonic() - started
touches = int(open(os.path.join(sys.argv[1], "touches")).read())
os.remove(os.path.join(sys.argv[1], "touches"))
kills = int(sys.argv[2])
for at in sorted({*range(1, touches, touches // kills + 1), touches - 1, touches}):
    killed(f"touch_{at}", lambda folder, at=at: count_touches(folder, at, die))
killed("step", lambda folder: count_steps(75, die))
killed_at_random(kills, duration)
"""


@pytest.fixture(scope="module", params=[2, pytest.param(100, marks=pytest.mark.study)], ids="{} kills".format)
def killed_recordings(request, tmp_path_factory):
    """Folders of recordings that were killed once and run again, and of one that was not."""
    folder = tmp_path_factory.mktemp("killed")
    command = [sys.executable, "-c", _KILLED, str(folder), str(request.param)]
    environment = os.environ | {"PYTHONHASHSEED": "7"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=3000)
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks children to kill")
def test_a_killed_recording_goes_on_to_the_same_bytes(killed_recordings):
    expected = files(killed_recordings / "uninterrupted" / "dataset")
    different = [run.name for run in sorted(killed_recordings.iterdir()) if files(run / "dataset") != expected]
    assert expected
    assert not different


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks children to kill")
def test_another_process_records_the_same_bytes(killed_recordings, tmp_path):
    here = demonstrations.record("NeedleReach", 2, 0, tmp_path / "reach", 0.3)
    assert files(killed_recordings / "uninterrupted" / "dataset") == files(here)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks children to kill")
def test_a_killed_recording_leaves_nothing_beside_the_dataset_in_the_end(killed_recordings):
    leftovers = {
        run.name: beside
        for run in sorted(killed_recordings.iterdir())
        if (beside := [path.name for path in run.iterdir() if path.name != "dataset"])
    }
    assert not leftovers


def fills_up(monkeypatch, owner, name: str, call: int):
    """Lets the disk be full when a function is called for the given time."""
    original, calls = getattr(owner, name), itertools.count(1)

    def write(*arguments, **options):
        if next(calls) == call:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return original(*arguments, **options)

    monkeypatch.setattr(owner, name, write)


@pytest.mark.parametrize(
    ("owner", "name", "call", "finished"),
    [
        (np, "savez_compressed", 2, 1),
        (LeRobotDataset, "add_frame", 60, 2),
        (LeRobotDataset, "save_episode", 2, 2),
        (LeRobotDataset, "finalize", 1, 2),
        (writing, "tidy_statistics", 1, 2),
    ],
    ids=["second episode", "frame of the dataset", "episode of the dataset", "end of the dataset", "statistics"],
)
def test_a_full_disk_keeps_what_is_finished_and_says_so(reach_pair, tmp_path, monkeypatch, owner, name, call, finished):
    root = tmp_path / "reach"
    with monkeypatch.context() as patch:
        fills_up(patch, owner, name, call)
        with pytest.raises(OSError, match="No space left .* finished episodes are kept, repeat the command"):
            demonstrations.record("NeedleReach", 2, 0, root)
    assert not root.exists()
    assert len(list((tmp_path / "reach.recording").glob("*.npz"))) == finished
    demonstrations.record("NeedleReach", 2, 0, root)
    assert files(root) == files(reach_pair)
    assert [path.name for path in tmp_path.iterdir()] == ["reach"]


@pytest.mark.parametrize("largest", [2_000, 12_000, 30_000])
def test_files_that_cannot_grow_keep_what_is_finished(reach_pair, tmp_path, largest):
    resource = pytest.importorskip("resource")
    root, limits = tmp_path / "reach", resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, limits[1]))
    try:
        with pytest.raises(OSError, match="repeat the command"):
            demonstrations.record("NeedleReach", 2, 0, root, on_episode=lambda: None)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not root.exists()
    demonstrations.record("NeedleReach", 2, 0, root)
    assert files(root) == files(reach_pair)


def test_finished_episodes_are_not_run_again(tmp_path, interrupted_in_the_second):
    with pytest.raises(KeyboardInterrupt):
        demonstrations.record("NeedleReach", 2, 0, tmp_path / "reach")
    assert not (tmp_path / "reach").exists()
    demonstrations.record("NeedleReach", 2, 0, tmp_path / "reach")
    assert interrupted_in_the_second == [0, 1, 1]


@pytest.mark.parametrize("fewer", [1, 2])
def test_an_unfinished_recording_ends_with_another_number_of_episodes(
    reach_pair, tmp_path, interrupted_in_the_second, fewer
):
    with pytest.raises(KeyboardInterrupt):
        demonstrations.record("NeedleReach", 3, 0, tmp_path / "reach")
    root = demonstrations.record("NeedleReach", fewer, 0, tmp_path / "reach")
    assert facts(root)["episodes"] == len(episodes(root)) == fewer
    if fewer == 2:
        assert files(root) == files(reach_pair)
    assert [path.name for path in tmp_path.iterdir()] == ["reach"]


def test_finished_episodes_are_not_thrown_away_for_a_smaller_number(tmp_path, monkeypatch):
    run_episode = demonstrations.run_episode

    def interrupted_in_the_third(env, seed, *options):
        if seed == 2:
            raise KeyboardInterrupt
        return run_episode(env, seed, *options)

    monkeypatch.setattr(demonstrations, "run_episode", interrupted_in_the_third)
    with pytest.raises(KeyboardInterrupt):
        demonstrations.record("NeedleReach", 3, 0, tmp_path / "reach")
    before = files(tmp_path)
    with pytest.raises(ValueError, match="reach.recording holds 2 finished episodes, more than 1; ask for at least"):
        demonstrations.record("NeedleReach", 1, 0, tmp_path / "reach")
    assert files(tmp_path) == before


def test_a_second_process_in_the_same_folder_is_refused_until_the_first_is_gone(reach_pair, tmp_path, at_work):
    first = at_work(tmp_path / "reach.recording")
    before = files(tmp_path)
    with pytest.raises(OSError, match="another `gcdt` command is at work in .*reach.recording"):
        demonstrations.record("NeedleReach", 2, 0, tmp_path / "reach")
    assert files(tmp_path) == before
    first.kill()
    first.join()
    assert files(demonstrations.record("NeedleReach", 2, 0, tmp_path / "reach")) == files(reach_pair)
    assert [path.name for path in tmp_path.iterdir()] == ["reach"]


# Bad input: one clear error, nothing damaged.


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("NeedleReach", 2, 7), "seed"),
        (("NeedleReach", 3, 0), "episodes"),
        (("NeedlePick", 2, 0), "NeedlePick"),
    ],
    ids=["other seed", "other number of episodes", "other task"],
)
def test_a_folder_with_another_recording_stays_as_it_is(reach_pair, arguments, named):
    before = files(reach_pair)
    with pytest.raises(ValueError, match=named) as error:
        demonstrations.record(*arguments, reach_pair)
    assert str(reach_pair) in str(error.value)
    assert files(reach_pair) == before
    assert [path.name for path in reach_pair.parent.iterdir()] == [reach_pair.name]


def test_a_folder_with_another_unfinished_recording_stays_as_it_is(tmp_path, monkeypatch):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(demonstrations, "run_episode", interrupted)
    with pytest.raises(KeyboardInterrupt):
        demonstrations.record("NeedleReach", 2, 0, tmp_path / "reach")
    before = files(tmp_path)
    with pytest.raises(ValueError, match="seed"):
        demonstrations.record("NeedleReach", 2, 7, tmp_path / "reach")
    assert files(tmp_path) == before


@pytest.mark.parametrize("name", ["reach", "reach.recording"])
def test_a_folder_with_something_else_stays_as_it_is(tmp_path, name):
    (tmp_path / name).mkdir()
    (tmp_path / name / "thesis.txt").write_text("ten years of work")
    with pytest.raises(ValueError, match=name):
        demonstrations.record("NeedleReach", 1, 0, tmp_path / "reach")
    assert files(tmp_path) == {f"{name}/thesis.txt": b"ten years of work"}


def test_a_file_in_place_of_the_folder_stays_as_it_is(tmp_path):
    (tmp_path / "reach").write_text("a file")
    with pytest.raises(ValueError, match="reach"):
        demonstrations.record("NeedleReach", 1, 0, tmp_path / "reach")
    assert files(tmp_path) == {"reach": b"a file"}


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("NeedleThread", 1, 0), "NeedleThread"),
        (("NeedleReach", 0, 0), "0"),
        (("NeedleReach", -3, 0), "-3"),
        (("NeedleReach", 1, -1), "-1"),
    ],
    ids=["unknown task", "no episodes", "negative episodes", "negative seed"],
)
def test_bad_arguments_leave_no_trace(tmp_path, arguments, named):
    with pytest.raises(ValueError, match=named):
        demonstrations.record(*arguments, tmp_path / "reach")
    assert not list(tmp_path.iterdir())


def test_an_unknown_task_is_answered_with_the_known_ones(tmp_path):
    with pytest.raises(ValueError, match=", ".join(surrol_gym.TASKS)):
        demonstrations.record("NeedleThread", 1, 0, tmp_path / "reach")
