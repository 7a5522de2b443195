"""Work on several machines: independent units, and a step after all of them, under datatrove's executors.

Rank r does unit r. datatrove marks what is finished by an empty file in ``completions``; a repeated command skips it.
"""

import hashlib
import os
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import multiprocess
from datatrove.executor import LocalPipelineExecutor, RayPipelineExecutor, SlurmPipelineExecutor
from datatrove.utils.logging import logger

SUBMIT = "sbatch"
UNKNOWN = 255
"""Exit status of a worker whose server was killed."""


class SlurmJobs(SlurmPipelineExecutor):
    """Ranks as an array of Slurm's jobs."""

    def launch_merge_stats(self) -> None:
        """Launches nothing: the units are not datatrove's, so there are no statistics."""


def run_units(
    units: Sequence[partial],
    last: Callable[[], Any],
    root: str | Path,
    executor: str,
    dry_run: bool = False,
    **settings: Any,
) -> None:
    """Does units of work wherever there is room, and then the step that depends on them.

    Args:
        units: The units. Each can be pickled, depends on no other, and goes on by itself where it was interrupted.
        last: What is done each time when all units are finished. With Slurm it is a job of its own, with the others
            it is done here.
        root: Folder that all machines see, for markers and logs: ``executor/DIGEST`` in it, so that other units have
            other markers.
        executor: ``"local"``, processes here; ``"slurm"``, submitted and not waited for; or ``"ray"``, the cluster that
            ``ray.init()`` finds.
        dry_run: With Slurm: prints what would be submitted, and writes nothing.
        settings: Further arguments of datatrove's executor, such as ``workers``, how many units are done at a time.

    Raises:
        FileNotFoundError: There is no Slurm here.
        RuntimeError: Slurm refuses, or a unit failed under Ray; what is finished is kept.
        ChildProcessError: A process here was killed or ended by itself; what is finished is kept.
        Exception: What a local unit raises; what is finished is kept.
    """
    logs = Path(root).absolute() / "executor" / _digest(units)
    ranks = [partial(_do, units, os.getcwd())]
    if executor == "slurm":
        jobs = partial(_slurm_jobs, ranks, len(units), last, **settings)
        (_show if dry_run else _submit)(jobs, logs)
        return
    kind = {"local": LocalPipelineExecutor, "ray": RayPipelineExecutor}[executor]
    running = kind(ranks, tasks=len(units), logging_dir=str(logs), **settings)
    pool = executor == "local" and settings.get("workers") != 1
    with _killed_workers_told() if pool else nullcontext():
        running.run()
    if failed := running.get_incomplete_ranks():
        raise RuntimeError(f"{len(failed)} of {len(units)} units failed, see {logs / 'logs'}; repeat the command.")
    last()


def _do(units: Sequence[Callable[[], Any]], folder: str, data: None, rank: int, world_size: int) -> None:
    """Does the unit of a rank, in the folder in which the command was given; the arguments are datatrove's."""
    if parent := multiprocess.parent_process():
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    os.chdir(folder)
    units[rank]()


def _end_with(parent: Any) -> None:
    """Ends this process when its parent was killed: whoever does the unit next finds nobody at work there."""
    parent.join()
    os._exit(1)


@contextmanager
def _killed_workers_told() -> Iterator[None]:
    """Raises ChildProcessError when a worker ends too early, since datatrove's pool waits for what it did for ever."""
    children: set[Any] = set()
    most = 0

    def look(number: int, frame: Any) -> None:
        nonlocal most
        alive = multiprocess.active_children()
        children.update(alive)
        most = max(most, len(alive))
        statuses = {child.exitcode for child in children}
        # In the end the pool itself kills its workers. Before, it replaces those that end, if the server that forks
        # them is still there.
        if UNKNOWN in statuses or (len(alive) == most and any(statuses)):
            raise ChildProcessError("a worker was killed; what is finished is kept, repeat the command to go on")

    before = signal.signal(signal.SIGALRM, look)
    signal.setitimer(signal.ITIMER_REAL, 1, 1)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _digest(units: Sequence[partial]) -> str:
    """A name for these units."""
    described = [(unit.func.__qualname__, unit.args, unit.keywords) for unit in units]
    return hashlib.sha256(repr(described).encode()).hexdigest()[:12]


def _slurm_jobs(
    ranks: list[partial], tasks: int, last: Callable[[], Any], logs: Path, workers: int = -1, **settings: Any
) -> tuple[SlurmJobs, SlurmJobs]:
    """The jobs of the units, and the one that depends on them."""
    settings |= {
        "qos": "",  # Slurm's own choice
        "env_command": f"export PATH={shlex.quote(str(Path(sys.executable).parent))}:$PATH",
    }
    units = SlurmJobs(ranks, tasks=tasks, workers=workers, job_name="gcdt", logging_dir=str(logs / "units"), **settings)
    end = SlurmJobs(
        [partial(_do, [last], os.getcwd())],
        tasks=1,
        depends=units,
        skip_completed=False,
        job_name="gcdt-last",
        logging_dir=str(logs / "last"),
        sbatch_args={"kill-on-invalid-dep": "yes"},  # it ends, too, where a unit failed
        **settings,
    )
    return units, end


def _submit(jobs: partial, logs: Path) -> None:
    if not shutil.which(SUBMIT):
        raise FileNotFoundError(f"There is no {SUBMIT} here; submit where Slurm is, or look at it with --dry_run.")
    units, end = jobs(logs)
    try:
        end.run()
    except subprocess.CalledProcessError as error:
        raise RuntimeError(f"{SUBMIT} ended with status {error.returncode}.") from None
    waited_for = "" if units.job_id == -1 else f"{units.job_id}, and after it "  # -1 where all units are finished
    print(f"Submitted job {waited_for}{end.job_id}; their logs are in {logs}.")


def _show(jobs: partial, logs: Path) -> None:
    """Prints what ``_submit`` would submit: it is submitted to `echo`, from a folder that is removed."""
    arguments: list[str] = []

    def keep(printed: str) -> str:
        arguments.append(printed.rsplit(maxsplit=1)[0])  # without the name of the script
        return f"JOB_{len(arguments)}"

    before = os.environ["PATH"]
    logger.disable("datatrove")
    try:
        with TemporaryDirectory() as folder:
            scratch = Path(folder)
            (scratch / SUBMIT).symlink_to(str(shutil.which("echo")))
            os.environ["PATH"] = os.pathsep.join([folder, before])
            if (logs / "units/completions").exists():
                shutil.copytree(logs / "units/completions", scratch / "units/completions")
            jobs(scratch, job_id_retriever=keep)[-1].run()
            scripts = [scratch / name / "launch_script.slurm" for name in ("units", "last")]
            shown = [script.read_text().replace(folder, str(logs)) for script in scripts if script.exists()]
    finally:
        os.environ["PATH"] = before
        logger.enable("datatrove")
    for options, script in zip(arguments, shown, strict=True):
        print(f"# {SUBMIT} {options}\n{script}")
