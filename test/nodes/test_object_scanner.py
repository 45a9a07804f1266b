"""object_scanner in a real graph: the committed sweep becomes an object with parts, or it is said why not."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectory

from poise.errors import ErrorCode
from poise.fake_robots.compressing import compressed_bytes, depth_png, depth_rvl, picture_bytes
from poise.fake_robots.sweep_bag import info_bytes
from poise.nodes.payload_shape import parts_of_message
from poise.recording import COMPRESSED, RecordingWriter, image_of, open_recording, stamp_of
from poise.recording.images import decoded
from poise.scanning import Camera, camera_of
from poise.scanning.cloud_frames import columns_of
from poise_msgs.action import ScanObject
from poise_msgs.msg import SegmentedObject

pytestmark = pytest.mark.ros
BAG = Path(__file__).parents[2] / "bags" / "hammer_sweep.mcap"
DEPTH, INFO = "camera/aligned_depth_to_color/image_raw", "camera/aligned_depth_to_color/camera_info"
COLOUR = "camera/color/image_raw"
ROBOT = ["robot_description", "joint_states"]
REPLAY = {"mode": "replay", "bag": str(BAG), "rate": 2.0, "wait_for_subscribers": [DEPTH, "joint_states"]}
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PATIENCE = 120.0
"""s: reading, fusing and cutting take their time on a machine that does other things."""


class Caller:
    """Sends goals, and keeps what comes back."""

    def __init__(self, graph) -> None:
        self._graph = graph
        self._client = ActionClient(graph.node, ScanObject, "scan_object")
        self.feedback = []

    def send(self, **fields):
        """The handle of an accepted goal."""
        self._graph.wait_for(self._client.server_is_ready, what="the action")
        keep = lambda said: self.feedback.append(said.feedback)  # noqa: E731
        future = self._client.send_goal_async(ScanObject.Goal(**fields), feedback_callback=keep)
        self._graph.wait_for(future.done, what="acceptance")
        assert future.result().accepted
        return future.result()

    def result(self, handle):
        future = handle.get_result_async()
        self._graph.wait_for(future.done, PATIENCE, "the result")
        return future.result()

    def close(self) -> None:
        self._client.destroy()


@pytest.fixture
def caller(graph):
    caller = Caller(graph)
    yield caller
    caller.close()


def test_a_replayed_sweep_becomes_an_object_with_parts(start_node, graph, caller) -> None:
    objects = graph.collect("segmented_object", SegmentedObject, LATCHED)
    transforms = graph.collect("tf_static", TFMessage, LATCHED)
    start_node("object_scanner", {"patience": 20.0, "independent_parts": True})
    start_node("fake_robot", REPLAY)
    done = caller.result(caller.send(id="hammer", max_frames=40))
    assert done.result.error.message == ""
    assert done.status == GoalStatus.STATUS_SUCCEEDED
    found = done.result.object
    assert found.id == found.header.frame_id == "hammer"
    assert found.volume == pytest.approx(2.08e-4, rel=0.3)
    assert sum(part.volume for part in found.parts) == pytest.approx(found.volume)
    assert 2 <= len(found.parts) <= 4
    assert parts_of_message(found).volumes.sum() == pytest.approx(found.volume)  # what the estimator makes of it
    columns = columns_of(found.cloud, "cloud")
    assert columns["label"].max() < len(found.parts)
    assert 0.5 < columns["seen"].mean() < 1.0
    assert np.ptp(columns["x"]) > 0.2
    assert columns["z"].min() == pytest.approx(0.0, abs=0.003)  # the frame stands on the table
    for part in found.parts:
        assert len(part.surface.triangles) > 4
    graph.wait_for(lambda: objects, what="segmented_object")
    graph.wait_for(
        lambda: any(t.child_frame_id == "hammer" for message in transforms for t in message.transforms),
        what="its frame",
    )
    (placed,) = [t for message in transforms for t in message.transforms if t.child_frame_id == "hammer"][:1]
    assert placed.header.frame_id == "base_link"
    assert placed.transform.translation.x == pytest.approx(0.45, abs=0.01)
    assert max(said.frames for said in caller.feedback) > 0
    assert all(0 <= said.progress <= 1 for said in caller.feedback)


def compressed_sweep(path):
    """The sweep by image_transport: depth as PNG and RVL in turns, colours as JPEG of half the size."""
    recording, count = open_recording(BAG), 0
    renamed = {DEPTH: f"{DEPTH}/compressedDepth", COLOUR: f"{COLOUR}/compressed"}
    colour_info = "camera/color/camera_info"
    with RecordingWriter(path) as writer:
        for name, kind in recording.topics.items():
            writer.add_topic(renamed.get(name, name), COMPRESSED if name in renamed else kind)
        writer.add_topic(colour_info, recording.topics[INFO])
        for message in recording.messages(list(recording.topics)):
            name, data = message.topic, message.data
            if name in renamed:
                image = image_of(decoded(recording, recording.topics[name], name, data), name)
                if name == DEPTH:
                    way, pack = [("png", depth_png), ("rvl", depth_rvl)][count % 2]
                    count += 1
                    packed, layout = pack(image.pixels), f"16UC1; compressedDepth {way}"
                else:
                    pixels = image.pixels[::2, ::2]
                    packed, layout = picture_bytes(np.ascontiguousarray(pixels), "JPEG"), "rgb8; jpeg compressed bgr8"
                data = compressed_bytes(image.stamp, image.frame_id, layout, packed)
            elif name == INFO:
                said = decoded(recording, recording.topics[name], name, data)
                whole = camera_of(said)
                half = Camera(
                    whole.width // 2, whole.height // 2, *np.array([whole.fx, whole.fy, whole.cx, whole.cy]) / 2
                )
                frame = str(said.header.frame_id)
                writer.write(colour_info, message.log_time, info_bytes(stamp_of(said), frame, half))
            writer.write(renamed.get(name, name), message.log_time, data)
    return path


def test_compressed_and_unaligned_images_give_the_same_object(start_node, caller, tmp_path) -> None:
    bag = compressed_sweep(tmp_path / "compressed.mcap")
    transports = {"image_transport": "compressed", "depth_image_transport": "compressedDepth"}
    start_node("object_scanner", {"patience": 20.0, **transports})
    listened = [f"{DEPTH}/compressedDepth", f"{COLOUR}/compressed", "joint_states"]
    start_node("fake_robot", REPLAY | {"bag": str(bag), "wait_for_subscribers": listened})
    done = caller.result(caller.send(id="hammer", max_frames=30))
    assert done.result.error.message == ""
    found = done.result.object
    assert found.volume == pytest.approx(2.08e-4, rel=0.3)
    assert any("looked up in the colour image" in note for note in found.notes)
    assert columns_of(found.cloud, "cloud")["rgb"].view(np.uint32).any()


@pytest.mark.parametrize(
    ("topics", "code", "word"),
    [
        ([*ROBOT, DEPTH, INFO, COLOUR], ErrorCode.FRAME_UNKNOWN, "hand-eye"),
        ([*ROBOT, "tf_static", DEPTH, COLOUR], ErrorCode.TOPIC_MISSING, "camera_info"),
    ],
)
def test_what_is_missing_is_named(start_node, caller, topics, code, word) -> None:
    start_node("object_scanner", {"patience": 20.0})
    start_node("fake_robot", REPLAY | {"topics": topics})
    done = caller.result(caller.send(max_frames=3))
    assert done.status == GoalStatus.STATUS_ABORTED
    assert done.result.error.code == code
    assert word in done.result.error.message


def test_without_a_camera_the_goal_ends_and_says_why(start_node, caller) -> None:
    start_node("object_scanner", {"patience": 0.5})
    done = caller.result(caller.send(stationary=True))
    assert done.result.error.code == ErrorCode.TOPIC_MISSING
    assert "no depth" in done.result.error.message


def test_a_goal_is_cancelled_and_a_second_one_is_refused_meanwhile(start_node, caller, graph) -> None:
    start_node("object_scanner", {"patience": 500.0, "duration": 500.0})
    first = caller.send()
    second = caller.result(caller.send())
    assert second.result.error.code == ErrorCode.BUSY
    cancelling = first.cancel_goal_async()
    graph.wait_for(cancelling.done, what="the cancellation")
    done = caller.result(first)
    assert done.status == GoalStatus.STATUS_CANCELED
    assert done.result.error.code == ErrorCode.CANCELLED


@pytest.mark.parametrize("wrong", [{"near": [1.0, 2.0]}, {"hand_eye": [0.0] * 7}])
def test_parameters_that_make_no_sense_end_the_node(start_node, wrong) -> None:
    node = start_node("object_scanner", wrong)
    assert node.wait() == 2
    assert "BAD_INPUT" in node.output


@pytest.mark.parametrize(("patience", "code"), [(30.0, ErrorCode.CANCELLED), (3.0, ErrorCode.TOPIC_MISSING)])
def test_a_sweep_is_stopped_by_a_motion_that_any_controller_takes(start_node, caller, graph, tmp_path, patience, code):
    """Cancelled, or without a camera. A message without points is refused by ros2_control: the arm would go on."""
    states = graph.collect("joint_states", JointState)
    commands = graph.collect("joint_trajectory", JointTrajectory)
    start_node("fake_robot", {"mode": "arm", "robot": "fr3", "joint_noise": 0.0})
    begin = graph.wait_for(lambda: states and states[-1], what="joint states")
    end = [begin.position[0] + 1.0, *list(begin.position)[1:]]
    waypoints = [{"time": 0.0, "position": list(begin.position)}, {"time": 12.0, "position": end}]
    sweep = tmp_path / "sweep.yaml"
    sweep.write_text(yaml.safe_dump({"joints": list(begin.name), "waypoints": waypoints}))
    start_node("object_scanner", {"sweep": str(sweep), "patience": patience})

    def moving():
        handle = caller.send()
        result = handle.get_result_async()
        graph.wait_for(lambda: result.done() or states[-1].position[0] - begin.position[0] > 0.002, what="a motion")
        return not result.done() and handle

    handle = graph.wait_for(moving, what="the sweep")
    if code is ErrorCode.CANCELLED:
        handle.cancel_goal_async()
    assert caller.result(handle).result.error.code == code
    graph.wait_for(lambda: end[0] - commands[-1].points[-1].positions[0] > 0.5, what="the stop")
    graph.wait_for(lambda: len(states) > 50 and np.ptp([s.position[0] for s in states[-50:]]) < 1e-9, what="rest")
    assert all(command.points for command in commands)
    assert end[0] - states[-1].position[0] > 0.5


def test_the_arm_is_moved_along_the_sweep_once_it_stands_where_that_begins(start_node, caller, graph, tmp_path) -> None:
    states = graph.collect("joint_states", JointState)
    start_node("fake_robot", {"mode": "arm", "robot": "fr3", "joint_noise": 0.0})
    begin = graph.wait_for(lambda: states and states[-1], what="joint states")
    end = list(begin.position)
    end[0] += 0.3
    waypoints = [{"time": 0.0, "position": list(begin.position)}, {"time": 1.0, "position": end}]
    sweep = tmp_path / "sweep.yaml"
    sweep.write_text(yaml.safe_dump({"joints": list(begin.name), "waypoints": waypoints}))
    start_node("object_scanner", {"sweep": str(sweep), "patience": 4.0})
    unheard = (ErrorCode.ROBOT_DESCRIPTION_MISSING, ErrorCode.TOPIC_MISSING)

    def first() -> bool:
        """A goal that was refused because the robot had not been heard yet is sent again."""
        error = caller.result(caller.send()).result.error
        assert error.code in unheard
        return "no depth" in error.message

    graph.wait_for(first, what="the sweep")
    graph.wait_for(lambda: abs(states[-1].position[0] - end[0]) < 1e-3, what="the end of the sweep")
    assert caller.result(caller.send()).result.error.code == ErrorCode.NOT_FOLLOWING
