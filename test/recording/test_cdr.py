"""Decoding CDR as columns gives what rosbags decodes one by one, for all layouts."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from poise.recording.cdr import UndecodableError, decode

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types


def header(rng, frame):
    time = TYPES["builtin_interfaces/msg/Time"](sec=int(rng.integers(-9, 2**31)), nanosec=int(rng.integers(10**9)))
    return TYPES["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def vector(rng, kind="Vector3"):
    x, y, z = rng.normal(size=3).tolist()
    return TYPES[f"geometry_msgs/msg/{kind}"](x=x, y=y, z=z)


def quaternion(rng):
    x, y, z, w = rng.normal(size=4).tolist()
    return TYPES["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)


def wrench(rng):
    body = TYPES["geometry_msgs/msg/Wrench"](force=vector(rng), torque=vector(rng))
    frame = str(rng.choice(["", "ft", "ft_sensor", "μ"]))
    return TYPES["geometry_msgs/msg/WrenchStamped"](header=header(rng, frame), wrench=body)


def joint_state(rng):
    joints = int(rng.integers(0, 4))
    some = [rng.normal(size=joints if rng.random() < 0.7 else 0) for _ in range(3)]
    names = [f"joint_{'x' * int(rng.integers(3))}{i}" for i in range(joints)]
    head = header(rng, str(rng.choice(["", "world"])))
    return TYPES["sensor_msgs/msg/JointState"](
        header=head, name=names, position=some[0], velocity=some[1], effort=some[2]
    )


def tf(rng):
    def stamped():
        transform = TYPES["geometry_msgs/msg/Transform"](translation=vector(rng), rotation=quaternion(rng))
        frames = rng.choice(["base", "ft_sensor", "a"], 2).tolist()
        make = TYPES["geometry_msgs/msg/TransformStamped"]
        return make(header=header(rng, frames[0]), child_frame_id=frames[1], transform=transform)

    return TYPES["tf2_msgs/msg/TFMessage"](transforms=[stamped() for _ in range(int(rng.integers(0, 4)))])


def flatten(kind, message):
    """Bring a message of rosbags to what a batch holds of one message."""
    if kind == "tf2_msgs/msg/TFMessage":
        return [
            (
                stamp(part.header),
                part.header.frame_id,
                part.child_frame_id,
                list(vars(part.transform.translation).values())[:3],
                list(vars(part.transform.rotation).values())[:4],
            )
            for part in message.transforms
        ]
    head = (stamp(message.header), message.header.frame_id)
    if kind == "geometry_msgs/msg/WrenchStamped":
        force, torque = message.wrench.force, message.wrench.torque
        return [(*head, [force.x, force.y, force.z, torque.x, torque.y, torque.z])]
    numbers = (message.position.tolist(), message.velocity.tolist(), message.effort.tolist())
    return [(*head, tuple(message.name), *numbers)]


def stamp(head):
    return head.stamp.sec * 10**9 + head.stamp.nanosec


def plain(value, row):
    if isinstance(value, np.ndarray):
        return value[row].tolist()
    return value


FIELDS = {
    "geometry_msgs/msg/WrenchStamped": ("stamp", "frame_id", "wrench"),
    "sensor_msgs/msg/JointState": ("stamp", "frame_id", "names", "position", "velocity", "effort"),
    "tf2_msgs/msg/TFMessage": ("stamp", "frame_id", "child_frame_id", "translation", "rotation"),
}
MAKERS = dict(zip(FIELDS, (wrench, joint_state, tf), strict=True))


def pack(rng, messages):
    """Lay messages one behind the other with rubbish between them."""
    data, starts = bytearray(), []
    for message in messages:
        data += rng.bytes(int(rng.integers(5)))
        starts.append(len(data))
        data += message
    return bytes(data), np.array(starts), np.array([len(message) for message in messages])


@pytest.mark.parametrize("count", [1, 300])
@pytest.mark.parametrize("little", [True, False], ids=["little-endian", "big-endian"])
@pytest.mark.parametrize("kind", FIELDS)
def test_mixed_layouts_decode_as_rosbags_decodes_them(kind, little, count):
    rng = np.random.default_rng(count)
    encoded = [bytes(STORE.serialize_cdr(MAKERS[kind](rng), kind, little_endian=little)) for _ in range(count)]
    found = {}
    for batch in decode(kind, *pack(rng, encoded)):
        for row, index in enumerate(batch.index.tolist()):
            assert index not in found
            found[index] = [tuple(plain(element[name], row) for name in FIELDS[kind]) for element in batch.elements]
    expected = {i: flatten(kind, STORE.deserialize_cdr(data, kind)) for i, data in enumerate(encoded)}
    assert found == expected


def test_padding_that_holds_rubbish_does_not_split_the_columns():
    rng = np.random.default_rng(0)
    kind = "geometry_msgs/msg/WrenchStamped"
    encoded = []
    for number in range(50):
        message = wrench(rng)
        message.header.frame_id = "f"  # two bytes of padding before the numbers
        data = bytearray(STORE.serialize_cdr(message, kind))
        data[18:20] = bytes([number, 255 - number])
        encoded.append(bytes(data))
    assert len(list(decode(kind, *pack(rng, encoded)))) == 1


def test_what_rclpy_leaves_behind_the_content_is_ignored():
    # rclpy.serialization.serialize_message(JointState(name=["abc", "d"], position=[1.0, 2.0], effort=[3.0, 4.0]))
    captured = bytes.fromhex(
        "00010000 00000000 00000000 01000000 00000000 02000000 04000000 61626300 02000000 64000000 02000000 00000000"
        "0000f03f 00000000 00000040 00000000 02000000 00000000 00000840 00000000 00001040 00000000 00000000"
    )
    (batch,) = decode("sensor_msgs/msg/JointState", captured, np.array([0]), np.array([len(captured)]))
    (element,) = batch.elements
    assert element["names"] == ("abc", "d")
    assert element["position"].tolist() == [[1.0, 2.0]]
    assert element["velocity"].shape == (1, 0)
    assert element["effort"].tolist() == [[3.0, 4.0]]


@pytest.mark.parametrize("kind", FIELDS)
def test_messages_of_another_type_or_cut_short_are_refused(kind):
    rng = np.random.default_rng(1)
    wrong = bytes(STORE.serialize_cdr(TYPES["std_msgs/msg/String"](data="x" * 99), "std_msgs/msg/String"))
    cut = bytes(STORE.serialize_cdr(wrench(rng), "geometry_msgs/msg/WrenchStamped"))[:40]
    for message in (wrong, cut, b"", b"\0\7\0\0" + bytes(60)):
        with pytest.raises(UndecodableError):
            list(decode(kind, *pack(rng, [message])))


@pytest.mark.parametrize("kind", FIELDS)
def test_random_bytes_are_refused_or_decoded_but_never_crash(kind):
    rng = np.random.default_rng(2)
    for _ in range(300):
        message = bytearray(bytes(STORE.serialize_cdr(MAKERS[kind](rng), kind)))
        message[int(rng.integers(4, len(message)))] = int(rng.integers(256))
        try:
            list(decode(kind, *pack(rng, [bytes(message)])))
        except UndecodableError as error:
            assert str(error)  # noqa: PT017
