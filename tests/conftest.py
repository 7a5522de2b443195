"""What all studies share."""

import pytest


def pytest_addoption(parser):
    parser.addoption("--episodes", type=int, help="how many episodes a study plays, instead of its own number")


@pytest.fixture
def seeds(request):
    """``seeds(first, count)``, those of a study's episodes: ``count`` of them unless ``--episodes`` says otherwise."""
    return lambda first, count: range(first, first + (request.config.getoption("episodes") or count))
