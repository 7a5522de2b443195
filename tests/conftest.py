"""What all studies share, and a display for the tests that need one."""

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

TESTS = Path(__file__).parent

# There are as many processes as cores; with two threads each they would wait busily for one another.
os.environ.setdefault("OMP_NUM_THREADS", "1")


def pytest_addoption(parser):
    parser.addoption(
        "--task", action="append", default=[], help="a task that keeps the contract, too: my_module:MyTask"
    )
    parser.addoption("--episodes", type=int, help="how many episodes a study plays, instead of its own number")


@pytest.fixture
def seeds(request):
    """``seeds(first, count)``, those of a study's episodes: ``count`` of them unless ``--episodes`` says otherwise."""
    return lambda first, count: range(first, first + (request.config.getoption("episodes") or count))


@pytest.fixture
def no_display(monkeypatch):
    """Hides every display there may be."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture(scope="session")
def display():
    """The name of a virtual display, on which nothing else is shown."""
    if not shutil.which("Xvfb"):
        pytest.skip("there is no Xvfb here (Debian: apt-get install xvfb)")
    if not find_spec("Xlib"):
        pytest.skip("python-xlib is not installed, which pynput brings (lerobot[core_scripts])")
    reading, writing = os.pipe()
    command = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "1024x768x24", "-noreset", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=[writing], stderr=subprocess.DEVNULL)
    os.close(writing)
    with os.fdopen(reading) as numbers:
        number = numbers.readline().strip()
    if not number:
        pytest.skip("Xvfb does not start here")
    yield f":{number}"
    server.terminate()
    server.wait()


@pytest.fixture(scope="session")
def on_display(display):
    """Runs a script of the tests on the virtual display; returns what it printed."""

    def run(script, *arguments, timeout=600, **variables):
        done = subprocess.run(
            [sys.executable, script, *map(str, arguments)],
            capture_output=True,
            text=True,
            timeout=timeout,
            env=os.environ
            | {"DISPLAY": display, "PYTHONPATH": os.pathsep.join([str(TESTS.parent), str(TESTS)])}
            | {name: str(value) for name, value in variables.items()},
        )
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
        return done.stdout

    return run
