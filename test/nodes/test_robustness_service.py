"""The robustness services under bad and heavy calls: frames, versions, and calls that do not delay or change others."""

import math

import pytest
from assembly_calls import CUBE, FRAME, LATCHED, LID, LOW_PUSH, assess, box, change, message, push, replace_by, wall
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage

from poise.errors import ErrorCode
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.srv import AssessRobustness, PlanDisassembly, SetAssembly

pytestmark = pytest.mark.ros
G, MU = 9.80665, 0.5
ADD, REMOVE = SetAssembly.Request.ADD_OR_MOVE, SetAssembly.Request.REMOVE
NAMES = {AssessRobustness: "assess_robustness", PlanDisassembly: "plan_disassembly", SetAssembly: "set_assembly"}


@pytest.fixture
def server(start_node, graph):
    """A server that has the cube."""
    server = start_node("robustness_server", {"longest": 60.0})
    assert ask(graph, replace_by(message(CUBE))).version == 1
    return server


def kind_of(request):
    return next(kind for kind in NAMES if isinstance(request, kind.Request))


def ask(graph, request):
    return graph.call(kind_of(request), NAMES[kind_of(request)], request)


def robustness(graph):
    """Of the low push, and the version that it was computed for."""
    answer = ask(graph, assess(LOW_PUSH))
    assert answer.error.code == ErrorCode.OK, answer.error.message
    return answer.robustness[0].robustness, answer.version


def added(frame, *objects):
    """A request to add objects whose poses are in a frame."""
    there = AssemblyMessage(objects=message(*objects).objects[1:])
    there.header.frame_id = frame
    return change(ADD, there)


def test_an_object_in_another_frame_is_transformed_or_refused(server, graph):
    lid = box("lid", (1, 1, 0.2), (1.1, 0, -2.0), 2.0)  # seen by a camera 2 m over the tray, that looks along its x
    unknown = ask(graph, added("camera_optical", lid))
    assert (unknown.error.code, unknown.version) == (ErrorCode.FRAME_UNKNOWN, 1)
    assert "camera_optical" in unknown.error.message
    asked = assess(LOW_PUSH, frame_id="camera_optical")
    assert ask(graph, asked).error.code == ErrorCode.FRAME_UNKNOWN
    still = graph.node.create_publisher(TFMessage, "tf_static", LATCHED)
    transform = TransformStamped(child_frame_id="camera_optical")
    transform.header.frame_id = FRAME
    # The camera's x is the tray's z, its z is the tray's x.
    transform.transform.translation.x = 2.0
    turn = transform.transform.rotation
    turn.x, turn.y, turn.z, turn.w = 0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5)
    still.publish(TFMessage(transforms=[transform]))
    graph.wait_for(lambda: ask(graph, asked).error.code != ErrorCode.FRAME_UNKNOWN, what="the transform")
    beside = ask(graph, added("camera_optical", box("lid", (0.2, 1, 1), (1.1, 0, 2.0), 2.0)))
    assert (beside.error.code, beside.version) == (ErrorCode.OK, 2), beside.error.message
    assert robustness(graph)[0] == pytest.approx(3 * MU * G, rel=1e-6)
    # The low push, in the camera's frame.
    seen = assess(push("cube", (0.1, 0, 2.5), (0, 0, -1)), frame_id="camera_optical")
    assert ask(graph, seen).robustness[0].robustness == pytest.approx(3 * MU * G, rel=1e-6)


def test_a_change_states_the_version_that_it_expects(server, graph):
    outdated = added("", LID)
    outdated.expected_version = 9
    answer = ask(graph, outdated)
    assert (answer.error.code, answer.version) == (ErrorCode.BAD_INPUT, 1)
    assert "version 1" in answer.error.message
    outdated.expected_version = 1
    answer = ask(graph, outdated)
    assert (answer.error.code, answer.version) == (ErrorCode.OK, 2)
    assert any("frame_id not given" in sentence for sentence in answer.assumptions)
    assert any(sentence.startswith("lid: com not given") for sentence in answer.assumptions)
    assert robustness(graph) == (pytest.approx(3 * MU * G), 2)


def test_what_is_refused_or_late_changes_nothing(server, graph):
    late = replace_by(wall(10, 20))
    late.deadline = 0.05
    refused = [
        added("", box("lid", (1, 1, 0.2), (0, 0, 0.9))),
        added("", box("lid", (1, 1, 0.2), (0, 0, 3.0))),
        added("", LID),
        change(REMOVE, AssemblyMessage(objects=message(LID).objects[1:])),
        replace_by(message(CUBE)),
    ]
    refused[2].assembly.objects[-1].inertia.m = 1e300
    refused[-1].assembly.objects[1].pose.position.z = math.nan
    other = added("", LID)
    other.assembly.friction = 0.9
    for request in [late, *refused, other, late, late]:
        answer = ask(graph, request)
        assert answer.error.code not in (ErrorCode.OK, ErrorCode.UNSTABLE)
        assert robustness(graph) == (pytest.approx(MU * G), 1)


def test_nobody_waits_for_the_maps_of_one_client(server, graph):
    """Long after the deadline of its first map, a client of d280879 still blocked all others."""
    clients = {kind: graph.node.create_client(kind, NAMES[kind], qos_profile=QoSProfile(depth=1000)) for kind in NAMES}
    graph.wait_for(lambda: all(client.service_is_ready() for client in clients.values()), what="the services")
    map_ = assess(assembly=wall(6, 6), map_points=100_000, map_tolerance=0.001, deadline=2.0)
    heavy = [clients[AssessRobustness].call_async(map_) for _ in range(8)]
    order = clients[PlanDisassembly].call_async(PlanDisassembly.Request(assembly=[wall(10, 20)], deadline=0.5))
    assert robustness(graph)[0] == pytest.approx(MU * G)
    assert not all(future.done() for future in heavy)
    graph.wait_for(lambda: order.done() and all(future.done() for future in heavy), what="the heavy calls")
    assert {future.result().error.code for future in heavy} <= {ErrorCode.OK, ErrorCode.DEADLINE}
    # Nothing is left to do: the next heavy call is answered in its time.
    assert ask(graph, assess(map_points=200)).error.code == ErrorCode.OK


def test_heavy_calls_beyond_their_queue_are_refused_and_others_are_not(start_node, graph):
    start_node("robustness_server", {"waiting_heavy": 2})
    health = graph.collect("/diagnostics", DiagnosticArray)
    client = graph.node.create_client(AssessRobustness, "assess_robustness", qos_profile=QoSProfile(depth=1000))
    graph.wait_for(client.service_is_ready, what="the service")
    map_ = assess(assembly=wall(4, 4), map_points=50_000, map_tolerance=0.001, deadline=3.0)
    maps = [client.call_async(map_) for _ in range(12)]
    assert ask(graph, assess(LOW_PUSH, assembly=message(CUBE))).error.code == ErrorCode.OK
    graph.wait_for(lambda: all(future.done() for future in maps), what="the maps")
    codes = [future.result().error.code for future in maps]
    assert codes.count(ErrorCode.BUSY) >= 8
    graph.wait_for(lambda: health, what="diagnostics")
    values = {entry.key: entry.value for entry in health[-1].status[0].values}
    assert {"waiting", "waiting_heavy", "running", "restarts", "workers", "version"} <= set(values)
