"""examples/nav2_limits.py and examples/stack_tree.py: against fakes of nav2's smoother, and the real server."""

import importlib.util
import itertools
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Point, Vector3
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.node import Node
from rclpy.parameter import Parameter

from poise.nodes.runtime import LATCHED
from poise_msgs.msg import AccelerationLimits, Push

pytestmark = pytest.mark.ros
EXAMPLES = Path(__file__).parents[2] / "examples"
SCENE = Path(__file__).parents[2] / "docs" / "scenes" / "tray.yaml"


def example(name: str) -> ModuleType:
    specification = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


NAV2, TREE = example("nav2_limits"), example("stack_tree")
BASE = NAV2.Smoother((2.5, 1.0, 3.2), (-2.0, -1.0, -3.2), (0.5, 0.2, 2.0), (-0.3, -0.2, -2.0))


def limits_of(offsets: Any, angles: Any, angular: float = 4.0, speed: float = 3.0) -> AccelerationLimits:
    normals = [Vector3(x=float(np.cos(angle)), y=float(np.sin(angle)), z=0.3) for angle in angles]
    return AccelerationLimits(normals=normals, offsets=list(offsets), angular_acceleration=angular, angular_speed=speed)


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.floats(0.01, 20.0), st.floats(0.0, 6.3)), min_size=1, max_size=8),
    st.floats(0.01, 10.0),
    st.floats(0.01, 10.0),
)
def test_the_base_never_asks_the_load_for_more_than_it_sustains(
    facets: list[tuple[float, float]], angular: float, speed: float
) -> None:
    limits = limits_of(*zip(*facets, strict=True), angular, speed)
    base = NAV2.within(limits, BASE, 0.8)
    accelerations = [sorted((-abs(low), high)) for low, high in zip(base.max_decel, base.max_accel, strict=True)]
    fastest = np.hypot(*np.max(np.abs([base.max_velocity[:2], base.min_velocity[:2]]), axis=0)) * base.max_velocity[2]
    others = base.max_accel[2] / angular + (base.max_velocity[2] / speed) ** 2
    for ax, ay, heading in itertools.product(*accelerations[:2], np.linspace(0, 2 * np.pi, 12)):
        a = np.array([ax, ay]) + fastest * np.array([np.cos(heading), np.sin(heading)])
        for normal, offset in zip(limits.normals, limits.offsets, strict=True):
            assert (normal.x * a[0] + normal.y * a[1]) / offset + others <= 0.8 + 1e-9


@pytest.mark.parametrize(
    "change",
    [{"offsets": [0.0]}, {"offsets": [float("nan")]}, {"offsets": [], "normals": []}, {"angular_speed": float("nan")}],
)
def test_a_load_that_sustains_nothing_or_is_unknown_stands(change: dict[str, Any]) -> None:
    limits = limits_of([1.0], [0.0])
    for name, value in change.items():
        setattr(limits, name, value)
    assert NAV2.within(limits, BASE, 0.8) is None


def test_the_smoother_follows_the_limits_and_stops_the_base_without_them(graph) -> None:
    smoother = Node("velocity_smoother", context=graph.node.context)
    for name in NAV2.NAMES:
        smoother.declare_parameter(name, list(getattr(BASE, name)))
    node = NAV2.Nav2Limits(context=graph.node.context)
    graph.add(smoother)
    graph.add(node)

    def velocity() -> list[float]:
        return list(smoother.get_parameter("max_velocity").value)

    graph.wait_for(lambda: velocity() == [0.0] * 3, what="a base that stands while nothing is known")
    publisher = graph.node.create_publisher(AccelerationLimits, "acceleration_limits", LATCHED)
    publisher.publish(limits_of([1.0] * 8, np.arange(8) * np.pi / 4))
    graph.wait_for(lambda: velocity()[0] > 0.0, what="a base that may move")
    assert 0 < smoother.get_parameter("max_accel").value[0] < BASE.max_accel[0]
    smoother.set_parameters([Parameter("max_velocity", value=list(BASE.max_velocity))])  # it was started again
    graph.wait_for(lambda: velocity() != list(BASE.max_velocity), what="the limits of a smoother that lost them")
    graph.node.destroy_publisher(publisher)
    graph.wait_for(lambda: velocity() == [0.0] * 3, what="a base that stands when acceleration_limits has ended")
    node.destroy_node()
    smoother.destroy_node()


def test_a_tree_asks_without_blocking_and_the_certified_bound_decides(graph, start_node) -> None:
    def push(object_id: str) -> Push:
        return Push(object=object_id, point=Point(x=-0.27, y=-0.12, z=0.26), direction=Vector3(x=1.0))

    def ended(leaf: Any) -> Any:
        tree = TREE.InTurn([leaf])
        seen: list[Any] = []

        def tick() -> bool:
            seen.append(tree.tick())
            return seen[-1] is not TREE.Status.RUNNING

        graph.wait_for(tick, what="the end of the tree")
        assert len(seen) > 1
        return seen[-1]

    late = TREE.StackHolds(graph.node, push("parcel"), 0.5, deadline=0.1)
    assert ended(late) is TREE.Status.FAILURE
    assert "did not answer" in late.why
    start_node("robustness_server", {"scene": str(SCENE)})
    gentle, hard, unknown = (
        TREE.StackHolds(graph.node, push(name), force, deadline=20.0)
        for name, force in (("parcel", 0.5), ("parcel", 500.0), ("nothing", 0.5))
    )
    assert ended(gentle) is TREE.Status.SUCCESS, gentle.why
    assert ended(hard) is TREE.Status.FAILURE
    assert "may move" in hard.why
    assert ended(unknown) is TREE.Status.FAILURE
    assert "nothing" in unknown.why
