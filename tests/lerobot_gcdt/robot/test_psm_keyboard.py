"""LeRobot's keyboard moves the arms of a task, also the second one."""

from importlib.util import find_spec
from types import SimpleNamespace

import pytest
from lerobot.teleoperators import make_teleoperator_from_config

from lerobot_gcdt import PSMKeyboardConfig, SurRoLPSMConfig
from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.robot.names import BEGIN
from lerobot_gcdt.robot.psm_keyboard import PSMKeyboard
from lerobot_gcdt.robot.surrol_psm import SurRoLPSM

if not find_spec("pynput"):
    pytest.skip("pynput is not installed (lerobot[core_scripts])", allow_module_level=True)

SHIFT, ENTER = SimpleNamespace(name="shift_r"), SimpleNamespace(name="enter")


@pytest.fixture
def keyboard(monkeypatch):
    """Makes a keyboard whose listener is played by the test."""
    monkeypatch.setattr(PSMKeyboard, "is_connected", True)
    return lambda task="NeedlePick": make_teleoperator_from_config(PSMKeyboardConfig(task=task))


def press(keyboard, *events):
    """Events are keys that go down, and keys in a tuple that go up."""
    for event in events:
        keyboard.event_queue.put((event[0], False) if isinstance(event, tuple) else (event, True))
    return keyboard.get_action()


@pytest.mark.parametrize("task", ["NeedlePick", "BiPegTransfer"])
def test_it_says_what_the_robot_takes(keyboard, task):
    robot = SurRoLPSM(SurRoLPSMConfig(task=task))
    assert keyboard(task).action_features == robot.action_features
    assert list(press(keyboard(task))) == list(robot.action_features)


def test_a_key_acts_until_it_is_let_go(keyboard):
    one = keyboard()
    assert press(one, "w")["psm1_dx.vel"] == pytest.approx(-0.5)
    assert press(one)["psm1_dx.vel"] == pytest.approx(-0.5)
    assert press(one, ("w",))["psm1_dx.vel"] == 0


def test_a_key_that_is_tapped_between_two_looks_acts_once(keyboard):
    one = keyboard()
    assert press(one, "w", ("w",))["psm1_dx.vel"] < 0
    assert press(one)["psm1_dx.vel"] == 0


def test_opposite_keys_work_after_each_other(keyboard):
    one = keyboard()
    press(one, "w", ("w",), "s", ("s",))
    assert press(one, "w")["psm1_dx.vel"] < 0


def test_letters_are_the_same_with_shift(keyboard):
    one = keyboard()
    assert press(one, SHIFT, "W")["psm1_dx.vel"] == pytest.approx(-0.1)
    assert press(one, (SHIFT,), ("w",))["psm1_dx.vel"] == 0


def test_enter_asks_for_the_next_episode_and_closes_the_jaws(keyboard):
    one = keyboard()
    assert press(one, "v", ("v",))["psm1_gripper.pos"] > 0
    action = press(one, ENTER)
    assert action[BEGIN] == 1 and action["psm1_gripper.pos"] < 0


def test_an_unknown_task_is_named():
    with pytest.raises(OptionError, match="NeedleThread"):
        PSMKeyboardConfig(task="NeedleThread")
