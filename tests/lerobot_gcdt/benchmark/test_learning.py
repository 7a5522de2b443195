"""A benchmark of learning: every cell trained and evaluated once, alike, and nothing lost by an interruption."""

import json
import shutil

import pandas as pd
import pytest

from lerobot_gcdt import GENERALIST
from lerobot_gcdt.benchmark import learning
from lerobot_gcdt.benchmark.learning import Benchmark
from lerobot_gcdt.benchmark.methods import parse_method

STARTS = range(20_000, 20_002)
DEMONSTRATIONS = 4
"""Episodes of each dataset."""
SMALL = (
    "small=gcdt --policy.layers=1 --policy.width=16 --policy.heads=2 --policy.inner_width=16 --steps=2 "
    "--policy.dtype=bfloat16"  # the other one is trained in float32
)


def benchmark(*arguments, **options):
    return Benchmark(*arguments, **options).run()


@pytest.fixture(scope="module")
def datasets(needle_reach_root, needle_pick_root, tmp_path_factory):
    """Folder of two datasets, named as the published ones."""
    folder = tmp_path_factory.mktemp("benchmark") / "datasets"
    for root in (needle_reach_root, needle_pick_root):
        shutil.copytree(root, folder / f"surrol_{root.name}")
    return folder


@pytest.fixture(scope="module")
def whole(datasets, command):
    """The folder and the episodes of two cells that were really trained, of four steps and of two.

    The perceptron in this process, to be quick; GCDT in a process of its own, as always.
    """
    output, given = datasets.parent / "whole", []
    methods = {"methods": ["bc", SMALL], "steps": 4, "points": 2, "options": ["--policy.device=cpu"]}
    train = learning.train

    def train_perceptrons_here(dataset, folder, policy, *others, launcher, options):
        train(dataset, folder, policy, *others, launcher=None if policy == "bc" else launcher, options=options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learning, "train", train_perceptrons_here)
        command(lambda: given.append(benchmark(datasets, output, ["NeedleReach"], seeds=[5], starts=STARTS, **methods)))
    return output, given[0]


@pytest.fixture
def asked(monkeypatch):
    """The trainings asked for, folder and arguments; nothing is trained or drawn, and every episode succeeds."""
    calls = []

    def train(dataset, folder, policy, stage, start, steps, launcher, options):
        calls.append((dataset, folder, policy, stage, start, steps, options))

    def evaluate_checkpoint(checkpoint, tasks, seeds, file, sensors):
        return pd.DataFrame({"task": tasks[0], "seed": seeds, "reached": True, "held": True, "steps": 9.0})

    monkeypatch.setattr(learning, "train", train)
    monkeypatch.setattr(learning, "evaluate_checkpoint", evaluate_checkpoint)
    monkeypatch.setattr(learning, "training_seconds", lambda folder, step: float(step))
    monkeypatch.setattr(learning, "write_report", lambda episodes, output: None)
    return calls


def cells(asked, output):
    return [folder.relative_to(output).as_posix() for _, folder, *_ in asked]


# What is measured.


def test_every_checkpoint_is_evaluated_from_the_same_starts(whole):
    _, episodes = whole
    cell = ["method", "task", "demonstrations", "training_seed"]
    columns = [*cell, "step", "seconds", "seed", "reached", "held", "steps"]
    assert list(episodes.columns) == columns
    rows = episodes[["method", "step", "seed"]].itertuples(index=False)
    points = [("bc", 2), ("bc", 4), ("small", 1), ("small", 2)]
    assert sorted(map(tuple, rows)) == [(*point, seed) for point in points for seed in STARTS]
    assert set(episodes.training_seed) == {5} and set(episodes.task) == {"NeedleReach"}
    assert set(episodes.demonstrations) == {DEMONSTRATIONS}


def test_seconds_increase_along_a_training(whole):
    seconds = whole[1].groupby(["method", "step"]).seconds.agg(["min", "max"])
    assert (seconds["min"] == seconds["max"]).all()
    for _, of_one in seconds["min"].groupby("method"):
        assert of_one.iloc[0] > 0 and of_one.diff().iloc[1] > 0


def test_the_results_lie_in_the_output_folder(whole):
    output, episodes = whole
    kept = pd.read_parquet(output / "episodes.parquet")
    pd.testing.assert_frame_equal(kept, episodes, check_like=True)
    assert f"| NeedleReach | small | {DEMONSTRATIONS} | 1 | 2 | 2 |" in (output / "success.md").read_text()
    assert (output / "success.png").read_bytes().startswith(b"\x89PNG")


def test_cells_differ_in_nothing_but_method_task_and_seed(datasets, tmp_path, asked):
    methods = ["bc", "short=bc --steps=400 --policy.frames_per_sample=9"]
    benchmark(datasets, tmp_path, ["NeedleReach"], methods, [7], steps=1000, starts=STARTS, options=["--batch_size=2"])
    root, common = datasets / "surrol_needle_reach", ["--batch_size=2"]
    ends = ["--seed=7", "--save_freq=250", "--log_freq=25"], ["--seed=7", "--save_freq=100", "--log_freq=5"]
    own = [*common, "--policy.frames_per_sample=9"]
    assert asked == [
        (root, tmp_path / "bc/NeedleReach/7", "bc", None, None, 1000, [*common, *ends[0]]),
        (root, tmp_path / "short/NeedleReach/7", "bc", None, None, 400, [*own, *ends[1]]),
    ]


def test_all_cells_of_the_first_seed_come_first(datasets, tmp_path, asked):
    benchmark(datasets, tmp_path, ["NeedleReach", "NeedlePick"], ["bc", "gcdt"], [0, 1], starts=STARTS)
    first = ["bc/NeedleReach/0", "gcdt/NeedleReach/0", "bc/NeedlePick/0", "gcdt/NeedlePick/0"]
    assert cells(asked, tmp_path) == first + [cell.replace("/0", "/1") for cell in first]


def test_each_number_of_demonstrations_has_a_training_of_its_own_from_the_first_ones(datasets, tmp_path, asked):
    numbers = {"demonstrations": [1, 3, DEMONSTRATIONS], "starts": STARTS}
    episodes = benchmark(datasets, tmp_path, ["NeedleReach"], ["bc"], [0], **numbers)
    assert cells(asked, tmp_path) == ["bc/NeedleReach_1/0", "bc/NeedleReach_3/0", "bc/NeedleReach/0"]
    assert [[o for o in options if "episodes" in o] for *_, options in asked] == [
        ["--dataset.episodes=[0]"],
        ["--dataset.episodes=[0, 1, 2]"],
        [],
    ]
    assert set(episodes.demonstrations) == {1, 3, DEMONSTRATIONS}
    benchmark(datasets, tmp_path, ["NeedleReach"], ["bc"], [0], starts=STARTS)
    assert len(asked) == 3, "all of them are the whole dataset"


def test_a_training_on_the_first_demonstrations_sees_no_other(datasets, tmp_path, command, monkeypatch):
    monkeypatch.setattr(learning, "PROCESS", None)  # in this one; another would import LeRobot anew
    small = {"methods": ["bc"], "steps": 2, "points": 1, "options": ["--policy.device=cpu"], "demonstrations": [1]}
    command(lambda: benchmark(datasets, tmp_path, ["NeedleReach"], seeds=[0], starts=STARTS, **small))
    [settings] = tmp_path.glob("bc/NeedleReach_1/0/checkpoints/000002/pretrained_model/train_config.json")
    assert json.loads(settings.read_text())["dataset"]["episodes"] == [0]


# Going on.


def test_finished_cells_are_not_repeated_even_without_their_checkpoints(whole, datasets, asked, tmp_path):
    output = tmp_path / "again"
    shutil.copytree(whole[0], output, ignore=shutil.ignore_patterns("checkpoints"))
    methods = {"methods": ["bc", SMALL], "steps": 4, "points": 2, "options": ["--policy.device=cpu"]}
    again = benchmark(datasets, output, ["NeedleReach"], seeds=[5], starts=STARTS, **methods)
    assert not asked
    pd.testing.assert_frame_equal(again, whole[1])


def test_an_interrupted_benchmark_goes_on_with_the_cell_that_it_was_at(datasets, tmp_path, asked, monkeypatch):
    command = {"tasks": ["NeedleReach"], "methods": ["bc"], "seeds": [0, 1, 2], "starts": STARTS}
    whole, fake = [], learning.train

    def interrupted(dataset, folder, *arguments, **options):
        if folder.name == "1":
            raise KeyboardInterrupt
        whole.append(folder.name)

    monkeypatch.setattr(learning, "train", interrupted)
    with pytest.raises(KeyboardInterrupt):
        benchmark(datasets, tmp_path, **command)
    assert whole == ["0"] and set(pd.read_parquet(tmp_path / "episodes.parquet").training_seed) == {0}
    monkeypatch.setattr(learning, "train", fake)
    assert set(benchmark(datasets, tmp_path, **command).training_seed) == {0, 1, 2}
    assert cells(asked, tmp_path) == ["bc/NeedleReach/1", "bc/NeedleReach/2"]


def test_further_cells_and_starts_are_added_to_what_there_is(datasets, tmp_path, asked):
    benchmark(datasets, tmp_path, ["NeedleReach"], ["bc"], [0], starts=STARTS)
    benchmark(datasets, tmp_path, ["NeedleReach"], ["gcdt"], [0], starts=STARTS)
    given = benchmark(datasets, tmp_path, ["NeedleReach"], ["bc"], [0], starts=range(20_000, 20_003))
    assert cells(asked, tmp_path) == ["bc/NeedleReach/0", "gcdt/NeedleReach/0", "bc/NeedleReach/0"]
    assert set(given.method) == {"bc"} and len(given) == 4 * 3
    kept = pd.read_parquet(tmp_path / "episodes.parquet")
    assert kept.groupby("method").size().to_dict() == {"bc": 4 * 3, "gcdt": 4 * 2}
    assert not kept.duplicated(learning.EPISODE).any()


def test_a_name_never_comes_to_stand_for_another_method(datasets, tmp_path, asked):
    benchmark(datasets, tmp_path, ["NeedleReach"], ["mine=bc --steps=8"], [0], starts=STARTS)
    for other in ("mine=gcdt --steps=8", "mine=bc --steps=4", "mine=bc --steps=8 --batch_size=2"):
        with pytest.raises(ValueError, match="mine holds the method .*; choose another name"):
            benchmark(datasets, tmp_path, ["NeedleReach"], ["bc", other], [0], starts=STARTS)
    assert len(asked) == 1 and not (tmp_path / "bc").exists()


def test_a_name_never_comes_to_stand_for_another_dataset(datasets, needle_pick_root, tmp_path, asked):
    request = {"tasks": ["NeedleReach"], "methods": ["bc"], "seeds": [0], "starts": STARTS}
    benchmark(datasets, tmp_path / "out", **request)
    shutil.copytree(needle_pick_root, tmp_path / "plain/surrol_needle_reach")
    shutil.copytree(datasets / "surrol_needle_reach", tmp_path / "moved/surrol_needle_reach")
    with pytest.raises(ValueError, match="other data than those of surrol_needle_reach in .*plain; .* --output"):
        benchmark(tmp_path / "plain", tmp_path / "out", **request | {"methods": ["gcdt"]})
    assert not (tmp_path / "out/gcdt").exists()
    benchmark(tmp_path / "moved", tmp_path / "out", **request)
    benchmark(datasets, tmp_path / "out", **request | {"tasks": ["NeedlePick"]})
    assert set(json.loads((tmp_path / "out/datasets.json").read_text())) == {
        "surrol_needle_reach",
        "surrol_needle_pick",
    }
    assert len(asked) == 2


# Units, under datatrove's executors.


def request(datasets, output, **changed):
    """All arguments of a benchmark."""
    sizes = {"seeds": [0, 1], "steps": None, "points": 4, "starts": STARTS}
    asked = {"datasets": datasets, "output": output, "tasks": ["NeedleReach"], "methods": ["bc"], **sizes}
    return asked | {"options": [], "sensors": None} | changed


def test_a_unit_is_a_training_that_is_not_finished(datasets, tmp_path, asked):
    benchmark(**request(datasets, tmp_path, seeds=[0]))
    units = Benchmark(**request(datasets, tmp_path, seeds=[0, 1, 2])).units()
    for unit in units:
        unit()
    assert len(units) == 2
    assert cells(asked, tmp_path) == ["bc/NeedleReach/0", "bc/NeedleReach/1", "bc/NeedleReach/2"]


def test_tasks_that_are_learned_together_are_one_unit(datasets, tmp_path, asked):
    shutil.copytree(datasets / "surrol_needle_reach", tmp_path / "datasets/all_tasks")
    together = {"tasks": ["NeedleReach", "NeedlePick"], "methods": ["one=gcdt --dataset=all_tasks --steps=8"]}
    assert len(Benchmark(**request(tmp_path / "datasets", tmp_path / "out", **together)).units()) == 2  # seeds


def test_units_can_be_looked_at_without_writing(datasets, tmp_path, asked):
    assert Benchmark(**request(datasets, tmp_path)).units(write=False)
    assert not list(tmp_path.iterdir())


def test_what_units_did_is_collected_without_training(whole, datasets, tmp_path, capfd):
    output = tmp_path / "units"
    shutil.copytree(whole[0], output, symlinks=True)
    for name in ("episodes.parquet", "success.md", "success.png"):
        (output / name).unlink()
    sizes = {"seeds": [5], "steps": 4, "points": 2, "options": ["--policy.device=cpu"]}
    collected = benchmark(**request(datasets, output, methods=["bc", SMALL], **sizes))
    pd.testing.assert_frame_equal(collected, whole[1])
    assert capfd.readouterr().out.count("is complete already") == 2


# Methods.


def test_a_method_is_a_type_or_a_name_and_what_it_stands_for():
    assert parse_method("bc", 4) == ("bc", "bc", 24_000, 4, (), None, None)
    long = parse_method("long=gcdt --policy.context_length=100 --steps=8", 2, 9, ["--batch_size=2"])
    assert long == ("long", "gcdt", 8, 2, ("--batch_size=2", "--policy.context_length=100"), None, None)
    assert list(long.checkpoints) == [4, 8]
    spaced = parse_method("long=gcdt --policy.context_length 100 --steps 8", 2)
    assert (spaced.steps, spaced.options) == (8, ("--policy.context_length", "100"))


def test_a_method_may_begin_with_a_checkpoint(datasets, tmp_path, asked):
    tuned = f"tuned=gcdt --start={GENERALIST}"
    benchmark(datasets, tmp_path, ["NeedleReach", "NeedlePick"], [tuned], [0], starts=STARTS)
    assert cells(asked, tmp_path) == ["tuned/NeedleReach/0", "tuned/NeedlePick/0"]
    assert all((start, steps) == (str(GENERALIST), 2000) for *_, start, steps, _ in asked)


def test_a_method_may_learn_all_tasks_together(datasets, tmp_path, asked):
    shutil.copytree(datasets / "surrol_needle_reach", tmp_path / "datasets/all_tasks")
    command = {"tasks": ["NeedleReach", "NeedlePick"], "methods": ["one=gcdt --dataset=all_tasks --steps=8"]}
    episodes = benchmark(tmp_path / "datasets", tmp_path / "out", seeds=[0], starts=STARTS, **command)
    assert [dataset.name for dataset, *_ in asked] == ["all_tasks", "all_tasks"]
    assert cells(asked, tmp_path / "out") == ["one/all_tasks/0", "one/all_tasks/0"]  # the second time it is complete
    assert set(episodes.task) == {"NeedleReach", "NeedlePick"}


def test_of_several_tasks_each_counts_its_own_demonstrations(uneven_root, tmp_path, asked):
    shutil.copytree(uneven_root, tmp_path / "datasets/all_tasks")  # four episodes of NeedlePick, one of NeedleReach
    command = {"tasks": ["NeedleReach", "NeedlePick"], "methods": ["one=gcdt --dataset=all_tasks --steps=8"]}
    episodes = benchmark(tmp_path / "datasets", tmp_path / "out", seeds=[0], starts=STARTS, **command)
    assert dict(episodes.groupby("task").demonstrations.first()) == {"NeedlePick": 4, "NeedleReach": 1}


def test_all_cells_see_through_the_same_sensors(datasets, tmp_path, asked):
    request = {"tasks": ["NeedleReach"], "methods": ["bc"], "seeds": [0], "starts": STARTS}
    episodes = benchmark(datasets, tmp_path, sensors={"position_std": 0.01, "action_std": 0.1}, **request)
    assert set(episodes.position_std) == {0.01} and set(episodes.action_std) == {0.1} and set(episodes.delay) == {0}
    with pytest.raises(ValueError, match="keeps episodes of other sensors than .*; choose another --output"):
        benchmark(datasets, tmp_path, **request)


def test_the_expert_is_a_method_that_learns_nothing(datasets, tmp_path, asked, monkeypatch):
    arguments = (datasets, tmp_path, ["NeedleReach"], ["expert"], [1, 2])
    episodes = benchmark(*arguments, demonstrations=[1, 3], starts=STARTS)
    told = episodes[["method", "demonstrations", "training_seed", "seconds", "seed", "held"]]
    assert told.values.tolist() == [["expert", 0, 0, 0.0, seed, True] for seed in STARTS]
    assert not asked
    monkeypatch.setattr(learning, "evaluate", None)
    again = benchmark(*arguments, starts=STARTS)
    pd.testing.assert_frame_equal(again, episodes)


def test_an_expert_that_was_interrupted_goes_on(datasets, tmp_path, monkeypatch):
    ask = Benchmark(datasets, tmp_path, ["NeedleReach"], ["expert"], starts=STARTS)
    [unit] = ask.units()
    unit()
    monkeypatch.setattr(learning, "evaluate", None)
    assert list(ask.run().seed) == [*STARTS]


def test_no_more_checkpoints_are_evaluated_than_there_are_steps(datasets, tmp_path, asked):
    command = {"tasks": ["NeedleReach"], "methods": ["vinn"], "seeds": [0], "starts": STARTS}
    assert set(benchmark(datasets, tmp_path, **command).step) == {1}
    benchmark(datasets, tmp_path, **command)
    assert len(asked) == 1, "the second call finds the cell finished"


# Bad input.


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"methods": ["bc", "gdct"], "steps": 4}, "Unknown policy type 'gdct'; choose one of act, bc"),
        ({"methods": ["../bc=bc"]}, "'../bc=bc' is no method; write .* such as gcdt"),
        ({"methods": [""]}, "'' is no method"),
        ({"methods": ["bc", "bc"]}, "at least one method, each once"),
        ({"methods": ["vqbet"]}, "type vqbet .* --steps"),
        ({"methods": ["bc=bc --steps=many"]}, "The method bc has --steps=many"),
        ({"methods": ["bc=bc --steps"]}, "A method's --steps needs a value"),
        ({"methods": ["bc=bc --seed=3"]}, "--seed=3 of lerobot-train is set by gcdt; say it with --seeds"),
        ({"options": ["--steps=5"]}, "--steps=5 .* say it with --steps"),
        ({"options": ["--save_freq", "5"]}, "--save_freq .* say it with --points"),
        ({"methods": ["best=expert --steps=3"]}, "best is the scripted expert, which takes no options: --steps=3"),
        ({"methods": ["tuned=gcdt --start=nowhere"]}, "nowhere holds no checkpoint"),
        ({"methods": [f"tuned=bc --start={GENERALIST}"]}, "tuned is a policy of type bc, .* one of type gcdt"),
        ({"methods": ["one=bc --dataset=both"]}, "both holds no dataset; `gcdt record --all --root"),
        ({"methods": ["wide=bc --policy.width=9"]}, "method wide: .*`width` are not valid for BCConfig"),
        ({"methods": ["wide=bc policy.width=9"]}, "method wide: unrecognized arguments: policy.width=9"),
        ({"tasks": ["NeedleReach", "NeedleSew"]}, "Unknown task 'NeedleSew'; choose one of NeedleReach"),
        ({"tasks": ["NeedleReach", "NeedleReach-v0"]}, "at least one task, each once"),
        ({"tasks": ["NeedleReach", "MatchBoard"]}, "gcdt record --task MatchBoard --root .*surrol_match_board"),
        ({"seeds": [0, -1]}, "at least one seed, .* no negative one; got .*-1"),
        ({"seeds": []}, "at least one seed"),
        ({"starts": range(0)}, "seeds from 0 on"),
        ({"steps": 0}, "positive, got 0"),
        ({"steps": 10, "points": 4}, "10 steps of the method bc cannot be divided into 4 equal parts"),
        ({"steps": 3, "points": 7}, "3 steps of the method bc cannot be divided into 7 equal parts"),
        ({"points": 0}, "divided into 0"),
        ({"demonstrations": [2, 5]}, "surrol_needle_reach holds 4 demonstrations, .* cannot learn from 5"),
        ({"demonstrations": [0]}, "cannot learn from 0"),
        ({"demonstrations": [2, 2]}, "at least one number of demonstrations, each once"),
        (
            {"demonstrations": [2], "methods": ["one=bc --dataset=surrol_needle_reach"]},
            "The method one learns several tasks together, from all",
        ),
        ({"sensors": {"dropout": 2}}, "dropout is a probability, .* got 2"),
    ],
    ids=lambda value: str(value) if isinstance(value, dict) else "",
)
def test_a_bad_request_is_told_before_anything_is_written(datasets, tmp_path, asked, changed, told):
    request = {"tasks": ["NeedleReach"], "methods": ["bc"], "seeds": [0], "starts": STARTS} | changed
    with pytest.raises((ValueError, FileNotFoundError), match=told) as error:
        benchmark(datasets, tmp_path / "new", **request)
    assert "\n" not in str(error.value)
    assert not asked and not list(tmp_path.iterdir())


def test_episodes_that_do_not_tell_their_demonstrations_are_left_alone(datasets, tmp_path, asked):
    benchmark(datasets, tmp_path, ["NeedleReach"], ["bc"], [0], starts=STARTS)
    file = tmp_path / "episodes.parquet"
    pd.read_parquet(file).drop(columns="demonstrations").to_parquet(file)
    with pytest.raises(ValueError, match="written by an earlier version; choose another --output"):
        benchmark(datasets, tmp_path, ["NeedleReach"], ["bc"], [0], starts=STARTS)


def test_a_folder_with_something_else_is_left_alone(datasets, tmp_path, asked):
    (tmp_path / "bc").mkdir()
    (tmp_path / "bc/thesis.txt").write_text("ten years of work")
    with pytest.raises(ValueError, match="bc exists and is no method of a benchmark; choose another --output"):
        benchmark(datasets, tmp_path, ["NeedleReach"], ["bc"], [0], starts=STARTS)
    assert [file.name for file in tmp_path.rglob("*")] == ["bc", "thesis.txt"] and not asked
