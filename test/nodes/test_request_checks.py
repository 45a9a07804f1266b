"""Every number of a request has its range, and an answer that contradicts itself is withheld."""

import math
from pathlib import Path

import numpy as np
import pytest
from assembly_calls import CUBE, LID, LOW_PUSH, assess, box, message, push, replace_by
from geometry_msgs.msg import Point

from poise.assembly import Analysis, robustness_map
from poise.assembly import assess as assess_in_core
from poise.errors import ErrorCode, InputError, PoiseError
from poise.nodes.answer_checks import check_answer
from poise.nodes.assembly_message import assembly_of, pushes_of, robustness_message
from poise.nodes.map_message import map_message
from poise.nodes.request_checks import CallLimits, check_request
from poise.nodes.robustness_calls import call_of
from poise.ranges import RANGES, check_covariance
from poise.robot import FrameTree
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.srv import AssessRobustness, SetAssembly

LIMITS = CallLimits(objects=100, pushes=1000, map_points=1000, triangles=100, bytes=100_000)
BAD, INVALID, NOT_FINITE = ErrorCode.BAD_INPUT, ErrorCode.OBJECT_INVALID, ErrorCode.NOT_FINITE


def refused(request, code, word=None):
    with pytest.raises(InputError, match=word) as raised:
        check_request(request, LIMITS)
    assert raised.value.code == code, raised.value.message


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -1.0, 1e-9, 100.0])
def test_map_tolerance_has_a_range(value):
    refused(assess(map_points=10, map_tolerance=value), BAD, "map_tolerance")


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0])
@pytest.mark.parametrize("request_", [assess(), replace_by(message(CUBE))])
def test_deadlines_have_a_range(request_, value):
    request_.deadline = value
    refused(request_, BAD, "deadline")
    request_.deadline = 0.0
    check_request(request_, LIMITS)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ("inertia.m = 1e300", INVALID),
        ("inertia.m = 0.0", INVALID),
        ("inertia.m = float('nan')", NOT_FINITE),
        ("primitive.dimensions = [1e9, 1.0, 1.0]", INVALID),
        ("primitive.dimensions = [float('nan'), 1.0, 1.0]", NOT_FINITE),
        ("pose.position.x = 1e200", BAD),
        ("pose.orientation.w = float('inf')", NOT_FINITE),
        ("id = ''", INVALID),
        ("covariance = [-1.0] + 99 * [0.0]", BAD),
        ("covariance = 3 * [0.0]", BAD),
        ("covariance = [float('nan')] * 100", NOT_FINITE),
    ],
)
def test_objects_have_ranges(change, code):
    there = message(CUBE)
    exec(f"item.{change}", {"item": there.objects[1]})  # noqa: S102  # of the list above
    refused(assess(assembly=there), code)
    refused(replace_by(there), code)


@pytest.mark.parametrize("friction", [-0.1, -2.0, 11.0, math.nan, math.inf])
def test_friction_has_a_range_and_minus_one_is_not_given(friction):
    there = message(CUBE)
    there.friction = friction
    refused(assess(assembly=there), BAD if math.isfinite(friction) else NOT_FINITE, "friction")
    there.friction = -1.0
    check_request(assess(assembly=there), LIMITS)


@pytest.mark.parametrize("z", [0.0, 1e-3, 1e6, math.nan])
def test_gravity_has_a_range(z):
    there = message(CUBE)
    there.gravity.z = z
    refused(assess(assembly=there), BAD if math.isfinite(z) else NOT_FINITE, "gravity")


def test_pushes_have_ranges():
    for direction in ((1e155, 0, 0), (0, 0, 0), (1e-9, 0, 0)):
        with pytest.raises(InputError, match="direction"):
            check_request(assess(push("cube", (0, 0, 0), direction)), LIMITS)
    refused(assess(push("cube", (1e155, 0, 0), (1, 0, 0))), BAD, "point")
    refused(assess(push("cube", (0, math.nan, 0), (1, 0, 0))), NOT_FINITE, "point")


def test_one_call_is_bounded():
    refused(assess(*[LOW_PUSH] * 1001), BAD, "pushes")
    refused(assess(map_points=4_000_000_000), BAD, "map_points")
    refused(assess(assembly=message(*(box(f"b{i}", (1, 1, 1), (2 * i, 0, 0.5)) for i in range(100)))), BAD, "objects")
    spread = message(CUBE)
    spread.objects[1].mesh.vertices = [Point(x=math.nan)] * 301
    refused(assess(assembly=spread), BAD, "mesh vertices")
    # What is too large is refused before its numbers are looked at.
    wrong = push("cube", (math.nan, 0, 0), (1, 0, 0))
    refused(assess(*[wrong] * 1001, assembly=spread), BAD, "pushes")
    with pytest.raises(InputError, match="bytes"):
        call_of("assess", assess(*[wrong] * 1000), FrameTree(), "world", LIMITS._replace(bytes=1000), 30.0)
    with pytest.raises(InputError, match="bytes"):
        call_of("assess", assess(*[LOW_PUSH] * 1000), FrameTree(), "world", LIMITS._replace(bytes=1000), 30.0)


def test_a_covariance_of_a_weighing_passes_and_one_that_no_errors_have_does_not():
    rng = np.random.default_rng(0)
    units = np.diag([1e-3, *[1e-4] * 3, *[1e-6] * 6])
    factor = units @ rng.normal(size=(10, 10))
    check_covariance((factor @ factor.T).ravel())
    check_covariance((factor[:, :3] @ factor[:, :3].T).ravel())  # of rank 3
    skewed = factor @ factor.T
    skewed[0, 1] *= 3
    too_correlated = np.diag(np.diag(factor @ factor.T))
    too_correlated[0, 1] = too_correlated[1, 0] = 2 * math.sqrt(too_correlated[0, 0] * too_correlated[1, 1])
    for wrong in (skewed, too_correlated):
        with pytest.raises(InputError, match="positive semi-definite"):
            check_covariance(wrong.ravel())


def test_each_default_of_a_call_is_stated():
    request = assess(assembly=message(CUBE), map_points=10, deadline=100.0)
    notes = call_of("assess", request, FrameTree(), "world", LIMITS, 30.0).notes
    assert [note.split()[0] for note in notes] == ["model", "map_tolerance", "deadline"]
    request = SetAssembly.Request(assembly=message(CUBE), deadline=1.0)
    assert call_of("set", request, FrameTree(), "world", LIMITS, 30.0).notes == ()
    request.assembly.header.frame_id = ""
    assert "taken as world" in call_of("set", request, FrameTree(), "world", LIMITS, 30.0).notes[0]


def test_an_old_transform_is_stated():
    frames, second = FrameTree(one_parent=False, keep=False), 10**9
    for stamp, parent, child in ((5, "odom", "world"), (90, "base", "camera"), (99, "world", "base")):
        frames.add([stamp * second], parent, child, np.eye(3)[None], np.zeros((1, 3)))
    frames.add([0], "camera", "optical", np.eye(3)[None], np.zeros((1, 3)), fixed=True)
    request = assess(LOW_PUSH, frame_id="optical", deadline=1.0, model="default")
    for now, notes in ((90, ()), (100, ("the transform of optical is the newest one, 10.0 s old",))):
        found = call_of("assess", request, frames, "world", LIMITS, 30.0, now * second)
        assert found.notes == notes


def test_heavy_calls_are_recognised():
    def heavy(request, kind="assess"):
        return call_of(kind, request, FrameTree(), "world", LIMITS, 30.0).heavy

    assert not heavy(assess(LOW_PUSH))
    assert not heavy(assess(LOW_PUSH, assembly=message(CUBE)))
    assert heavy(assess(map_points=1))
    assert heavy(assess(*[LOW_PUSH] * 101))
    assert heavy(replace_by(message(*(box(f"b{i}", (1, 1, 1), (2 * i, 0, 0.5)) for i in range(60)))), "set")


def test_an_answer_that_contradicts_itself_is_withheld():
    analysis = Analysis.of(assembly_of(message(CUBE, LID)))
    found = assess_in_core(analysis, pushes_of([LOW_PUSH], []))
    mapped = robustness_map(analysis, 20)
    response = AssessRobustness.Response(robustness=[robustness_message(result) for result in found.results])
    response.map = [map_message(mapped, AssemblyMessage().header)]
    check_answer(response)
    for name, value in (("lower", math.nan), ("lower", 1e9), ("lower", -1.0), ("upper", math.nan)):
        result = robustness_message(found.results[0])
        setattr(result, name, value)
        with pytest.raises(PoiseError) as raised:
            check_answer(AssessRobustness.Response(robustness=[result]))
        assert raised.value.code == ErrorCode.INTERNAL
    for bound, value in ((mapped.lower, np.inf), (mapped.upper, np.nan)):
        before = bound[3]
        bound[3] = value
        with pytest.raises(PoiseError, match="map"):
            check_answer(AssessRobustness.Response(map=[map_message(mapped, AssemblyMessage().header)]))
        bound[3] = before
    with pytest.raises(PoiseError, match="margin"):
        check_answer(SetAssembly.Response(margin=math.nan))


def test_the_page_shows_the_table_of_ranges():
    page = (Path(__file__).parents[2] / "docs" / "robustness_server.md").read_text(encoding="utf-8")
    for name, (least, greatest, unit, code, _) in RANGES.items():
        assert f"| {name} | {least:g} | {greatest:g}{' ' + unit if unit else ''} | `{code.name}` |" in page
