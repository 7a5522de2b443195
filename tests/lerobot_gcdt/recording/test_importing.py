"""Importing: the datasets of recorded episodes again, from archives in which nothing but numbers is believed."""

import json
import os
import pickle
import re
import zipfile
from io import BytesIO

import gymnasium as gym
import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata

import gcdt_cli as cli
import surrol_gym
from lerobot_gcdt import GCDTPolicy
from lerobot_gcdt.hub.cards import dataset_card
from lerobot_gcdt.hub.checks import check_card, check_dataset
from lerobot_gcdt.recording import import_demonstrations, importing, merge
from lerobot_gcdt.recording.importing import read_episodes
from lerobot_gcdt.recording.unpickling import read_archive


def demonstrate(task, seeds, steps=None):
    """Demonstrations as SurRoL stores them: ``acs``, ``obs`` with one observation more, ``info``."""
    env = gym.make(f"surrol/{task}-v0")
    expert, demonstrations = surrol_gym.make_expert(env), {"acs": [], "obs": [], "info": []}
    for seed in seeds:
        observation, _ = env.reset(seed=seed)
        actions, observations, infos = [], [observation], []
        for _ in range(steps or env.spec.max_episode_steps):
            actions.append(expert.act(observation))
            observation, _, _, _, info = env.step(actions[-1])
            observations.append({key: value.astype(np.float64) for key, value in observation.items()})
            infos.append({"is_success": np.float32(info["is_success"])})
        for name, values in (("acs", actions), ("obs", observations), ("info", infos)):
            demonstrations[name].append(values)
    env.close()
    return {"acs": np.array(demonstrations["acs"], np.float64)} | {
        name: np.array(demonstrations[name], dtype=object) for name in ("obs", "info")
    }


def save(file, arrays):
    np.savez_compressed(file, **arrays)
    return file


def plain(arrays, *names):
    """The same as plain arrays."""
    stacked = {key: np.array([[o[key] for o in episode] for episode in arrays["obs"]]) for key in arrays["obs"][0, 0]}
    columns = {"actions": arrays["acs"], "observations": stacked["observation"]}
    columns |= {name: stacked[name.removesuffix("s")] for name in ("achieved_goals", "desired_goals")}
    return {name: columns[name] for name in names or columns}


@pytest.fixture(scope="module")
def picks():
    """The four episodes of ``needle_pick_root``."""
    return demonstrate("NeedlePick", range(4))


@pytest.fixture(scope="module")
def archive(picks, tmp_path_factory):
    """File of these in SurRoL's layout."""
    return save(tmp_path_factory.mktemp("old") / "data_NeedlePickRL-v0_random_4.npz", picks)


@pytest.fixture(scope="module")
def imported(archive):
    """Folder of the dataset of these."""
    return import_demonstrations([archive], "NeedlePick", archive.parent / "imported")


@pytest.fixture
def needle_pick():
    env = gym.make("surrol/NeedlePick-v0")
    yield env.unwrapped
    env.close()


def facts(root):
    return json.loads((root / "meta/surrol.json").read_text())


def refused(arguments, root):
    """The line that ``gcdt import`` ends with; nothing is written."""
    with pytest.raises(SystemExit) as end:
        cli.main(["import", *map(str, arguments), "--root", str(root)])
    assert "\n" not in end.value.code
    assert not root.exists() and not root.with_name(root.name + ".importing").exists()
    return end.value.code


# What becomes of good files.


def test_an_archive_of_surrol_gives_the_dataset_of_the_recorded_episodes(imported, needle_pick_root):
    assert facts(needle_pick_root)["seeds"] == [0, 1, 2, 3]
    assert pq.read_table(imported / "data").equals(pq.read_table(needle_pick_root / "data"))
    for file in ("meta/info.json", "meta/stats.json"):
        assert (imported / file).read_text() == (needle_pick_root / file).read_text()


@pytest.mark.parametrize("names", [(), ("actions", "observations", "desired_goals")], ids=["all", "no achieved goals"])
def test_plain_arrays_give_the_same_episodes(picks, archive, names, needle_pick, tmp_path):
    episodes = read_episodes(save(tmp_path / "plain.npz", plain(picks, *names)), needle_pick)
    for mine, theirs in zip(episodes, read_episodes(archive, needle_pick), strict=True):
        for key, values in theirs.items():
            np.testing.assert_array_equal(mine[key], values)


def test_plain_arrays_may_hold_a_single_episode_of_any_length(picks, needle_pick, tmp_path):
    whole = {name: values[0] for name, values in plain(picks).items()}
    short = {name: values[: 10 + (name != "actions")] for name, values in whole.items()}
    [episode] = read_episodes(save(tmp_path / "short.npz", short), needle_pick)
    np.testing.assert_array_equal(episode["action"], picks["acs"][0, :10].astype(np.float32))


def test_episodes_of_different_lengths_in_one_archive(picks, needle_pick, tmp_path):
    acs, obs = np.empty(2, object), np.empty(2, object)
    for i, steps in enumerate((50, 30)):
        acs[i], obs[i] = picks["acs"][i, :steps], list(picks["obs"][i, : steps + 1])
    episodes = read_episodes(save(tmp_path / "ragged.npz", {"acs": acs, "obs": obs}), needle_pick)
    assert [len(episode["action"]) for episode in episodes] == [50, 30]


def test_the_metadata_keep_what_is_known_of_the_origin(imported, archive):
    told = facts(imported)
    assert told["env_id"] == "surrol/NeedlePick-v0" and told["seed"] is None
    [origin] = told["imported_from"]
    assert origin["file"] == archive.name and len(origin["sha256"]) == 64
    assert (told["episodes"], told["attempts"], told["frames"]) == (4, 4, 200)


def test_episodes_without_success_are_left_out_and_told(picks, tmp_path, capsys):
    save(tmp_path / "two.npz", {name: values[:2].copy() for name, values in picks.items()})
    failing = picks["obs"][:1].copy()
    failing[0] = [o | {"desired_goal": o["desired_goal"] + 1} for o in failing[0]]
    save(tmp_path / "failed.npz", picks | {"acs": picks["acs"][:1], "obs": failing})
    root = import_demonstrations([tmp_path / "two.npz", tmp_path / "failed.npz"], "NeedlePick", tmp_path / "root")
    assert (facts(root)["episodes"], facts(root)["attempts"]) == (2, 3)
    assert "1 more never reach the goal" in capsys.readouterr().out


def test_a_turn_that_surrols_expert_added_to_a_yaw_is_taken_away(tmp_path):
    boards = demonstrate("MatchBoard", [0], steps=3)
    for moment in boards["obs"][0]:
        moment["observation"] = np.append(moment["observation"][:-1], np.pi + 0.05)
    env = gym.make("surrol/MatchBoard-v0").unwrapped
    [episode] = read_episodes(save(tmp_path / "board.npz", boards), env)
    env.close()
    np.testing.assert_allclose(episode["observation"][:, -1], 0.05 - np.pi, rtol=1e-6)


def test_what_was_imported_merges_trains_and_has_a_card(imported, needle_pick_root, tiny_config, tmp_path):
    merged = merge([imported, needle_pick_root], tmp_path / "merged")
    for root in (imported, merged):
        check_dataset(root)
        check_card(card := dataset_card(root), "dataset")
        assert "gcdt import data_NeedlePickRL-v0_random_4.npz --task NeedlePick --root datasets/" in card
        assert "imported by lerobot-policy-gcdt" in card
    policy = GCDTPolicy(tiny_config, dataset_meta=LeRobotDatasetMetadata("local/merged", root=merged))
    optimizer = torch.optim.AdamW(policy.parameters(), lr=1e-3)
    for _ in range(2):
        loss, _ = policy.forward({"index": torch.tensor([0, 399])})
        loss.backward()
        optimizer.step()
    assert torch.isfinite(loss)


def test_a_card_of_an_import_claims_neither_experts_nor_seeds_nor_a_licence(imported):
    assert not {"seed", "scripted", "license: apache-2.0"} & set(
        re.findall(r"license: \S+|\w+", dataset_card(imported))
    )


# What is refused: one clear line, and nothing is written.


class Forbidden:
    def __reduce__(self):
        return os.mkdir, ("executed",)


def pickled(file, content):
    """An archive with a pickle in ``obs``."""
    np.lib.format.write_array_header_1_0(header := BytesIO(), {"descr": "|O", "fortran_order": False, "shape": (1,)})
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("obs.npy", header.getvalue() + content)
    return file


@pytest.mark.parametrize("member", ["acs", "obs", "info"])
def test_a_forbidden_class_is_named_and_nothing_is_executed(picks, member, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save(tmp_path / "evil.npz", picks | {member: np.array([Forbidden()], dtype=object)})
    line = refused(["evil.npz", "--task", "NeedlePick"], tmp_path / "root")
    assert f"evil.npz is refused: {member} holds {os.mkdir.__module__}.mkdir" in line
    assert not (tmp_path / "executed").exists()


@pytest.mark.parametrize("name", ["_frombuffer", "fromfile", "memmap", "matrix", "load", "__builtins__"])
def test_nothing_else_of_numpy_is_admitted(name, tmp_path):
    with pytest.raises(ValueError, match=f"holds numpy.{name}"):
        read_archive(pickled(tmp_path / "evil.npz", f"cnumpy\n{name}\n.".encode()))


def test_bytes_never_become_pointers(tmp_path):
    """A data type whose pickled flags deny that its items are objects, in an array whose content is bytes."""
    genuine = pickle.dumps(np.array([None], dtype=object), protocol=3)
    forged = genuine.replace(b"K?tq", b"K\x00tq").replace(b"]q\rNa", b"C\x08AAAAAAAAq\r")
    assert forged != genuine
    with pytest.raises(ValueError, match="does not fit its shape"):
        read_archive(pickled(tmp_path / "evil.npz", forged))


@pytest.mark.parametrize("content", [[1, 2], [1, 2, 3, 4], b"12345678"], ids=["fewer", "more", "bytes"])
def test_an_array_holds_as_many_items_as_its_shape_says(content, tmp_path):
    class Lying:
        def __reduce__(self):
            made, arguments, state = np.array([1, 2, 3], dtype=object).__reduce__()
            return made, arguments, (*state[:-1], content)

    with pytest.raises(ValueError, match="does not fit its shape"):
        read_archive(pickled(tmp_path / "evil.npz", pickle.dumps(Lying(), protocol=4)))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda a: a | {"acs": a["acs"][..., :4]}, "episode 0: action has the shape (50, 4); NeedlePick needs (50, 5)"),
        (lambda a: a | {"obs": a["obs"][:, :-1]}, "(50, 19); NeedlePick needs (51, 19)"),
        (lambda a: a | {"obs": a["obs"][:3]}, "4 of acs, 3 of obs"),
        (lambda a: a | {"acs": a["acs"][:0], "obs": a["obs"][:0]}, "no episode"),
        (lambda a: a | {"acs": np.where(a["acs"] > 0, np.nan, a["acs"])}, "action holds a number that is not finite"),
        (lambda a: a | {"acs": 3 * a["acs"]}, "they lie in [-1, 1]"),
        (lambda a: {"acs": a["acs"]}, "holds acs, but"),
        (lambda a: a | {"obs": np.full_like(a["obs"], None)}, "not laid out"),
    ],
    ids=[
        *("size of an action", "no last observation", "fewer observations", "empty", "not finite", "large actions"),
        *("no observations", "no dictionaries"),
    ],
)
def test_a_file_that_does_not_fit_the_task_is_refused(picks, change, named, tmp_path):
    file = save(tmp_path / "bad.npz", change(picks))
    line = refused([file, "--task", "NeedlePick"], tmp_path / "root")
    assert str(file) in line and named in line


def test_a_file_of_another_task_is_refused(archive, tmp_path):
    assert "needs (51, 7)" in refused([archive, "--task", "NeedleReach"], tmp_path / "root")


def test_positions_in_metres_are_refused(picks, tmp_path):
    metres = picks["obs"].copy()
    for i in np.ndindex(metres.shape):
        metres[i] = {key: value / 5 for key, value in metres[i].items()}
    file = save(tmp_path / "metres.npz", picks | {"obs": metres})
    assert "psm1_dx = 1 moves psm1_x by 0.00994, but by 0.05" in refused([file, "--task", "NeedlePick"], tmp_path / "x")


@pytest.mark.parametrize("factor", [0.01, 0], ids=["metres", "zero"])
def test_actions_too_small_for_the_motion_are_refused(picks, factor, tmp_path):
    file = save(tmp_path / "small.npz", picks | {"acs": picks["acs"] * factor})
    line = refused([file, "--task", "NeedlePick"], tmp_path / "root")
    assert "psm1_x moves by up to 0.0" in line and "psm1_dx = 1 moves it by 0.05" in line


def test_an_arm_that_hardly_moves_may_have_small_actions(picks, needle_pick, tmp_path):
    still = {name: values[:1].copy() for name, values in picks.items()}
    still["acs"] *= 0
    still["obs"][0] = [still["obs"][0, 0]] * len(still["obs"][0])
    [episode] = read_episodes(save(tmp_path / "still.npz", still), needle_pick)
    assert not episode["action"].any()


@pytest.mark.parametrize(("key", "told"), [("desired_goal", "changes by 0.5"), ("achieved_goal", "differs by 0.5")])
def test_goals_that_contradict_the_episode_are_refused(picks, key, told, tmp_path):
    wrong = picks["obs"].copy()
    wrong[2, 7] = wrong[2, 7] | {key: wrong[2, 7][key] + 0.5}
    line = refused([save(tmp_path / "wrong.npz", picks | {"obs": wrong}), "--task", "NeedlePick"], tmp_path / "root")
    assert f"episode 2: {key} {told}" in line


def test_turns_of_another_version_are_refused(tmp_path):
    pegs = demonstrate("PegTransfer", range(2))
    pegs["acs"][..., 3] /= 1.5  # as where a full action turns by 30 degrees instead of 20
    line = refused([save(tmp_path / "pegs.npz", pegs), "--task", "PegTransfer"], tmp_path / "root")
    assert "psm1_dyaw" in line and "multiply this number of the actions by 1.49" in line


def test_achieved_goals_that_observations_do_not_hold_are_missed(tmp_path):
    reaches = plain(demonstrate("NeedleReach", [0]), "actions", "observations", "desired_goals")
    line = refused([save(tmp_path / "reach.npz", reaches), "--task", "NeedleReach"], tmp_path / "root")
    assert "needs achieved_goals" in line


def test_files_in_which_nobody_succeeds_are_refused(picks, tmp_path):
    file = save(tmp_path / "short.npz", picks | {"acs": picks["acs"][:, :5], "obs": picks["obs"][:, :6]})
    assert "None of the 4 episodes reaches the goal" in refused([file, "--task", "NeedlePick"], tmp_path / "root")


def test_what_is_no_archive_is_named(tmp_path):
    (tmp_path / "thesis.npz").write_text("ten years of work")
    assert "thesis.npz is no .npz archive" in refused([tmp_path / "thesis.npz", "--task", "NeedlePick"], tmp_path / "x")
    assert "nowhere.npz" in refused([tmp_path / "nowhere.npz", "--task", "NeedlePick"], tmp_path / "x")
    assert "NeedleThread" in refused([tmp_path / "thesis.npz", "--task", "NeedleThread"], tmp_path / "x")


def test_the_same_file_twice_is_refused(archive, tmp_path):
    assert "same content" in refused([archive, archive, "--task", "NeedlePick"], tmp_path / "root")


# Interruptions and existing folders.


def test_an_interrupted_import_leaves_nothing_and_is_repeated_by_the_same_call(
    archive, imported, tmp_path, monkeypatch
):
    def interrupted(columns):
        raise KeyboardInterrupt

    root = tmp_path / "root"
    with monkeypatch.context() as patch:
        patch.setattr(importing, "to_columns", interrupted)
        with pytest.raises(KeyboardInterrupt):
            import_demonstrations([archive], "NeedlePick", root)
    assert not list(tmp_path.iterdir())
    import_demonstrations([archive], "NeedlePick", root)
    assert pq.read_table(root / "data").equals(pq.read_table(imported / "data"))


def test_a_finished_import_is_complete_and_not_taken_for_another(archive, imported, picks, tmp_path, capsys):
    import_demonstrations([archive], "NeedlePick", imported)
    assert "complete already" in capsys.readouterr().out
    other = save(tmp_path / "other.npz", {name: values[:2] for name, values in picks.items()})
    with pytest.raises(ValueError, match="was not imported from these files"):
        import_demonstrations([other], "NeedlePick", imported)


def test_a_second_import_into_the_same_folder_is_refused(archive, tmp_path, at_work):
    at_work(tmp_path / "root.importing")
    with pytest.raises(OSError, match="another `gcdt` command is at work"):
        import_demonstrations([archive], "NeedlePick", tmp_path / "root")
