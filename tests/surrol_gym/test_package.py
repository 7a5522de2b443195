import subprocess
import sys

import gymnasium as gym

import surrol_gym

PAPERS_ORDER = (
    *("NeedleReach", "GauzeRetrieve", "NeedlePick", "PegTransfer", "NeedleRegrasp"),
    *("BiPegTransfer", "BiPegBoard", "MatchBoardPanel", "PickAndPlace", "MatchBoard"),
)


def output_of(code):
    """Last line that Python prints in a fresh process."""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return result.stdout.splitlines()[-1]


def test_tasks_are_names_of_the_papers_tables_in_their_order():
    assert [task for task in PAPERS_ORDER if task in surrol_gym.TASKS] == list(surrol_gym.TASKS)
    assert {"NeedleReach", "NeedlePick"} <= set(surrol_gym.TASKS)


def test_the_registered_ids_are_those_of_the_tasks():
    ids = {name for name in gym.registry if name.startswith("surrol/")}
    assert ids >= {f"surrol/{task}-v0" for task in surrol_gym.TASKS}
    assert ids == {surrol_gym.find_task(task) for task in surrol_gym.registered_tasks()}


def test_an_environment_knows_the_name_of_its_task(make):
    assert [make(task).unwrapped.task for task in surrol_gym.TASKS] == list(surrol_gym.TASKS)


def test_the_public_names_are_few():
    assert set(surrol_gym.__all__) == {"TASKS", "find_task", "make_expert", "register_task", "registered_tasks"}
    assert all(hasattr(surrol_gym, name) for name in surrol_gym.__all__)


def test_the_simulator_loads_neither_torch_nor_lerobot():
    """Neither the import does nor an environment."""
    code = "import surrol_gym, sys, gymnasium; gymnasium.make('surrol/NeedlePick-v0').reset()"
    assert output_of(f"{code}\nprint(sorted({{'torch', 'lerobot'}} & set(sys.modules)))") == "[]"


def test_gymnasium_can_import_the_package_by_the_id():
    code = "import gymnasium as gym; print(gym.make('surrol_gym:surrol/NeedlePick-v0').unwrapped.task)"
    assert output_of(code) == "NeedlePick"
