"""robustness_server in a real graph: its answers, the assembly it keeps, and the code of everything gone wrong."""

import math

import numpy as np
import pytest
from assembly_calls import (
    CUBE,
    FLOOR,
    FRAME,
    LATCHED,
    LID,
    LOW_PUSH,
    assess,
    box,
    change,
    message,
    push,
    records,
    replace_by,
    wall,
)
from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from poise.assembly import Analysis, Assembly, Box, Cylinder, FrictionPair, Mesh, Push, RigidObject, write_scene
from poise.assembly import assess as assess_in_core
from poise.errors import ErrorCode
from poise.geometry import Pose
from poise.nodes.assembly_message import assembly_message, assembly_of
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.msg import Robustness
from poise_msgs.srv import AssessRobustness, PlanDisassembly, SetAssembly

pytestmark = pytest.mark.ros
G = 9.80665
MU = 0.5


def ask(graph, request):
    """The answer of the service that a request is for."""
    names = {AssessRobustness: "assess_robustness", PlanDisassembly: "plan_disassembly", SetAssembly: "set_assembly"}
    kind = next(kind for kind in names if isinstance(request, kind.Request))
    return graph.call(kind, names[kind], request)


@pytest.fixture
def server(start_node, graph):
    """A server with nothing set."""
    return start_node("robustness_server")


@pytest.fixture(scope="module")
def answering(shared):
    """The graph of a server that several tests ask, each about an assembly of its own."""
    graph, start = shared
    start("robustness_server")
    return graph


# -- answers -----------------------------------------------------------------------------------------------------


def test_a_push_with_its_own_assembly_is_answered_as_by_the_core(answering):
    pushes = [LOW_PUSH, push("cube", (-0.5, 0.1, 0.9), (1, 0.2, 0)), push("cube", (0, 0, 1), (0, 0, -1))]
    answer = ask(answering, assess(*pushes, assembly=message(CUBE)))
    assert (answer.error.code, answer.stable) == (ErrorCode.OK, True)
    core = assess_in_core(
        Assembly((FLOOR, CUBE)),
        [Push("cube", *((v.x, v.y, v.z) for v in (asked.point, asked.direction))) for asked in pushes],
    )
    assert answer.margin == pytest.approx(core.margin)
    for answered, result in zip(answer.robustness, core.results, strict=True):
        numbers = (answered.robustness, answered.lower, answered.upper)
        assert numbers == pytest.approx((result.robustness, result.lower, result.upper), rel=1e-12)
        assert list(answered.moves) == list(result.moves)
    slip, _, down = answer.robustness
    assert slip.robustness == pytest.approx(MU * G)
    assert (slip.mode, down.mode, down.robustness) == (Robustness.MODE_SLIP, Robustness.MODE_NONE, math.inf)
    assert slip.mechanism[0].linear.x == pytest.approx(1.0)


def test_pushes_of_a_group_grow_together(answering):
    two = [LOW_PUSH, push("cube", (-0.5, 0.2, 0.1), (1, 0, 0)), push("cube", (-0.5, -0.2, 0.1), (1, 0, 0))]
    answer = ask(answering, assess(*two, assembly=message(CUBE), groups=[7, 3, 3]))
    together, alone = (result.robustness for result in answer.robustness)
    assert alone == pytest.approx(MU * G)
    assert together == pytest.approx(MU * G / 2)
    assert ask(answering, assess(*two, assembly=message(CUBE), groups=[1])).error.code == ErrorCode.BAD_INPUT


def test_a_map_is_certified_to_its_tolerance_and_names_what_moves(answering):
    answer = ask(answering, assess(assembly=message(CUBE, LID), map_points=500, map_tolerance=0.05))
    assert answer.error.code == ErrorCode.OK
    (found,) = answer.map
    points = records(found.cloud)
    lower, upper = points["lower"], points["upper"]
    assert found.complete
    assert 450 < len(points) == found.cloud.width <= 500
    np.testing.assert_allclose(np.linalg.norm([points[f"normal_{axis}"] for axis in "xyz"], axis=0), 1, atol=1e-6)
    assert np.all(upper[np.isfinite(upper)] <= 1.05 * lower[np.isfinite(upper)] + 1e-9)
    for point in points:
        assert point["mover"] < 0 or found.ids[point["object"]] in found.movers[point["mover"]].ids
    assert found.header.frame_id == found.cloud.header.frame_id == FRAME


def test_the_order_of_disassembly_begins_at_the_top(answering):
    answer = ask(answering, PlanDisassembly.Request(assembly=[message(CUBE, LID)]))
    assert (list(answer.order), list(answer.safe)) == (["lid", "cube"], [True, True])
    assert answer.margins[-1] == math.inf
    assert [(way.x, way.y, way.z) for way in answer.ways] == [(0.0, 0.0, 1.0)] * 2
    one = ask(answering, PlanDisassembly.Request(assembly=[message(CUBE, LID)], target="cube"))
    assert list(one.order) == ["lid", "cube"]


# -- the assembly that is kept ----------------------------------------------------------------------------------


def test_a_scene_file_is_there_from_the_start_and_published(start_node, graph, tmp_path):
    write_scene(Assembly((FLOOR, CUBE)), tmp_path / "scene.yaml")
    assemblies = graph.collect("assembly", AssemblyMessage, LATCHED)
    markers = graph.collect("robustness_markers", MarkerArray, LATCHED)
    start_node("robustness_server", {"scene": str(tmp_path / "scene.yaml"), "frame_id": FRAME, "marker_map_points": 50})
    assert ask(graph, assess(LOW_PUSH)).robustness[0].robustness == pytest.approx(MU * G)
    # The map is computed after the markers without it.
    graph.wait_for(
        lambda: assemblies and markers and any(marker.ns == "map" for marker in markers[-1].markers),
        what="the latched topics, and the map",
    )
    assert [item.id for item in assemblies[-1].objects] == ["floor", "cube"]
    assert assemblies[-1].header.frame_id == FRAME
    kinds = {marker.ns: marker.type for marker in markers[-1].markers}
    assert kinds["objects"] == Marker.CUBE
    assert kinds["map"] == Marker.POINTS
    assert {marker.header.frame_id for marker in markers[-1].markers} == {FRAME}


def test_objects_are_added_moved_and_removed(server, graph):
    request = SetAssembly.Request
    assert ask(graph, replace_by(message(CUBE))).stable
    added = AssemblyMessage(objects=message(LID).objects[1:])
    assert ask(graph, change(request.ADD_OR_MOVE, added)).error.code == ErrorCode.OK
    assert ask(graph, assess(LOW_PUSH)).robustness[0].robustness == pytest.approx(3 * MU * G)
    # The lid beside the cube, and a rougher floor under it.
    moved = AssemblyMessage(objects=message(box("lid", (1, 1, 0.2), (3, 0, 0.1), 2.0)).objects[1:])
    moved.friction_pairs = assembly_message(Assembly((FLOOR, CUBE)), "").friction_pairs
    assert ask(graph, change(request.ADD_OR_MOVE, moved)).stable
    assert ask(graph, assess(LOW_PUSH)).robustness[0].robustness == pytest.approx(MU * G)
    gone = AssemblyMessage(objects=moved.objects)
    assert ask(graph, change(request.REMOVE, gone)).stable
    assert ask(graph, assess(push("lid", (3, 0, 0.2), (1, 0, 0)))).error.code == ErrorCode.OBJECT_UNKNOWN
    assert ask(graph, change(request.REMOVE, gone)).error.code == ErrorCode.OBJECT_UNKNOWN
    assert ask(graph, change(9, gone)).error.code == ErrorCode.BAD_INPUT


def test_an_assembly_published_by_others_is_taken_in(server, graph):
    publisher = graph.node.create_publisher(AssemblyMessage, "assembly", LATCHED)
    publisher.publish(message(CUBE, LID))
    graph.wait_for(lambda: ask(graph, assess(LOW_PUSH)).error.code == ErrorCode.OK, what="the assembly")
    assert ask(graph, assess(LOW_PUSH)).robustness[0].robustness == pytest.approx(3 * MU * G)
    publisher.publish(message(box("cube", (1, 1, 1), (0, 0, 0.2))))
    graph.wait_for(
        lambda: ask(graph, assess(LOW_PUSH)).error.code == ErrorCode.INTERPENETRATION, what="the overlap to be reported"
    )


def test_objects_follow_their_frames_in_tf(start_node, graph, tmp_path):
    write_scene(Assembly((FLOOR, CUBE, LID)), tmp_path / "scene.yaml")
    parameters = {"scene": str(tmp_path / "scene.yaml"), "frame_id": FRAME, "poses_from_tf": True, "tf_rate": 20.0}
    assemblies = graph.collect("assembly", AssemblyMessage, LATCHED)
    start_node("robustness_server", parameters)
    fixed = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    still, moving = (graph.node.create_publisher(TFMessage, *of) for of in (("tf_static", fixed), ("tf", 10)))
    # The tray hangs upside down under the camera, which sees the cube and the lid.
    still.publish(TFMessage(transforms=[transform("camera", FRAME, (0, 0, 2), (1.0, 0.0, 0.0, 0.0))]))
    graph.wait_for(lambda: moving.get_subscription_count(), what="the server at tf")
    beside = transform("camera", "lid", (3, 0, 1.9), (1.0, 0.0, 0.0, 0.0))
    moving.publish(TFMessage(transforms=[beside, transform("camera", "spare", (math.nan, 0, 0))]))
    graph.wait_for(lambda: assemblies and assemblies[-1].objects[2].pose.position.x == 3.0, what="the moved lid")
    place = assemblies[-1].objects[2].pose
    np.testing.assert_allclose([place.position.z, place.orientation.w], [0.1, 1.0], atol=1e-12)
    assert ask(graph, assess(LOW_PUSH)).robustness[0].robustness == pytest.approx(MU * G)


def test_a_bad_assembly_is_reported_until_a_good_one_comes(start_node, graph):
    parameters = {"poses_from_tf": True, "tf_rate": 50.0}
    server = start_node("robustness_server", parameters)
    assert ask(graph, replace_by(message(CUBE, LID))).stable
    sunk = message(box("cube", (1, 1, 1), (0, 0, 0.2)), LID)
    sunk.header.frame_id = "other"
    publisher = graph.node.create_publisher(AssemblyMessage, "assembly", LATCHED)
    moving = graph.node.create_publisher(TFMessage, "tf", 10)
    graph.wait_for(lambda: publisher.get_subscription_count() and moving.get_subscription_count(), what="the server")
    publisher.publish(sunk)
    graph.wait_for(lambda: ask(graph, assess(LOW_PUSH)).error.code == ErrorCode.INTERPENETRATION, what="the refusal")
    for step in range(20):
        place = (3 + 0.1 * step, 0, 0.1)
        # Either frame of the two assemblies would move the lid of the first.
        moving.publish(TFMessage(transforms=[transform(FRAME, "other", (0, 0, 0)), transform(FRAME, "lid", place)]))
        assert ask(graph, assess(LOW_PUSH)).error.code == ErrorCode.INTERPENETRATION
    assert ask(graph, change(SetAssembly.Request.REMOVE, message(LID))).error.code == ErrorCode.INTERPENETRATION
    assert "INTERPENETRATION" in server.output
    assert ask(graph, replace_by(message(CUBE))).stable
    assert ask(graph, assess(LOW_PUSH)).error.code == ErrorCode.OK


def test_poses_from_tf_that_overlap_are_reported_until_they_are_back(start_node, graph):
    start_node("robustness_server", {"poses_from_tf": True, "tf_rate": 50.0})
    assert ask(graph, replace_by(message(CUBE, LID))).stable
    moving = graph.node.create_publisher(TFMessage, "tf", 10)
    graph.wait_for(moving.get_subscription_count, what="the server at tf")
    for height, code in ((0.9, ErrorCode.INTERPENETRATION), (1.1, ErrorCode.OK)):
        moving.publish(TFMessage(transforms=[transform(FRAME, "lid", (0, 0, height))]))
        graph.wait_for(lambda: ask(graph, assess(LOW_PUSH)).error.code == code, what=code.name)  # noqa: B023


def transform(parent, child, shift, turn=(0.0, 0.0, 0.0, 1.0)):
    stamped = TransformStamped(child_frame_id=child)
    stamped.header.frame_id = parent
    place, rotation = stamped.transform.translation, stamped.transform.rotation
    place.x, place.y, place.z = map(float, shift)
    rotation.x, rotation.y, rotation.z, rotation.w = turn
    return stamped


# -- what goes wrong ----------------------------------------------------------------------------------------------


def test_every_bad_input_has_its_code_and_a_sentence_that_names_it(answering):
    good = message(CUBE)
    floating = message(CUBE, box("cup", (0.1, 0.1, 0.1), (0, 0, 3)))
    no_floor = assembly_message(Assembly((FLOOR, CUBE)), FRAME)
    no_floor.objects = no_floor.objects[1:]
    leaning = message(CUBE, box("brick", (1, 0.2, 0.2), (0.6, 0, 1.1)))
    broken = {
        "box": changed(CUBE, lambda item: item.primitive.dimensions.__setitem__(1, -1.0)),
        "sizes": changed(CUBE, lambda item: item.primitive.dimensions.pop()),
        "mesh": changed(CUBE, lambda item: setattr(item, "shape", item.SHAPE_MESH)),
        "file": changed(
            CUBE, lambda item: (setattr(item, "shape", item.SHAPE_URI), setattr(item, "mesh_uri", "/etc/x"))
        ),
        "shape": changed(CUBE, lambda item: setattr(item, "shape", 9)),
        "pose": changed(CUBE, lambda item: setattr(item.pose.orientation, "w", 0.5)),
        "place": changed(CUBE, lambda item: setattr(item.pose.position, "x", math.nan)),
    }
    cases = [
        (floating, LOW_PUSH, ErrorCode.FLOATING, "cup"),
        (no_floor, LOW_PUSH, ErrorCode.BAD_INPUT, "fixed"),
        (leaning, LOW_PUSH, ErrorCode.UNSTABLE, "brick"),
        *((mass(value), LOW_PUSH, code, "cube") for value, code in MASSES),
        (message(CUBE, friction=0.5), push("ghost", (0, 0, 0), (1, 0, 0)), ErrorCode.OBJECT_UNKNOWN, "ghost"),
        (good, push("cube", (-0.6, 0, 0.1), (1, 0, 0)), ErrorCode.POINT_OFF_SURFACE, "100.0 mm"),
        (good, push("cube", (-0.5, 0, 0.1), (0, 0, 0)), ErrorCode.BAD_INPUT, "direction"),
        (good, push("cube", (-0.5, 0, math.nan), (1, 0, 0)), ErrorCode.NOT_FINITE, "point"),
        (message(box("cube", (1, 1, 1), (0, 0, 0.4))), LOW_PUSH, ErrorCode.INTERPENETRATION, "cube"),
        (broken["box"], LOW_PUSH, ErrorCode.OBJECT_INVALID, "cube"),
        (broken["sizes"], LOW_PUSH, ErrorCode.BAD_INPUT, "cube"),
        (broken["mesh"], LOW_PUSH, ErrorCode.MESH_INVALID, "cube"),
        (broken["file"], LOW_PUSH, ErrorCode.UNSUPPORTED, "mesh_folders"),
        (broken["shape"], LOW_PUSH, ErrorCode.OBJECT_INVALID, "cube"),
        (broken["pose"], LOW_PUSH, ErrorCode.BAD_INPUT, "cube"),
        (broken["place"], LOW_PUSH, ErrorCode.NOT_FINITE, "cube"),
    ]
    for assembly, asked, code, word in cases:
        answer = ask(answering, assess(asked, assembly=assembly))
        assert (ErrorCode(answer.error.code), word in answer.error.message) == (code, True), answer.error.message
    slippery = message(CUBE)
    slippery.friction = -0.1
    assert ask(answering, assess(LOW_PUSH, assembly=slippery)).error.code == ErrorCode.BAD_INPUT
    assert ask(answering, assess(LOW_PUSH)).error.code == ErrorCode.EMPTY
    assert ask(answering, assess(LOW_PUSH, assembly=good, model="magic")).error.code == ErrorCode.BAD_INPUT
    many = [LOW_PUSH] * 10_001
    for sizes in (assess(assembly=good, map_points=100_001), assess(*many, assembly=good)):
        answer = ask(answering, sizes)
        assert (answer.error.code, "at most" in answer.error.message) == (ErrorCode.BAD_INPUT, True)
    assert (
        ask(answering, PlanDisassembly.Request(assembly=[good], target="ghost")).error.code == ErrorCode.OBJECT_UNKNOWN
    )
    assert ask(answering, assess(LOW_PUSH, assembly=good)).error.code == ErrorCode.OK


MASSES = ((0.0, ErrorCode.OBJECT_INVALID), (-1.0, ErrorCode.OBJECT_INVALID), (math.nan, ErrorCode.NOT_FINITE))


def changed(item, change_object):
    """A message with one object, changed."""
    assembly = message(item)
    change_object(assembly.objects[1])
    return assembly


def mass(value):
    return changed(CUBE, lambda item: setattr(item.inertia, "m", value))


def test_what_does_not_stand_is_kept_and_said_with_its_margin(server, graph):
    ledge = box("ledge", (1, 1, 0.2), (0.7, 0, 1.1))
    answer = ask(graph, replace_by(message(CUBE, ledge)))
    assert (answer.stable, answer.error.code, list(answer.falling)) == (False, ErrorCode.UNSTABLE, ["ledge"])
    assert answer.margin < 0
    later = ask(graph, assess(LOW_PUSH))
    assert (later.stable, later.error.code, later.robustness[0].robustness) == (False, ErrorCode.UNSTABLE, 0.0)
    assert later.margin == answer.margin
    refused = ask(graph, replace_by(message(box("cube", (1, 1, 1), (0, 0, 0.4)))))
    assert refused.error.code == ErrorCode.INTERPENETRATION
    assert ask(graph, assess(LOW_PUSH)).error.code == ErrorCode.UNSTABLE


def test_a_scene_that_cannot_be_used_ends_the_node_with_its_reason(start_node, tmp_path):
    (tmp_path / "scene.yaml").write_text("objects: [{id: cube, box: [1, 1, 1], mass: 1}]")
    node = start_node("robustness_server", {"scene": str(tmp_path / "scene.yaml")})
    assert node.wait() == 2
    assert "none is fixed" in node.output


def test_two_hundred_objects_within_a_second_are_answered_with_what_is_certified(answering):
    asked = push("b5_3", (0.75, 0.05, 0.55), (0, -1, 0))
    answer = ask(answering, assess(asked, assembly=wall(10, 20), deadline=1.0, map_points=1000))
    assert answer.error.code in (ErrorCode.OK, ErrorCode.DEADLINE)
    if answer.robustness:
        (result,) = answer.robustness
        assert 0 <= result.lower <= result.upper
    # And the next call finds a server that works.
    assert ask(answering, assess(LOW_PUSH, assembly=message(CUBE))).robustness[0].robustness == pytest.approx(MU * G)


# -- many at once ---------------------------------------------------------------------------------------------------


def together(graph, requests):
    """All answers to calls made at once by one client."""
    client = graph.node.create_client(AssessRobustness, "assess_robustness", qos_profile=QoSProfile(depth=1000))
    graph.wait_for(client.service_is_ready, what="the service")
    futures = [client.call_async(request) for request in requests]
    graph.wait_for(lambda: all(future.done() for future in futures), what="all answers")
    return [future.result() for future in futures]


def test_a_hundred_calls_in_flight_are_all_answered(answering):
    heights = np.linspace(0.05, 0.95, 100)
    requests = [assess(push("cube", (-0.5, 0, z), (1, 0, 0)), assembly=message(CUBE)) for z in heights]
    expected = [min(MU * G, G * 0.5 / z) for z in heights]
    found = [answer.robustness[0].robustness for answer in together(answering, requests)]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_calls_beyond_the_queue_are_refused_as_busy_and_none_is_lost(start_node, graph):
    start_node("robustness_server", {"waiting": 5})
    answers = together(graph, [assess(assembly=message(CUBE, LID), map_points=2000) for _ in range(60)])
    codes = [ErrorCode(answer.error.code) for answer in answers]
    assert len(codes) == 60
    assert set(codes) == {ErrorCode.OK, ErrorCode.BUSY}
    assert all("later" in answer.error.message for answer in answers if answer.error.code == ErrorCode.BUSY)


def test_ctrl_c_in_the_midst_of_a_long_call_ends_the_node_at_once(server, graph):
    client = graph.node.create_client(PlanDisassembly, "plan_disassembly")
    graph.wait_for(client.service_is_ready, what="the service")
    client.call_async(PlanDisassembly.Request(assembly=[wall(10, 20)]))
    ask_later = graph.node.create_client(AssessRobustness, "assess_robustness")
    graph.wait_for(ask_later.service_is_ready, what="the other service")
    assert server.stop() == 0
    assert "Traceback" not in server.output


# -- messages -------------------------------------------------------------------------------------------------------


def test_an_assembly_survives_the_way_through_its_message():
    cube = Box((0.2, 0.2, 0.2)).polyhedron
    die = Mesh(cube.vertices, cube.triangles)
    upright, com = (0, 0, 0, 1), np.array([0, 0.01, 0])
    there = Assembly(
        (
            FLOOR,
            box("crate", (0.4, 0.4, 0.4), (0, 0, 0.2), 3.0),
            RigidObject("can", Cylinder(0.1, 0.2), Pose.from_vector([1, 0, 0.1, *upright]), mass=0.5, com=com),
            RigidObject("die", die, Pose.from_vector([0, 0, 0.5, *upright]), mass=0.2, covariance=np.eye(10)),
        ),
        friction_pairs=(FrictionPair(("floor", "can"), 0.3, 0.05),),
    )
    back = assembly_of(assembly_message(there, FRAME))
    assert [item.id for item in back.objects] == [item.id for item in there.objects]
    for before, after in zip(there.objects, back.objects, strict=True):
        np.testing.assert_allclose(after.vertices, before.vertices, atol=1e-12)
        np.testing.assert_allclose(after.com_in_world, before.com_in_world, atol=1e-12)
        assert (after.fixed, after.fixed or after.mass) == (before.fixed, before.fixed or before.mass)
    np.testing.assert_array_equal(back.objects[3].covariance, np.eye(10))
    assert back.friction_pairs == there.friction_pairs
    assert Analysis.of(back).stability().margin == pytest.approx(Analysis.of(there).stability().margin)
