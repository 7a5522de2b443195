"""All stages of training in one command: in order, each from the one before it."""

import pytest

import surrol_gym


@pytest.fixture
def stages(monkeypatch):
    """The stages that are asked for: name of the output folder, dataset, stage, and start."""
    calls = []

    def train(dataset, output, policy, stage, start, **options):
        assert policy is None and set(options) == {"device", "launcher"}
        calls.append((output.name, dataset.name, stage, start and start.name))

    monkeypatch.setattr("lerobot_gcdt.training.train", train)
    return calls


@pytest.fixture
def datasets(tmp_path):
    """A folder in which two datasets lie."""
    for name in ("surrol_cross_task", "surrol_needle_pick"):
        (tmp_path / "datasets" / name).mkdir(parents=True)
    return tmp_path / "datasets"


def test_stages_follow_each_other_whatever_their_order_is(run_example, datasets, stages):
    run_example("train_all", f"--datasets={datasets}", "--stages=NeedlePick,generalist,pretrain")
    assert stages == [
        ("pretrain", "surrol_cross_task", "pretrain", None),
        ("generalist", "surrol_cross_task", "generalist", "pretrain"),
        ("NeedlePick", "surrol_needle_pick", "finetune", "generalist"),
    ]


def test_missing_datasets_are_named_before_anything_is_trained(run_example, datasets, stages, capsys):
    with pytest.raises(SystemExit):
        run_example("train_all", f"--datasets={datasets}", "--stages=pretrain,PegTransfer,NeedlePick")
    error = capsys.readouterr().err.splitlines()[-1]
    assert f"no surrol_peg_transfer; `gcdt record --all --root {datasets}`" in error
    assert not stages


def test_a_stage_whose_start_is_missing_ends_with_one_line(run_example, datasets, tmp_path):
    (datasets / "surrol_needle_pick/meta").mkdir()
    (datasets / "surrol_needle_pick/meta/info.json").touch()
    with pytest.raises(SystemExit, match=rf"^NeedlePick: {tmp_path}/generalist holds no checkpoint; .*$"):
        run_example("train_all", f"--datasets={datasets}", f"--output={tmp_path}", "--stages=NeedlePick")


def test_an_unknown_stage_names_the_known_ones(run_example, stages, capsys):
    with pytest.raises(SystemExit):
        run_example("train_all", "--stages=NeedleSew")
    error = capsys.readouterr().err
    assert "NeedleSew" in error and all(task in error for task in surrol_gym.TASKS)
