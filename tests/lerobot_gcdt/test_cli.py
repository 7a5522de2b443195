"""The console command ``gcdt``: helpful when asked, brief when wrong."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.policies.act.configuration_act import ACTConfig

import gcdt_cli as cli
from lerobot_gcdt import GENERALIST
from lerobot_gcdt.recording.features import Extras
from lerobot_gcdt.recording.fields import FIELDS
from lerobot_gcdt.training.recipes import STAGES

GCDT = Path(sys.executable).parent / "gcdt"


def help_of(arguments: list[str], capsys) -> str:
    with pytest.raises(SystemExit) as end:
        cli.main([*arguments, "--help"])
    assert end.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("arguments", [[], ["record"]], ids=["gcdt", "gcdt record"])
def test_help_shows_an_example(arguments, capsys):
    printed = " ".join(help_of(arguments, capsys).split())
    assert "gcdt record --task NeedlePick --episodes 100 --seed 0 --root" in printed


@pytest.mark.parametrize(
    ("command", "module"),
    [
        *zip(
            ("record", "import", "merge", "train", "evaluate", "benchmark", "publish", "export-dvrk"),
            cli.COMMANDS,
            strict=True,
        )
    ],
)
def test_the_example_in_the_help_is_a_valid_command(command, module, capsys, monkeypatch):
    calls = []
    monkeypatch.setattr(module, "run", calls.append)
    example = " ".join(help_of([command], capsys).split()).split("example: gcdt ")[1]
    cli.main(example.split(";")[0].split())
    assert calls[0].command == command


def test_all_published_datasets_are_recorded_with_their_settings(capsys, monkeypatch):
    calls = []
    monkeypatch.setattr(
        "lerobot_gcdt.recording.collection.record_all", lambda *arguments: calls.append(arguments) or []
    )
    example = " ".join(help_of(["record"], capsys).split()).split("published datasets: gcdt ")[1]
    cli.main(example.split())
    assert calls == [("datasets", 100, 0, 0.3, Extras(), None)]


def test_a_single_task_is_recorded_without_pushes_unless_they_are_asked_for(monkeypatch):
    calls = []
    monkeypatch.setattr("lerobot_gcdt.recording.record", lambda *arguments, learner, sensors: calls.append(arguments))
    command = ["record", "--task", "NeedlePick", "--root", "x"]
    cli.main(command)
    cli.main([*command, "--disturb", "0.5"])
    assert [arguments[4] for arguments in calls] == [0.0, 0.5]


def test_fields_and_cameras_are_lists(monkeypatch):
    calls = []
    monkeypatch.setattr("lerobot_gcdt.recording.record", lambda *arguments, learner, sensors: calls.append(arguments))
    command = ["record", "--task", "NeedlePick", "--root", "x", "--fields", "openh"]
    cli.main([*command, "--cameras", "overview, closeup", "--camera_size", "64"])
    assert calls[0][-1] == Extras(["openh"], ["overview", "closeup"], 64)


def test_record_makes_a_dataset(tmp_path, capsys):
    root = tmp_path / "reach"
    cli.main(["record", "--task", "NeedleReach", "--episodes", "1", "--seed", "3", "--root", str(root)])
    assert LeRobotDataset("local/reach", root=root).num_episodes == 1
    assert "success rate" in capsys.readouterr().out


def test_a_merge_ends_with_what_it_holds(needle_pick_root, needle_reach_root, tmp_path, capsys):
    root = tmp_path / "both"
    cli.main(["merge", str(needle_pick_root), str(needle_reach_root), "--root", str(root)])
    episodes = LeRobotDataset("local/both", root=root, video_backend="pyav").num_episodes
    assert capsys.readouterr().out.splitlines()[-1] == f"{root}: {episodes} episodes of 2 tasks"


def test_an_unknown_task_ends_with_one_line_and_no_traceback(tmp_path):
    command = [GCDT, "record", "--task", "NeedleThread", "--root", tmp_path / "x"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode != 0
    [line] = done.stderr.splitlines()
    assert "NeedleThread" in line and "NeedlePick" in line
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments",
    [
        *(["--help"], ["record", "--help"]),
        ["record", "--task", "NeedleReach", "--root", "x", "--episodes", "many"],
        ["record", "--task", "NeedleThread", "--root", "x"],
        ["train", "--dataset", "missing", "--output", "x"],
        ["evaluate", "missing"],
        ["benchmark", "--tasks", "NeedleReach", "--datasets", "missing"],
    ],
    ids=["help", "help of a command", "no number", "unknown task", "no dataset", "no training", "no datasets"],
)
def test_help_and_mistakes_are_answered_without_slow_imports(arguments):
    program = f"""
import json, sys
from gcdt_cli import main
try:
    main({arguments})
except SystemExit:
    print(json.dumps(list(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=120)
    loaded = {name.partition(".")[0] for name in json.loads(done.stdout.splitlines()[-1])}
    assert not loaded & {"torch", "lerobot", "lerobot_gcdt", "pybullet", "pandas", "matplotlib", "datasets"}


def test_the_help_names_all_fields(capsys):
    assert f"there is: {', '.join(FIELDS)} " in " ".join(help_of(["record"], capsys).split())


def test_the_help_names_all_stages(capsys):
    assert f"--stage {{{','.join(STAGES)}}}" in " ".join(help_of(["train"], capsys).split())


def test_threads_wait_passively_unless_the_user_wants_otherwise(capsys, monkeypatch):
    monkeypatch.delenv("OMP_WAIT_POLICY", raising=False)
    help_of([], capsys)
    assert os.environ["OMP_WAIT_POLICY"] == "passive"
    monkeypatch.setenv("OMP_WAIT_POLICY", "active")
    help_of([], capsys)
    assert os.environ["OMP_WAIT_POLICY"] == "active"


def test_train_passes_on_what_was_asked_for(tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr("lerobot_gcdt.training.train", lambda **arguments: calls.append(arguments))
    asked = {"dataset": tmp_path, "output": tmp_path / "x", "policy": "act", "stage": "finetune", "start": tmp_path}
    asked |= {"steps": 7, "device": "cpu", "launcher": "torchrun -m"}
    command = [part for name, value in asked.items() for part in (f"--{name}", str(value))]
    cli.main(["train", *command, "--", "--policy.chunk_size=5", "--seed=3"])
    assert calls == [asked | {"options": ["--policy.chunk_size=5", "--seed=3"]}]


def test_train_begins_with_the_built_in_policy_by_its_name(tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr("lerobot_gcdt.training.train", lambda **arguments: calls.append(arguments))
    cli.main(["train", "--dataset", str(tmp_path), "--output", str(tmp_path / "x"), "--start", "generalist"])
    assert calls[0]["start"] == GENERALIST


def test_benchmark_passes_on_what_was_asked_for(tmp_path, monkeypatch, capsys):
    calls = []
    cell = {"method": "bc", "task": "NeedlePick", "demonstrations": 9, "training_seed": 3}
    outcome = {"step": 8, "seconds": 7.0, "seed": [5, 6], "reached": True, "held": False, "steps": 9.0}
    episodes = pd.DataFrame(cell | outcome)
    monkeypatch.setattr(
        "lerobot_gcdt.benchmark.learning.Benchmark",
        lambda **arguments: calls.append(arguments) or SimpleNamespace(run=lambda: episodes),
    )
    folders = {"datasets": tmp_path, "output": tmp_path / "x"}
    command = ["benchmark", *(part for name, value in folders.items() for part in (f"--{name}", str(value)))]
    command += ["--tasks", "NeedlePick,NeedleReach", "--methods", "gcdt,bc", "wide=bc --policy.hidden_sizes=[9,9]"]
    command += ["--seeds", "3,4", "--steps", "8", "--points", "2", "--starts", "2", "--first_seed", "5"]
    command += ["--position_std", "0.01", "--action_std", "0.1", "--demonstrations", "4,9"]
    cli.main([*command, "--", "--policy.device=cpu"])
    asked = {"tasks": ["NeedlePick", "NeedleReach"], "methods": ["gcdt", "bc", "wide=bc --policy.hidden_sizes=[9,9]"]}
    asked |= {"seeds": [3, 4], "steps": 8, "points": 2, "starts": range(5, 7), "options": ["--policy.device=cpu"]}
    assert calls == [folders | asked | {"demonstrations": [4, 9], "sensors": {"position_std": 0.01, "action_std": 0.1}}]
    assert "| NeedlePick | bc | 9 | 1 | 2 | 8 | 7 | 1.00 (0.34-1.00) | 0.00 (0.00-0.66) |" in capsys.readouterr().out


def test_the_help_of_benchmark_says_what_starts_are_for(capsys):
    told = " ".join(help_of(["benchmark"], capsys).split())
    assert "20000, for validation: starts from 100000 on are for reporting" in told


def test_evaluate_shows_and_films_the_starts_that_were_asked_for(tmp_path, tiny_config, monkeypatch, capsys):
    tiny_config.save_pretrained(folder := tmp_path / "000001/pretrained_model")
    monkeypatch.setattr(
        "lerobot_gcdt.evaluation.evaluate_checkpoint",
        lambda checkpoint, tasks, seeds, file, sensors: pd.DataFrame(
            {"task": tasks[0], "seed": seeds, "reached": True, "held": False}
        ),
    )
    films, loaded = [], []
    monkeypatch.setattr("lerobot_gcdt.evaluation.load_policy", lambda path: loaded.append(path) or path)
    monkeypatch.setattr("lerobot_gcdt.evaluation.pictures.film", lambda *arguments, **_: films.append(arguments))
    tasks = "NeedlePick,NeedleReach,surrol/NeedleReach-v0"
    cli.main(["evaluate", str(folder), "--tasks", tasks, "--first_seed", "7", "--starts", "4", "--film"])
    assert "NeedlePick held    0.00" in (printed := capsys.readouterr().out)
    assert "4 starts, seeds 7-10" in printed
    assert films == [
        (folder, "NeedlePick", range(7, 10), folder.parent / "NeedlePick.mp4"),
        (folder, "surrol/NeedleReach-v0", range(7, 10), folder.parent / "NeedleReach.mp4"),
    ]
    assert loaded == [folder], "the policy is loaded once"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["train", "--dataset", "{}/none", "--output", "x"], "gcdt record --task TASK --root {}/none"),
        (["train", "--dataset", "{}", "--output", "x"], "gcdt record --task TASK --root {}"),
        (
            ["train", "--dataset", "{}", "--output", "x", "--start", "{}/none"],
            "gcdt train --dataset DATASET --output {}",
        ),
        (["evaluate", "{}"], "gcdt train --dataset DATASET --output {}"),
        (["evaluate", "{}", "--tasks", "NeedleSew"], "NeedlePick"),
    ],
    ids=["no dataset", "empty dataset", "no start", "no checkpoint", "unknown task"],
)
def test_what_training_and_evaluation_lack_is_told_with_the_command_that_makes_it(arguments, told, tmp_path):
    with pytest.raises(SystemExit) as end:
        cli.main([argument.format(tmp_path) for argument in arguments])
    assert told.format(tmp_path) in end.value.code and "\n" not in end.value.code
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("changed", "told"),
    [({"objectives": {"mine": 0.1}}, "lerobot_policy_"), ({"type": "theirs"}, "theirs")],
    ids=["an objective of a missing plugin", "a missing plugin"],
)
def test_a_checkpoint_of_a_missing_plugin_ends_with_one_line(tmp_path, changed, told):
    settings = json.loads((GENERALIST / "config.json").read_text())
    (tmp_path / "config.json").write_text(json.dumps(settings | changed))
    with pytest.raises(SystemExit, match=rf"^gcdt evaluate: [^\n]*{told}[^\n]*$"):
        cli.main(["evaluate", str(tmp_path)])


def test_an_expert_that_fails_ends_with_one_line(tmp_path, monkeypatch):
    failed = {"success": np.zeros(1, dtype=bool)}
    monkeypatch.setattr("lerobot_gcdt.recording.demonstrations.run_episode", lambda *arguments: failed)
    with pytest.raises(SystemExit) as end:
        cli.main(["record", "--task", "NeedleReach", "--root", str(tmp_path / "reach")])
    assert "times in a row" in end.value.code and "\n" not in end.value.code


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        (["--episodes", "0"], "0"),
        (["--seed", "-1"], "-1"),
        (["--task", "needlepick"], "needlepick"),
        (["--disturb", "2"], "2"),
        (["--fields", "dvrk"], "openh"),
        (["--cameras", "overview,endoscope"], "closeup, overview"),
        (["--cameras", "overview", "--camera_size", "7"], "7"),
        (["--camera_size", "64"], "--camera_size 64 needs cameras"),
        (["--root", ""], "--root '' names no folder"),
    ],
    ids=[
        *("no episodes", "negative seed", "task in lower case", "disturbed too much"),
        *("unknown fields", "unknown camera", "odd size of films", "size of no films", "no folder"),
    ],
)
def test_a_bad_argument_ends_with_one_line(changed, named, tmp_path):
    arguments = ["record", "--task", "NeedleReach", "--root", str(tmp_path / "reach"), *changed]
    with pytest.raises(SystemExit) as end:
        cli.main(arguments)
    assert isinstance(end.value.code, str), "the message becomes the line on stderr, and the status is not zero"
    assert named in end.value.code
    assert "\n" not in end.value.code
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def act_policy(tmp_path_factory):
    """Folder of a policy of LeRobot's, as far as it is read before its options are."""
    folder = tmp_path_factory.mktemp("act")
    ACTConfig(push_to_hub=False).save_pretrained(folder)
    return folder


@pytest.mark.parametrize(
    ("policy", "option", "told"),
    [
        (["--start", "generalist"], "--policy.average_steps=-1", "policy.average_steps must not be negative, got -1."),
        (["--start", "generalist"], "--policy.layers=many", "`layers`: Couldn't parse 'many' into an int"),
        (["--start", "{act}", "--steps", "1"], "--policy.n_action_steps=101", "Got 101 for `n_action_steps`"),
        (["--policy", "plas"], "--sample_weighting.type=uniform", "type plas cannot weight .*; leave out"),
    ],
    ids=["refused by a started policy", "no number", "refused by LeRobot's policy", "refused in the first step"],
)
def test_an_option_that_is_refused_after_it_was_read_ends_with_one_line(
    needle_pick_root, act_policy, command, tmp_path, policy, option, told
):
    arguments = ["train", "--dataset", str(needle_pick_root), "--output", str(tmp_path / "new"), "--device", "cpu"]
    arguments += [argument.format(act=act_policy) for argument in policy]
    with pytest.raises(SystemExit, match=rf"^gcdt train: [^\n]*{told}[^\n]*$"):
        command(lambda: cli.main([*arguments, "--", option]))
    assert not list(tmp_path.iterdir())


def test_a_folder_with_something_else_ends_with_one_line(tmp_path):
    (tmp_path / "thesis.txt").write_text("ten years of work")
    with pytest.raises(SystemExit) as end:
        cli.main(["record", "--task", "NeedleReach", "--episodes", "1", "--root", str(tmp_path)])
    assert str(tmp_path) in str(end.value.code)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


@pytest.mark.parametrize(
    "arguments",
    [
        *([], ["sew"], ["record"], ["record", "--task", "NeedleReach", "--root", "x", "--episodes", "many"]),
        *(["record", "--task", "NeedleReach"], ["record", "--task", "NeedleReach", "--all", "--root", "x"]),
    ],
    ids=["no command", "unknown command", "nothing after the command", "no number", "no folder", "one task and all"],
)
def test_a_malformed_command_exits_with_status_2_and_the_usage(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(arguments)
    assert end.value.code == 2
    assert "usage: gcdt" in capsys.readouterr().err


def test_the_built_in_policy_is_evaluated_by_its_name(tmp_path, capsys):
    file = tmp_path / "episodes.parquet"
    cli.main(["evaluate", "generalist", "--tasks", "NeedleReach", "--starts", "1", "--episodes", str(file)])
    assert "NeedleReach reached" in capsys.readouterr().out
    assert file.exists()


def test_the_built_in_policy_needs_a_file_for_its_episodes():
    with pytest.raises(SystemExit, match="generalist has no folder .* --episodes FILE.parquet"):
        cli.main(["evaluate", "generalist"])


def test_one_file_keeps_the_episodes_of_one_training(tmp_path):
    with pytest.raises(SystemExit, match="a single training, got a, b"):
        cli.main(["evaluate", "a", "b", "--episodes", str(tmp_path / "episodes.parquet")])


@pytest.mark.parametrize(("option", "number"), [("--starts", -2), ("--starts", 0), ("--first_seed", -1)])
def test_starts_that_cannot_be_are_named(option, number):
    with pytest.raises(SystemExit, match=rf"--starts from 1 on .*{number}"):
        cli.main(["evaluate", "generalist", "--episodes", "x.parquet", option, str(number)])


@pytest.mark.parametrize("arguments", [["merge", "a", "b"], ["import", "a.npz", "--task", "NeedlePick"]])
def test_a_dataset_needs_a_folder_with_a_name(arguments):
    with pytest.raises(SystemExit, match=r"--root '\.' names no folder; write one such as"):
        cli.main([*arguments, "--root", "."])


def test_an_interrupted_command_ends_in_one_line(monkeypatch, capsys, tmp_path):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("lerobot_gcdt.recording.merge", interrupt)
    with pytest.raises(SystemExit) as end:
        cli.main(["merge", "a", "b", "--root", str(tmp_path / "merged")])
    assert end.value.code == 130 and capsys.readouterr().err == "gcdt merge: interrupted\n"


_TERMINATED = """
import subprocess, sys
from types import SimpleNamespace
import gcdt_cli

def run(_):
    trainer = "import os, time; print(os.getpid(), flush=True); time.sleep(60)"
    subprocess.run([sys.executable, "-c", trainer])

gcdt_cli.COMMANDS = [SimpleNamespace(add=lambda commands: commands.add_parser("train").set_defaults(run=run))]
gcdt_cli.main(["train"])
"""


def test_a_terminated_command_ends_what_it_launched():
    with subprocess.Popen([sys.executable, "-c", _TERMINATED], stdout=subprocess.PIPE, text=True) as command:
        launched = int(command.stdout.readline())
        command.terminate()
        assert command.wait(30) == 128 + signal.SIGTERM
    with pytest.raises(ProcessLookupError):
        os.kill(launched, 0)


def test_a_number_of_episodes_to_evaluate_is_no_file():
    with pytest.raises(SystemExit, match="--episodes 4 is no FILE.parquet .* --starts says how many"):
        cli.main(["evaluate", "generalist", "--episodes", "4"])


@pytest.mark.parametrize("named", ["outputs/none", "a/b/c", "../none"])
@pytest.mark.parametrize(
    "arguments",
    [
        ["evaluate", "{named}", "--episodes", "{folder}/x.parquet"],
        ["record", "--task", "NeedleReach", "--policy", "{named}", "--root", "{folder}/x"],
        ["export-dvrk", "--task", "NeedleReach", "--policy", "{named}", "--out", "{folder}/x"],
    ],
    ids=["evaluate", "record", "export-dvrk"],
)
def test_a_policy_that_is_nowhere_is_told_as_a_missing_folder_first(arguments, named, tmp_path, monkeypatch):
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    with pytest.raises(SystemExit, match=rf"{named} is no folder here, nor could it be loaded from the Hub: [^\n]+$"):
        cli.main([argument.format(named=named, folder=tmp_path) for argument in arguments])
    assert not list(tmp_path.iterdir())


def test_imperfect_sensors_are_recorded_through_in_a_single_task(monkeypatch, tmp_path):
    given = []
    monkeypatch.setattr("lerobot_gcdt.recording.record", lambda *arguments, learner, sensors: given.append(sensors))
    cli.main(["record", "--task", "NeedleReach", "--root", str(tmp_path), "--delay", "2"])
    assert given == [{"delay": 2}]
    with pytest.raises(SystemExit, match=r"Imperfect sensors \(delay\) are for --task"):
        cli.main(["record", "--all", "--root", str(tmp_path), "--delay", "2"])


def test_imperfect_sensors_need_a_file_of_their_own(tmp_path):
    with pytest.raises(SystemExit, match="dropout.*--episodes"):
        cli.main(["evaluate", str(tmp_path), "--dropout", "0.1"])


def test_the_sensors_that_are_asked_for_are_those_of_the_evaluation_and_the_film(tmp_path, monkeypatch):
    file, calls = tmp_path / "episodes.parquet", []
    rows = pd.DataFrame({"task": ["NeedleReach"], "seed": 7, "reached": True, "held": True})
    for name, returned in (("evaluate_checkpoint", rows), ("pictures.film", None)):

        def note(*arguments, sensors, returned=returned, **options):
            calls.append(sensors)
            return returned

        monkeypatch.setattr(f"lerobot_gcdt.evaluation.{name}", note)
    command = ["evaluate", "generalist", "--tasks", "NeedleReach", "--episodes", str(file), "--film"]
    cli.main([*command, "--position_std", "0.01", "--delay", "2", "--action_std", "0.1"])
    assert calls == [{"position_std": 0.01, "delay": 2, "action_std": 0.1}] * 2


def test_the_policy_that_acts_is_named_by_the_checkpoint_that_is_the_last_now(tmp_path, tiny_config, monkeypatch):
    tiny_config.save_pretrained(tmp_path / "checkpoints/000010/pretrained_model")
    (tmp_path / "checkpoints/last").symlink_to("000010")
    learners = []
    monkeypatch.setattr("lerobot_gcdt.evaluation.load_policy", lambda path: path)
    monkeypatch.setattr("lerobot_gcdt.evaluation.tasks.tasks_of", lambda path, tasks: tasks)
    monkeypatch.setattr("lerobot_gcdt.recording.record", lambda *arguments, learner, sensors: learners.append(learner))
    cli.main(["record", "--task", "NeedleReach", "--root", "x", "--policy", str(tmp_path), "--mix", "0.5"])
    assert learners[0].policy == tmp_path / "checkpoints/last/pretrained_model"
    assert learners[0].name == str(tmp_path / "checkpoints/000010/pretrained_model")
    assert learners[0].mix == 0.5


def test_the_built_in_policy_acts_by_its_name(tmp_path):
    root = tmp_path / "reach"
    cli.main(["record", "--task", "NeedleReach", "--episodes", "1", "--root", str(root), "--policy", "generalist"])
    facts = json.loads((root / "meta/surrol.json").read_text())
    assert (facts["policy"], facts["mix"]) == ("generalist", 0)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--task", "NeedleReach", "--mix", "0.5"], "--mix 0.5 needs a policy"),
        (["--all", "--policy", "generalist"], "--policy acts in the recording of a single task"),
        (["--task", "NeedleReach", "--policy", "generalist", "--mix", "2"], "got 2"),
    ],
    ids=["mix without a policy", "policy of all tasks", "mix out of range"],
)
def test_a_policy_that_cannot_act_is_told_before_anything_is_recorded(arguments, told, tmp_path):
    with pytest.raises(SystemExit, match=told):
        cli.main(["record", *arguments, "--root", str(tmp_path / "x")])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--task", "NeedleReach", "--workers", "0"], "--workers goes with --all"),
        (["--task", "NeedleReach", "--manifest", "mine.json"], "--manifest goes with --all"),
        (["--task", "NeedleReach", "--write_manifest"], "--write_manifest goes with --all"),
        (["--all", "--write_manifest", "--manifest", "{}/none/mine.json"], "no folder {}/none; name .* --manifest"),
    ],
    ids=["workers", "manifest", "writing the manifest", "a manifest in no folder"],
)
def test_a_manifest_that_would_not_be_used_or_written_is_told_before_anything_is_recorded(arguments, told, tmp_path):
    with pytest.raises(SystemExit, match=told.format(tmp_path)):
        cli.main(["record", *(each.format(tmp_path) for each in arguments), "--root", str(tmp_path / "x")])
    assert not list(tmp_path.iterdir())


SLURM = ["--executor", "slurm", "--partition", "cpu", "--time", "01:00:00"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["record", "--all", "--partition", "cpu"], "--partition goes with --executor slurm"),
        (["record", "--all", "--executor", "local", "--cpus_per_task", "2"], "--executor slurm or ray"),
        (["record", "--all", "--executor", "ray", "--dry_run"], "--dry_run goes with --executor slurm"),
        (["record", "--all", "--executor", "slurm", "--partition", "cpu"], "needs a --partition and a --time"),
        (["record", "--all", *SLURM, "--workers", "0"], "at least one worker, got 0"),
        (["record", "--task", "NeedleReach", *SLURM], "--executor slurm runs .* several tasks, with --all"),
        (["benchmark", "--tasks", "NeedleReach", "--workers", "2"], "--workers .* go with --executor"),
    ],
    ids=[
        *("partition alone", "cores of this machine", "dry run of ray", "slurm without a time", "no workers"),
        *("a single task", "workers alone"),
    ],
)
def test_options_of_executors_that_do_not_go_together_are_told(arguments, told, tmp_path, monkeypatch):
    monkeypatch.setattr("gcdt_cli.options.find_spec", lambda name: name)
    folder = "--root" if arguments[0] == "record" else "--output"
    with pytest.raises(SystemExit, match=told):
        cli.main([*arguments, folder, str(tmp_path / "x")])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("executor", "missing"), [("local", "datatrove"), ("ray", "ray")])
def test_what_an_executor_lacks_is_told_with_the_extra_that_brings_it(executor, missing, tmp_path, monkeypatch):
    monkeypatch.setattr("gcdt_cli.options.find_spec", lambda name: None if name == missing else name)
    with pytest.raises(SystemExit, match=rf"{executor} needs {missing}, .*lerobot_policy_gcdt\[executors\]"):
        cli.main(["record", "--all", "--root", str(tmp_path / "x"), "--executor", executor])


def test_a_benchmark_under_an_executor_hands_out_its_trainings_and_then_reports(tmp_path, monkeypatch):
    given = []
    monkeypatch.setattr(
        "lerobot_gcdt.benchmark.learning.Benchmark",
        lambda **asked: SimpleNamespace(units=lambda write: [(asked, write)]),
    )
    executors = SimpleNamespace(run_units=lambda *arguments, **settings: given.append((arguments, settings)))
    monkeypatch.setitem(sys.modules, "lerobot_gcdt.executors", executors)
    monkeypatch.setattr("gcdt_cli.options.find_spec", lambda name: name)
    command = ["benchmark", "--datasets", str(tmp_path), "--tasks", "NeedleReach", "--output", "out"]
    cli.main([*command, *SLURM, "--gpus_per_task", "1", "--dry_run"])
    [((units, last, root), settings)] = given
    [(asked, write)] = units
    assert root == Path("out") and write is False
    assert last.args == (asked,)
    slurm = {"executor": "slurm", "workers": -1, "partition": "cpu", "time": "01:00:00"}
    assert settings == slurm | {"gpus_per_task": 1, "dry_run": True}
