"""Fixtures of the tests of recordings."""

import pytest

from lerobot_gcdt.recording import demonstrations


@pytest.fixture
def interrupted_in_the_second(monkeypatch):
    """Interrupts the recording in the second episode that is run, once; gives the seeds of those that were begun."""
    run_episode = demonstrations.run_episode
    ran = []

    def run_or_interrupt(env, seed, *options):
        ran.append(seed)
        if len(ran) == 2:
            raise KeyboardInterrupt
        return run_episode(env, seed, *options)

    monkeypatch.setattr(demonstrations, "run_episode", run_or_interrupt)
    return ran
