import numpy as np
import pytest

from surrol_gym.bullet import World
from surrol_gym.envs.grasping import Grasp
from surrol_gym.psm.arm import DOWN, END_EFFECTOR, Arm

NOTHING, ONE, OTHER, BOTH = (False, False), (True, False), (False, True), (True, True)


class FeelingArm:
    """The arm's body with a sense of touch that the test decides."""

    def __init__(self, arm):
        self.body = arm.body
        self.touched = NOTHING

    def touches(self, body):
        return self.touched


class Scene:
    """An arm, a needle in the air that no jaw really touches, and the grasp of both."""

    def __init__(self):
        self.world = World()
        self.real_arm = Arm(self.world, (0.05, 0.24, 0.8524), np.deg2rad(-110))
        self.needle = self.world.load("needle.urdf", fixed=False)
        self.arm = FeelingArm(self.real_arm)
        self.may_attach = True
        self.grasp = Grasp(self.world, self.arm, self.needle, lambda: self.may_attach)
        self.reset()

    def reset(self):
        self.grasp.reset()
        self.may_attach, self.arm.touched = True, NOTHING
        self.real_arm.reset((2.75, 0.0, 3.7), DOWN)
        self.world.place(self.needle, (2.9, 0.1, 3.6))

    def control_step(self, closing, touched):
        """A control step in which the jaws end up touching as told; returns whether the needle is attached."""
        self.grasp.before_step(closing)
        self.arm.touched = touched
        self.grasp.after_step()
        return self.grasp.attached

    def needle_in_link_5(self):
        """Position of the needle in the frame of link 5."""
        position, rotation = self.world.pose(self.arm.body)
        rotation = np.reshape(self.world.client.getMatrixFromQuaternion(rotation), (3, 3))
        return rotation.T @ (self.world.pose(self.needle)[0] - position)

    def constraints(self):
        """How many constraints hold the needle."""
        return self.world.client.getNumConstraints() - 1  # one holds the arm


@pytest.fixture(scope="module")
def shared_scene():
    scene = Scene()
    yield scene
    scene.world.close()


@pytest.fixture
def scene(shared_scene):
    shared_scene.reset()
    return shared_scene


def attach(scene):
    assert not scene.control_step(closing=True, touched=BOTH)
    assert scene.control_step(closing=True, touched=BOTH)


def test_closing_on_an_object_that_both_jaws_touch_attaches_it(scene):
    assert not scene.control_step(closing=True, touched=BOTH)
    # The touch of one step makes the grasp active in the action of the next (docs/grasping.md#the-rule).
    assert scene.control_step(closing=True, touched=BOTH)
    assert scene.constraints() == 1


@pytest.mark.parametrize("touched", [NOTHING, ONE, OTHER])
def test_an_object_that_one_jaw_misses_is_not_attached(scene, touched):
    for _ in range(5):
        assert not scene.control_step(closing=True, touched=touched)


def test_open_jaws_attach_nothing(scene):
    for _ in range(5):
        assert not scene.control_step(closing=False, touched=BOTH)


def test_the_task_may_demand_more_before_it_attaches(scene):
    scene.may_attach = False
    for _ in range(5):
        assert not scene.control_step(closing=True, touched=BOTH)
    scene.may_attach = True
    assert scene.control_step(closing=True, touched=BOTH)


def test_an_active_grasp_waits_for_the_demand_even_if_a_jaw_slips(scene):
    scene.may_attach = False
    scene.control_step(closing=True, touched=BOTH)
    scene.control_step(closing=True, touched=ONE)
    scene.may_attach = True
    assert scene.control_step(closing=True, touched=ONE)


@pytest.mark.parametrize("touched", [ONE, OTHER])
def test_one_jaw_in_touch_is_enough_to_hold(scene, touched):
    attach(scene)
    assert scene.control_step(closing=True, touched=touched)


def test_lost_touch_releases(scene):
    attach(scene)
    assert not scene.control_step(closing=True, touched=NOTHING)
    assert scene.constraints() == 0


def test_opening_releases_at_once(scene):
    attach(scene)
    scene.grasp.before_step(closing=False)
    assert not scene.grasp.attached
    assert scene.constraints() == 0


def test_after_a_release_the_grasp_starts_anew(scene):
    attach(scene)
    scene.control_step(closing=False, touched=NOTHING)
    assert not scene.control_step(closing=True, touched=BOTH)
    assert scene.control_step(closing=True, touched=BOTH)


def test_a_reset_forgets_the_grasp_and_the_touch(scene):
    attach(scene)
    scene.grasp.reset()
    assert not scene.grasp.attached
    assert not scene.control_step(closing=True, touched=NOTHING)
    assert not scene.control_step(closing=True, touched=NOTHING)


def test_an_attached_object_follows_link_5(scene):
    attach(scene)
    before = scene.needle_in_link_5()
    start = scene.world.pose(scene.needle)[0]
    scene.real_arm.move_to((2.75, 0.0, 3.75), DOWN)
    scene.world.step(96)
    assert scene.world.pose(scene.needle)[0][2] - start[2] == pytest.approx(0.05, abs=0.005)
    np.testing.assert_allclose(scene.needle_in_link_5(), before, rtol=0, atol=0.005)


def test_the_constraint_pulls_with_20_at_most(scene):
    """docs/grasping.md#the-rule."""
    attach(scene)
    client = scene.world.client
    info = client.getConstraintInfo(client.getConstraintUniqueId(1))
    assert info[0:4] == (scene.arm.body, END_EFFECTOR, scene.needle, -1)
    assert info[10] == 20.0


def test_a_restored_grasp_holds_the_object_in_the_same_place(scene):
    attach(scene)
    state, before = scene.grasp.get_state(), scene.needle_in_link_5()
    scene.grasp.release()
    scene.grasp.set_state(state)
    assert scene.grasp.attached
    assert scene.grasp.get_state() == state
    scene.world.step(96)
    np.testing.assert_allclose(scene.needle_in_link_5(), before, rtol=0, atol=0.005)
    assert scene.constraints() == 1


def test_a_restored_state_keeps_what_the_next_action_needs_to_know(scene):
    scene.control_step(closing=True, touched=BOTH)
    touching = scene.grasp.get_state()
    scene.grasp.reset()
    scene.grasp.set_state(touching)
    assert scene.control_step(closing=True, touched=BOTH)
    scene.grasp.set_state(touching)
    assert not scene.grasp.attached
