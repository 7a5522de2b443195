"""The bag keeps to what the dVRK's own replay script asks of one, and a bag that does not is recognised.

``faults`` is written from the rules of that script, not from our writer:

- it opens a folder, and in it MCAP only;
- of every arm it reads the pose, in its own frame and in the one that was set, the joints and the jaws, each from a
  topic of a certain name and type;
- it takes the jaws by index, so there are as many of them as poses;
- joint states hold positions and as many velocities, of six joints and of one jaw;
- stamps are above 0 and increase strictly;
- it prints the bounding box, which has to be one that a person can judge, in metres.
"""

import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from lerobot_gcdt.robot.bag import write_bag
from lerobot_gcdt.robot.set_points import interpolate

STORE = get_typestore(Stores.ROS2_JAZZY)
POSE, JOINTS = "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/JointState"
TOPICS = {"setpoint_cp": POSE, "local/setpoint_cp": POSE, "setpoint_js": JOINTS, "jaw/setpoint_js": JOINTS}


def read(bag):
    """Topic, type, time and message of all that a bag holds, in its order."""
    with Reader(bag) as reader:
        return [
            (connection.topic, connection.msgtype, time, STORE.deserialize_cdr(data, connection.msgtype))
            for connection, time, data in reader.messages()
        ]


def faults(bag, arms):
    """Says what keeps the replay script from playing a bag."""
    if not (bag.is_dir() and (bag / "metadata.yaml").exists()):
        return ["no folder of a bag"]
    told = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    if told["storage_identifier"] != "mcap":
        return [f"stored as {told['storage_identifier']}"]
    found, types = {}, {}
    for topic, kind, _, message in read(bag):
        found.setdefault(topic, []).append(message)
        types[topic] = kind
    wrong = []
    for arm in arms:
        topics = {f"/{arm}/{name}": kind for name, kind in TOPICS.items()}
        if missing := topics.keys() - found.keys():
            return [f"no {', '.join(sorted(missing))}"]
        wrong += [f"{topic} of type {types[topic]}" for topic, kind in topics.items() if types[topic] != kind]
        if wrong:
            return wrong
        poses, local, joints, jaws = (found[topic] for topic in topics)
        if not len(poses) == len(local) == len(joints) == len(jaws):
            wrong.append(f"{len(jaws)} jaws of {arm} for {len(poses)} poses")
        for topic in topics:
            stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in found[topic]]
            if min(stamps) <= 0:
                wrong.append(f"a stamp of {topic} is not above 0")
            if not all(before < after for before, after in zip(stamps, stamps[1:], strict=False)):
                wrong.append(f"stamps of {topic} do not increase")
        for messages, size in ((joints, 6), (jaws, 1)):
            if any(len(message.position) != size for message in messages):
                wrong.append(f"positions of {arm} are not {size}")
            if any(len(message.velocity) != size for message in messages):
                wrong.append(f"velocities of {arm} are not {size}")
        box = np.ptp([[point.pose.position.x, point.pose.position.y, point.pose.position.z] for point in local], axis=0)
        if not (1e-3 < box.max() < 0.5):
            wrong.append(f"{arm} moves through {box} m")
    return wrong


@pytest.fixture(scope="module")
def two_slow_arms():
    """BiPegTransfer with few set-points, which is quick to write."""
    from lerobot_gcdt.robot.episodes import play

    return interpolate(play("BiPegTransfer", 3), rate=10)


@pytest.fixture(scope="module")
def bag(two_slow_arms, tmp_path_factory):
    write_bag(two_slow_arms, folder := tmp_path_factory.mktemp("bags") / "bag")
    return folder


def rewrite(bag, folder, change, storage=StoragePlugin.MCAP):
    """Copies a bag, with another list of what it holds."""
    connections = {}
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        for topic, kind, time, message in change(read(bag)):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], time, STORE.serialize_cdr(message, kind))
    return folder


def test_the_replay_script_can_play_it(bag):
    assert faults(bag, ["PSM1", "PSM2"]) == []


def test_a_copy_that_nothing_was_done_to_can_be_played_too(bag, tmp_path):
    assert faults(rewrite(bag, tmp_path / "copy", list), ["PSM1", "PSM2"]) == []


def without_jaws(found):
    return [entry for entry in found if entry[0] != "/PSM2/jaw/setpoint_js"]


def one_jaw_less(found):
    last = max(index for index, entry in enumerate(found) if entry[0] == "/PSM1/jaw/setpoint_js")
    return found[:last] + found[last + 1 :]


def stamp(message, nanoseconds):
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(nanoseconds, 10**9)


def stamps_from_zero(found):
    first = found[0][2]
    for _, _, time, message in found:
        stamp(message, time - first)
    return found


def stamps_that_stand_still(found):
    for _, _, _, message in found:
        stamp(message, 10**9)
    return found


def no_velocity(found):
    for topic, _, _, message in found:
        if topic == "/PSM1/setpoint_js":
            message.velocity = np.zeros(0)
    return found


def other_type(found):
    kind = "geometry_msgs/msg/TransformStamped"
    message, transform, vector = (
        STORE.types[f"geometry_msgs/msg/{n}"] for n in ("TransformStamped", "Transform", "Vector3")
    )

    def changed(pose):
        at = pose.pose.position
        return message(pose.header, "", transform(vector(at.x, at.y, at.z), pose.pose.orientation))

    return [
        (topic, kind, time, changed(entry)) if topic == "/PSM1/setpoint_cp" else (topic, old, time, entry)
        for topic, old, time, entry in found
    ]


def in_millimetres(found):
    for _, kind, _, message in found:
        if kind == POSE:
            for axis in "xyz":
                setattr(message.pose.position, axis, 1000 * getattr(message.pose.position, axis))
    return found


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (without_jaws, "no /PSM2/jaw/setpoint_js"),
        (one_jaw_less, "jaws of PSM1 for"),
        (stamps_from_zero, "is not above 0"),
        (stamps_that_stand_still, "do not increase"),
        (no_velocity, "velocities of PSM1 are not 6"),
        (other_type, "of type geometry_msgs/msg/TransformStamped"),
        (in_millimetres, "moves through"),
    ],
)
def test_a_broken_bag_is_rejected(bag, tmp_path, change, told):
    assert told in "; ".join(faults(rewrite(bag, tmp_path / "broken", change), ["PSM1", "PSM2"]))


def test_a_bag_of_another_storage_is_rejected(bag, tmp_path):
    copy = rewrite(bag, tmp_path / "broken", list, StoragePlugin.SQLITE3)
    assert faults(copy, ["PSM1", "PSM2"]) == ["stored as sqlite3"]


def test_a_single_file_is_rejected(bag):
    assert faults(bag / "bag.mcap", ["PSM1", "PSM2"]) == ["no folder of a bag"]


@pytest.mark.parametrize("arm", ["PSM1", "PSM2"])
def test_messages_hold_the_set_points(bag, two_slow_arms, arm):
    found = {topic: [m for t, _, _, m in read(bag) if t == f"/{arm}/{topic}"] for topic in TOPICS}
    points = two_slow_arms.arms[arm]
    for topic in ("setpoint_cp", "local/setpoint_cp"):  # equal where no base frame was set
        poses = [message.pose for message in found[topic]]
        np.testing.assert_array_equal([[p.position.x, p.position.y, p.position.z] for p in poses], points.position)
        turns = Rotation.from_quat([[getattr(p.orientation, axis) for axis in "xyzw"] for p in poses])
        assert (turns.inv() * Rotation.from_quat(points.quaternion)).magnitude().max() < 1e-9
        assert {message.header.frame_id for message in found[topic]} == {f"{arm}_base"}
    np.testing.assert_array_equal([message.position for message in found["setpoint_js"]], points.joints)
    np.testing.assert_array_equal([message.position[0] for message in found["jaw/setpoint_js"]], points.jaw)


def test_velocities_are_those_of_the_positions(bag, two_slow_arms):
    joints = two_slow_arms.arms["PSM1"].joints
    velocity = np.array([message.velocity for topic, _, _, message in read(bag) if topic == "/PSM1/setpoint_js"])
    # Ten set-points a second: in 0.2 s from the one before to the one after.
    np.testing.assert_allclose(velocity[1:-1], (joints[2:] - joints[:-2]) / 0.2, rtol=0, atol=1e-12)


def test_stamps_run_at_the_rate_and_are_those_of_the_log(bag, two_slow_arms):
    found = [(time, message.header.stamp) for topic, _, time, message in read(bag) if topic == "/PSM2/setpoint_cp"]
    assert [time for time, _ in found] == [at.sec * 10**9 + at.nanosec for _, at in found]
    np.testing.assert_allclose(np.diff([time for time, _ in found]), 10**8)


def test_poses_are_also_given_in_a_frame_that_was_measured(two_slow_arms, tmp_path):
    from dataclasses import replace

    base = np.eye(4)
    base[:3, 3] = (0.1, 0.2, 0.3)
    arms = {arm: replace(points, base=base) for arm, points in two_slow_arms.arms.items()}
    write_bag(replace(two_slow_arms, frame="camera", arms=arms), tmp_path / "bag")
    found = {topic: message for topic, _, _, message in read(tmp_path / "bag")}
    there, local = found["/PSM1/setpoint_cp"], found["/PSM1/local/setpoint_cp"]
    assert (there.header.frame_id, local.header.frame_id) == ("camera", "PSM1_base")
    assert there.pose.position.x - local.pose.position.x == pytest.approx(0.1)
