"""Units of work under datatrove's executors: what is finished is not done again, and the last step waits for all."""

import os
import subprocess
import threading
import time
from functools import partial
from pathlib import Path

import pytest

pytest.importorskip("datatrove")
from lerobot_gcdt.executors import run_units

HERE = Path(__file__).parent


def shell(*commands):
    """A unit for each command of the shell."""
    return [partial(subprocess.run, ["sh", "-c", command], check=True) for command in commands]


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder, in which the command is given."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_last_step_comes_after_all_units(here):
    run_units(shell("echo 0 >> done", "echo 1 >> done"), *shell("echo last >> done"), here, "local", workers=1)
    assert (here / "done").read_text().split() == ["0", "1", "last"]


def test_a_repeated_command_does_what_is_not_finished_and_the_last_step(here):
    units, last = shell("echo 0 >> done", "test -e allowed && echo 1 >> done"), *shell("echo last >> done")
    with pytest.raises(subprocess.CalledProcessError, match="test -e allowed"):
        run_units(units, last, here, "local", workers=1)
    assert (here / "done").read_text().split() == ["0"]
    (here / "allowed").touch()
    run_units(units, last, here, "local", workers=1)
    run_units(units, last, here, "local", workers=1)
    assert (here / "done").read_text().split() == ["0", "1", "last", "last"]


def test_other_units_are_not_taken_for_finished_ones(here):
    for name in ("first", "second"):
        run_units(shell(f"touch {name}"), *shell("true"), here, "local", workers=1)
    assert (here / "first").exists() and (here / "second").exists()


@pytest.mark.study  # every worker imports the package anew
@pytest.mark.parametrize(
    "end",
    [*shell("kill -KILL $PPID", "kill -TERM $PPID", "kill -KILL $(ps -o ppid= -p $PPID)"), partial(os._exit, 3)],
    ids=["SIGKILL", "SIGTERM", "SIGKILL of their server", "status 3"],
)
def test_a_killed_worker_ends_the_command(here, end):
    with pytest.raises(ChildProcessError, match="a worker was killed; what is finished is kept, repeat"):
        run_units([end, *shell("true")], *shell("touch last"), here, "local", workers=2)
    assert not (here / "last").exists()


DIES_SLOWLY = """
import os, signal, time

signal.signal(signal.SIGTERM, lambda *_: (time.sleep(3), os._exit(1)))
"""


@pytest.mark.study
def test_the_end_of_the_pool_is_not_taken_for_that_of_a_worker(here):
    run_units([partial(exec, DIES_SLOWLY, {}), *shell("sleep 3")], *shell("touch last"), here, "local", workers=2)
    assert (here / "last").exists()


# Slurm.


@pytest.fixture
def slurm(tmp_path, monkeypatch):
    """Slurm's commands, imitated: a job runs here when it is submitted, if what it depends on has ended well."""
    commands, jobs = tmp_path / "slurm", tmp_path / "jobs"
    commands.mkdir()
    jobs.mkdir()
    scripts = {
        "sbatch": (HERE / "sbatch.sh").read_text(),
        "srun": '[ "$1 $2 $3" = "-l -n 1" ] && exec "${@:4}"\n',
        "scontrol": '[ "$1 $2" = "show hostnames" ] && echo "$3"\n',
    }
    for name, script in scripts.items():
        (commands / name).write_text(f"#!/bin/bash\n{script}")
        (commands / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{commands}:{os.environ['PATH']}")
    monkeypatch.setenv("JOBS", str(jobs))
    return jobs


SLURM = {"partition": "cpu", "time": "01:00:00"}


def test_a_dry_run_shows_what_is_left_and_writes_nothing(here, capsys):
    units, last = shell("true", "true", "true"), *shell("true")
    run_units(units, last, here, "slurm", dry_run=True, workers=2, cpus_per_task=4, **SLURM)
    first, second = capsys.readouterr().out.split("# sbatch")[1:]
    for line in ("--array=0-2%2", "--partition=cpu", "--time=01:00:00", "--cpus-per-task=4"):
        assert f"#SBATCH {line}\n" in first
    assert "launch_pickled_pipeline" in first and f"{here}/executor/" in first
    assert "--dependency" not in first and "--dependency=afterok:JOB_1" in second
    assert "#SBATCH --array=0-0\n" in second
    [markers] = {line.split("=")[1].split("/slurm_logs")[0] for line in first.splitlines() if "--output" in line}
    assert not list(here.iterdir())

    (Path(markers) / "completions").mkdir(parents=True)
    (Path(markers) / "completions/00001").touch()
    run_units(units, last, here, "slurm", dry_run=True, **SLURM)
    assert "#SBATCH --array=0-1\n" in capsys.readouterr().out


def test_without_slurm_nothing_is_written(here, monkeypatch):
    monkeypatch.setenv("PATH", str(here))
    with pytest.raises(FileNotFoundError, match="There is no sbatch here; .* --dry_run"):
        run_units(shell("true"), *shell("true"), here, "slurm", **SLURM)
    assert not list(here.iterdir())


@pytest.mark.study
def test_slurm_runs_the_ranks_that_are_left_and_then_the_last_step(here, slurm, capsys):
    units, last = shell("echo 0 >> done", "test -e allowed && echo 1 >> done"), *shell("echo last >> done")
    with pytest.raises(RuntimeError, match="sbatch ended with status 1"):
        run_units(units, last, here, "slurm", **SLURM)
    assert (here / "done").read_text().split() == ["0"]
    (here / "allowed").touch()
    run_units(units, last, here, "slurm", **SLURM)
    assert (here / "done").read_text().split() == ["0", "1", "last"]
    assert sorted(job.name for job in slurm.iterdir()) == ["1 failed", "2 done", "3 done"]
    assert "Submitted job 2, and after it 3; their logs are in" in capsys.readouterr().out


# Ray.


@pytest.fixture(scope="module")
def cluster():
    """A cluster of two nodes, both of them here, with one core each."""
    ray, utilities = pytest.importorskip("ray"), pytest.importorskip("ray.cluster_utils")
    node = {"num_cpus": 1, "include_dashboard": False}
    cluster = utilities.Cluster(initialize_head=True, head_node_args=node)
    cluster.add_node(num_cpus=1)
    ray.init(cluster.address, log_to_driver=False)
    yield cluster
    ray.shutdown()
    cluster.shutdown()


@pytest.mark.study
def test_ray_spreads_the_units_over_the_nodes(here, cluster):
    # Neither ends before the other has begun.
    meet = [f"echo $RAY_RAYLET_PID > {me}; until [ -e {other} ]; do sleep .1; done" for me, other in ("01", "10")]
    run_units(shell(*meet), *shell("cat 0 1 > both"), here, "ray", workers=-1)
    assert len(set((here / "both").read_text().split())) == 2


@pytest.mark.study
def test_a_unit_that_fails_under_ray_keeps_the_last_step_from_being_done(here, cluster):
    units, last = shell("echo 0 >> done", "test -e allowed && echo 1 >> done"), *shell("echo last >> done")
    with pytest.raises(RuntimeError, match="1 of 2 units failed, see .*; repeat the command"):
        run_units(units, last, here, "ray", workers=-1)
    (here / "allowed").touch()
    run_units(units, last, here, "ray", workers=-1)
    assert (here / "done").read_text().split() == ["0", "1", "last"]


UNIT_ON_A_NODE = """
import os, time
from pathlib import Path

node, begun = os.environ["RAY_RAYLET_PID"], Path("begun_{rank}")
if not begun.exists():
    Path("node").write_text(node)
    Path("node").rename(begun)
    while not Path("go_on_" + node).exists():
        time.sleep(0.1)
with open("done", "a") as done:
    done.write("{rank} ")
"""


@pytest.mark.study
def test_what_a_lost_node_was_at_is_done_on_another_one(here, cluster):
    def lose():
        while len(begun := list(here.glob("begun_*"))) < 2:
            time.sleep(0.1)
        head, other = (node.all_processes["raylet"][0].process.pid for node in cluster.list_all_nodes())
        assert {int(file.read_text()) for file in begun} == {head, other}
        cluster.remove_node(cluster.list_all_nodes()[1], allow_graceful=False)
        (here / f"go_on_{head}").touch()

    losing = threading.Thread(target=lose)
    losing.start()
    units = [partial(exec, UNIT_ON_A_NODE.format(rank=rank), {}) for rank in (0, 1)]
    run_units(units, *shell("echo last >> done"), here, "ray", workers=-1)
    losing.join()
    assert sorted((here / "done").read_text().split()) == ["0", "1", "last"]
