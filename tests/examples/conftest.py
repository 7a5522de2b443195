"""Runs the examples as a user does, but in this process."""

import contextlib
import io
import logging
import runpy
import sys
from functools import partial
from pathlib import Path

import pytest
from accelerate.state import AcceleratorState

from lerobot_gcdt.evaluation import pictures

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="session", autouse=True)
def _pictures_are_small():
    """Drawing takes most of the time of an example that films; how large its pictures are matters to none."""
    with pytest.MonkeyPatch.context() as patch:
        for draw in (pictures.film, pictures.strips):
            patch.setattr(pictures, draw.__name__, partial(draw, size=192))
        yield


@pytest.fixture(scope="session")
def run_example():
    """Runs a script with arguments, tidies up what LeRobot leaves behind, and returns what was printed."""

    def run(name, *arguments):
        logger = logging.getLogger()
        handlers, level = logger.handlers[:], logger.level
        printed = io.StringIO()
        with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
            patch.setattr(sys, "argv", [f"{name}.py", *map(str, arguments)])
            try:
                runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
            finally:
                AcceleratorState._reset_state(reset_partial_state=True)
                logger.handlers[:] = handlers
                logger.setLevel(level)
        return printed.getvalue()

    return run
