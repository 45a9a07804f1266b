"""placement_planner in a real graph: its answers are the core's, and every goal that goes wrong has a code."""

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from action_caller import Caller
from action_msgs.msg import GoalStatus
from assembly_calls import CUBE, FLOOR, FRAME, LATCHED, box, message, wall
from geometry_msgs.msg import Point
from shape_msgs.msg import MeshTriangle

from poise.assembly import Analysis, Assembly, write_scene
from poise.errors import ErrorCode
from poise.geometry import Pose
from poise.nodes import placement_planner
from poise.nodes.assembly_message import assembly_message, assembly_of, mesh_message, object_of
from poise.placement import PLACEMENT_PLANNERS, Options, plan_placement
from poise_msgs.action import PlaceObject
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.msg import AssemblyObject, WorldObject

pytestmark = pytest.mark.ros
ENDLESS = {"candidates": 10_000, "attempts": 1_000_000}


def wanted(*size: float, **changes) -> AssemblyObject:
    """A box to place."""
    item = message(box("parcel", size or (0.2, 0.2, 0.2), (0, 0, 0))).objects[1]
    for name, value in changes.items():
        setattr(item, name, value)
    return item


@pytest.fixture
def caller(graph):
    caller = Caller(graph, PlaceObject, "place_object")
    yield caller
    caller.close()


def vector(stamped):
    place, turn = stamped.pose.position, stamped.pose.orientation
    return [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]


def test_the_answer_is_that_of_the_core_and_the_assembly_stays_as_it_was(start_node, graph, caller):
    assemblies = graph.collect("assembly", AssemblyMessage, LATCHED)
    start_node("placement_planner", {"candidates": 3, "support": "objects"})
    caller.ready()
    there, item = message(CUBE), wanted()
    goal = {"assembly": [there], "object": item, "seed": 5, "deadline": 50.0}
    done = caller.result(caller.send(**goal))
    assert (done.status, done.result.error.message) == (GoalStatus.STATUS_SUCCEEDED, "")
    core = plan_placement(assembly_of(there), object_of(item), Options(candidates=3, on="objects"), 5)
    assert vector(done.result.pose) == core.pose.vector.tolist()
    assert done.result.pose.header.frame_id == FRAME
    assert (done.result.robustness, done.result.iterations) == (core.score.least, core.iterations)
    stands = assembly_of(there).with_object(object_of(wanted(pose=done.result.pose.pose)))
    assert Analysis.of(stands).stability().margin > 0
    assert vector(caller.result(caller.send(**goal)).result.pose) == core.pose.vector.tolist()
    assert assemblies == []


@pytest.mark.parametrize("name", ["uniform"])
def test_the_planner_is_chosen_by_parameter(start_node, graph, caller, name):
    start_node("placement_planner", {"planner": name, "candidates": 1, "support": "objects"})
    caller.ready()
    done = caller.result(caller.send(assembly=[message(CUBE)], object=wanted(), seed=5, deadline=60.0))
    assert (done.status, done.result.error.message) == (GoalStatus.STATUS_SUCCEEDED, "")
    options = Options(candidates=1, on="objects")
    core = PLACEMENT_PLANNERS.find(name).plan(assembly_of(message(CUBE)), object_of(wanted()), options, 5, None)
    assert vector(done.result.pose) == core.pose.vector.tolist()
    assert done.result.iterations == core.iterations


def test_an_unknown_planner_ends_the_node_with_the_known_ones(start_node):
    node = start_node("placement_planner", {"planner": "best"})
    assert node.wait() == 2
    assert "sim-above" in node.output


def test_an_assembly_on_the_topic_is_built_upon(start_node, graph, caller, tmp_path):
    write_scene(Assembly((FLOOR, CUBE)), tmp_path / "scene.yaml")
    start_node("placement_planner", {"scene": str(tmp_path / "scene.yaml"), "frame_id": "hall", "support": "objects"})
    caller.ready()
    first = caller.result(caller.send(object=wanted())).result
    assert (first.error.code, first.pose.header.frame_id) == (ErrorCode.OK, "hall")
    assert first.pose.pose.position.z == pytest.approx(1.1)
    publisher = graph.node.create_publisher(AssemblyMessage, "assembly", LATCHED)
    publisher.publish(message(box("shelf", (1, 1, 0.1), (5, 0, 0.05))))

    def heard():
        result = caller.result(caller.send(object=wanted())).result
        return result.pose.header.frame_id == FRAME and result

    result = graph.wait_for(heard, what="the assembly to be heard")
    assert abs(result.pose.pose.position.x - 5) < 0.6


def test_feedback_tells_the_best_so_far_and_a_second_goal_is_busy_until_the_first_is_cancelled(
    start_node, graph, caller
):
    start_node("placement_planner", ENDLESS)
    caller.ready()
    goal = {"assembly": [message(CUBE)], "object": wanted(), "deadline": 600.0}
    first = caller.send(**goal)
    graph.wait_for(lambda: len(caller.feedback) > 3 and caller.feedback[-1].best_robustness > 0, what="a placement")
    second = caller.result(caller.send(**goal))
    assert (second.status, second.result.error.code) == (GoalStatus.STATUS_ABORTED, ErrorCode.BUSY)
    caller.cancel(first)
    done = caller.result(first)
    assert (done.status, done.result.error.code) == (GoalStatus.STATUS_CANCELED, ErrorCode.CANCELLED)
    reported = [one.iteration for one in caller.feedback]
    assert reported == sorted(reported)
    best = [one.best_robustness for one in caller.feedback if not math.isnan(one.best_robustness)]
    assert best == sorted(best)
    assert {one.stage for one in caller.feedback} == {"planning"}
    third = caller.result(caller.send(**goal | {"deadline": 0.5})).result.error.code
    assert third in (ErrorCode.OK, ErrorCode.DEADLINE)


def test_cancelling_is_answered_also_while_the_assembly_is_read(start_node, graph, caller):
    """The analysis of two hundred bricks takes seconds in which nothing can be asked of it."""
    start_node("placement_planner", ENDLESS)
    caller.ready()
    for _ in range(3):
        handle = caller.send(assembly=[wall(10, 20)], object=wanted(), deadline=600.0)
        caller.cancel(handle)
        done = caller.result(handle)
        assert (done.status, done.result.error.code) == (GoalStatus.STATUS_CANCELED, ErrorCode.CANCELLED)
        assert done.result.iterations == 0


def test_a_deadline_gives_the_best_by_then_or_says_that_there_was_no_time(start_node, graph, caller):
    start_node("placement_planner", ENDLESS)
    caller.ready()
    result = caller.result(caller.send(assembly=[message(CUBE)], object=wanted(), deadline=5.0)).result
    assert result.error.code in (ErrorCode.OK, ErrorCode.DEADLINE)
    assert result.pose.header.frame_id == FRAME
    result = caller.result(caller.send(assembly=[message(CUBE)], object=wanted(), deadline=1e-6)).result
    assert (result.error.code, result.iterations) == (ErrorCode.DEADLINE, 0)
    assert math.isnan(result.robustness)


def test_no_place_says_which_test_turned_away_how_many(start_node, graph, caller):
    """A centre of mass far outside, and a cube thirty times as wide as all there is to stand on."""
    start_node("placement_planner", {"attempts": 30, "robust": True})
    caller.ready()
    pedestal = assembly_message(Assembly((box("pedestal", (0.1, 0.1, 0.5), (0, 0, 0.25), fixed=True),)), FRAME)
    odd = wanted()
    odd.com_given = True
    odd.inertia.com.x, odd.inertia.com.y, odd.inertia.com.z = 0.25, 0.26, 0.27
    for item in (odd, wanted(3.0, 3.0, 3.0)):
        done = caller.result(caller.send(assembly=[pedestal], object=item, deadline=50.0))
        assert done.result.error.code == ErrorCode.NO_PLACEMENT, done.result.error.message
        (reasons,) = re.findall(r"\((.*)\)", done.result.error.message)
        assert sum(map(int, re.findall(r"\d+", reasons))) == done.result.iterations == 30


def meshed(triangles: int, flat: bool = False) -> AssemblyObject:
    """The parcel as a mesh of its first triangles, or pressed flat."""
    cube = message(box("parcel", (0.2, 0.2, 0.2), (0, 0, 0)))
    shape = assembly_of(cube).objects[1].shape.polyhedron
    item = wanted(shape=AssemblyObject.SHAPE_MESH)
    vertices = shape.vertices * ([1, 1, 0] if flat else [1, 1, 1])
    item.mesh.vertices = [Point(x=x, y=y, z=z) for x, y, z in vertices.tolist()]
    item.mesh.triangles = [MeshTriangle(vertex_indices=t) for t in shape.triangles[:triangles].astype(np.uint32)]
    return item


def test_every_bad_goal_has_its_code_and_a_sentence(start_node, graph, caller):
    start_node("placement_planner")
    caller.ready()
    good, nothing = message(CUBE), wanted()
    nothing.inertia.m = 0.0
    heavy, crowded = wanted(), message(CUBE)
    heavy.inertia.m, crowded.friction = 1e300, math.nan
    leaning = message(CUBE, box("brick", (1, 0.2, 0.2), (0.6, 0, 1.1)))
    cases = [
        ({}, ErrorCode.EMPTY, "assembly"),
        ({"assembly": [leaning]}, ErrorCode.UNSTABLE, "brick"),
        ({"assembly": [message(box("cube", (1, 1, 1), (0, 0, 0.4)))]}, ErrorCode.INTERPENETRATION, "cube"),
        ({"assembly": [message(box("cube", (1, 1, 1), (0, 0, 3)))]}, ErrorCode.FLOATING, "cube"),
        ({"assembly": [good], "object": wanted(id="cube")}, ErrorCode.BAD_INPUT, "cube"),
        ({"assembly": [good], "object": wanted(fixed=True)}, ErrorCode.BAD_INPUT, "parcel"),
        ({"assembly": [good], "object": AssemblyObject()}, ErrorCode.OBJECT_INVALID, ""),
        ({"assembly": [good], "object": nothing}, ErrorCode.OBJECT_INVALID, "mass"),
        ({"assembly": [good], "object": heavy}, ErrorCode.OBJECT_INVALID, "mass"),
        ({"assembly": [crowded]}, ErrorCode.NOT_FINITE, "friction"),
        ({"assembly": [good], "object": meshed(5)}, ErrorCode.MESH_INVALID, "parcel"),
        ({"assembly": [good], "object": meshed(12, flat=True)}, ErrorCode.MESH_INVALID, "parcel"),
        ({"assembly": [good], "deadline": -1.0}, ErrorCode.BAD_INPUT, "deadline"),
        ({"assembly": [good], "deadline": math.nan}, ErrorCode.BAD_INPUT, "deadline"),
        ({"assembly": [good], "execute": True}, ErrorCode.ROBOT_DESCRIPTION_MISSING, "execute"),
    ]
    for fields, code, word in cases:
        done = caller.result(caller.send(**{"object": wanted()} | fields))
        assert (done.status, ErrorCode(done.result.error.code)) == (GoalStatus.STATUS_ABORTED, code), fields
        assert word in done.result.error.message
        assert done.result.pose.header.frame_id == ""
    assert caller.result(caller.send(assembly=[good], object=wanted())).result.error.code == ErrorCode.OK


def test_a_mesh_in_a_message_is_mended_and_what_was_done_is_said(start_node, graph, caller):
    """A cube with one of its twelve triangles twice, sent as part of the assembly."""
    node = start_node("placement_planner", {"support": "objects"})
    caller.ready()
    there = message(CUBE)
    cube = assembly_of(there).objects[1].shape.polyhedron
    there.objects[1].shape = AssemblyObject.SHAPE_MESH
    there.objects[1].mesh = mesh_message(cube)
    there.objects[1].mesh.triangles.append(there.objects[1].mesh.triangles[0])
    done = caller.result(caller.send(assembly=[there], object=wanted(), deadline=50.0))
    assert done.result.error.message == ""
    assert "object cube: " in node.output
    pose = Pose.from_vector(vector(done.result.pose))
    assert pose.translation[2] == pytest.approx(1.1)


def test_ctrl_c_in_the_midst_of_a_plan_ends_the_node(start_node, graph, caller):
    node = start_node("placement_planner", ENDLESS)
    caller.ready()
    caller.send(assembly=[wall(5, 10)], object=wanted(), deadline=600.0)
    graph.wait_for(lambda: caller.feedback, what="the plan to begin")
    assert node.stop() == 0
    assert "Traceback" not in node.output


def test_the_arm_is_stopped_before_the_end_of_the_thread_is_awaited(monkeypatch):
    closed = []
    planner = placement_planner.PlacementPlannerNode
    monkeypatch.setattr(placement_planner.ArmNode, "destroy_node", lambda _: closed.append("node"))
    node = planner.__new__(planner)
    node._task = None
    for name in ("_jobs", "watchdog"):
        setattr(node, name, SimpleNamespace(close=lambda name=name: closed.append(name)))
    node.destroy_node()
    assert closed == ["watchdog", "_jobs", "node"]


def test_what_a_goal_does_to_its_object_leaves_what_the_hand_holds_as_it_is():
    held = WorldObject(frame_id="tcp", object=AssemblyObject(id="can"))
    held.object.pose.position.z = 0.05
    goal = SimpleNamespace(request=PlaceObject.Goal(held=True))
    node = SimpleNamespace(
        _hand=SimpleNamespace(require_held=lambda _: held, tool_frame="tcp"),
        _execution=SimpleNamespace(pose=lambda *_: Pose.identity()),
    )
    assert placement_planner.PlacementPlannerNode._in_hand(node, goal).translation[2] == 0.05
    goal.request.object.pose.position.z = 0.0  # as for a goal that is only planned
    assert placement_planner.PlacementPlannerNode._in_hand(node, goal).translation[2] == 0.05
