"""Rims of cylinders that lean on round sides, on rims and on edges: contacts beside coal, and a can that leans."""

from dataclasses import replace

import coal
import numpy as np
import pytest
from scipy.optimize import brentq, linprog

from poise.assembly import Analysis, Assembly, Box, Cylinder, RigidObject
from poise.assembly.contact.contacts import find_interfaces
from poise.assembly.contact.penetration import convex_geometry
from poise.geometry import Pose, rotation_about, rotation_of_quaternion, unit
from poise.types import Array

GRAVITY = np.array([0.0, 0.0, -9.81])


def apart(first: RigidObject, second: RigidObject) -> tuple[float, Array, Array]:
    """m between two convex bodies, and the points (3,) that are nearest to each other."""
    shapes = [convex_geometry(item.shape) for item in (first, second)]  # type: ignore[arg-type]
    places = [coal.Transform3s(item.pose.rotation, item.pose.translation) for item in (first, second)]
    result = coal.DistanceResult()
    far = coal.distance(shapes[0], places[0], shapes[1], places[1], coal.DistanceRequest(), result)
    return far, np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())


def touching_pairs(kind: str, count: int, gap: float) -> list[tuple[RigidObject, RigidObject]]:
    """A fixed cylinder, and a cylinder or box that comes near it from a random side, turned at random."""
    rng = np.random.default_rng(7)
    pairs = []
    while len(pairs) < count:
        sizes = rng.uniform(0.04, 0.15, (2, 3)).tolist()
        shape = Cylinder(sizes[1][0] / 2, sizes[1][1]) if kind == "cylinder" else Box(tuple(sizes[1]))
        turns = [rotation_of_quaternion(unit(rng.normal(size=4))) for _ in range(2)]
        first = RigidObject("first", Cylinder(sizes[0][0] / 2, sizes[0][1]), Pose(turns[0], np.zeros(3)), fixed=True)
        way, place = unit(rng.normal(size=3)), 0.02 * rng.normal(size=3)
        place = place + 0.5 * way
        for _ in range(60):
            second = RigidObject("second", shape, Pose(turns[1], place), mass=1.0)
            far = apart(first, second)[0]
            if far <= 1.01 * gap:
                break
            place = place - (far - gap) * way
        if gap <= far <= 1.01 * gap:
            pairs.append((first, second))
    return pairs


@pytest.mark.parametrize("kind", ["cylinder", "box"])
def test_bodies_touch_where_they_are_nearest_to_each_other(kind: str) -> None:
    for first, second in touching_pairs(kind, 60, gap=1e-5):
        far, one, other = apart(first, second)
        found = find_interfaces(Assembly((first, second), GRAVITY, 0.5), margin=3e-4)
        assert found, (first.pose, second.pose)
        best = max(found, key=lambda interface: interface.normal @ (other - one))
        assert best.normal @ (other - one) == pytest.approx(far, rel=2e-3)  # sin of 3.6 degrees off is 2e-3
        assert np.linalg.norm(best.points - one, axis=1).min() < 3e-3


def leaning_can(friction: float) -> Assembly:
    """A can that leans with its upper rim on the side of a fixed cylinder, where that is vertical."""
    radius, length, lean = 0.03, 0.2, np.radians(45)
    turn = rotation_about(np.array([0.0, 1.0, 0.0]), lean)
    low = turn @ [radius, 0, -length / 2]
    high = turn @ [radius, 0, length / 2] - low
    can = RigidObject("can", Cylinder(radius, length), Pose(turn, -low), mass=1.0)
    lying = Pose(rotation_about(np.array([1.0, 0.0, 0.0]), np.pi / 2), high + np.array([0.05, 0, 0]))
    rail = RigidObject("rail", Cylinder(0.05, 0.3), lying, fixed=True)
    floor = RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -0.05])), fixed=True)
    return Assembly((floor, rail, can), GRAVITY, friction)


def least_friction(can: Array, high: Array) -> float:
    """With which a body leans on a vertical wall: in the plane, forces at its foot, the origin, and at `high` (3,)."""

    def spare(friction: float) -> float:
        """The largest t with forces in cones of this friction less t."""
        balance = [[1, 0, -1, 0, 0], [0, 1, 0, 1, 0], [0, 0, high[2], high[0], 0]]
        cones = [[s, -friction, 0, 0, 1] for s in (1, -1)] + [[0, 0, -friction, s, 1] for s in (1, -1)]
        weight = [0, 9.81, 9.81 * can[0]]
        found = linprog([0, 0, 0, 0, -1], cones, np.zeros(4), balance, weight, bounds=[(None, None)] * 5)
        return float(found.x[4])

    return float(brentq(spare, 0.01, 0.7))


def test_a_can_leans_with_its_rim_on_a_rail_from_the_least_friction_on() -> None:
    _, rail, can = leaning_can(0.5).objects
    least = least_friction(can.com_in_world, rail.pose.translation - [0.05, 0, 0])
    assert 0.1 < least < 0.6
    assert not Analysis.of(leaning_can(0.98 * least)).stability().stable
    assert Analysis.of(leaning_can(1.02 * least)).stability().stable


def lying(name: str, radius: float, place: tuple[float, float, float], degrees: float, **more: object) -> RigidObject:
    """A cylinder of 0.3 m along y, turned about z."""
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), np.radians(degrees))
    turn = turn @ rotation_about(np.array([1.0, 0.0, 0.0]), np.pi / 2)
    return RigidObject(name, Cylinder(radius, 0.3), Pose(turn, np.array(place)), mass=1.0, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("degrees", [0.03, 0.08, 0.3, 0.9])
def test_sides_that_are_nearly_parallel_touch_where_they_come_nearest(degrees: float) -> None:
    """Their axes would cross beyond the end of one: they touch at that end, as far as pressing closes the gap."""
    half, turn = 0.15, np.radians(degrees)
    first = lying("first", 0.04, (0.0, 0.0, 0.0), 0.0)
    # The second comes nearer towards +y; its axis passes the end of the first at the sum of radii.
    second = lying("second", 0.05, (0.09 + half * np.sin(turn), 0.0, 0.0), degrees)
    found = find_interfaces(Assembly((first, second, _floor()), GRAVITY, 0.5), margin=3e-4)
    (touch,) = [each for each in found if {each.first, each.second} == {0, 1}]
    far, _one, _ = apart(first, second)
    assert touch.gap == pytest.approx(far, abs=2e-5)
    ends = touch.points[:, 1]
    assert ends.max() == pytest.approx(half, abs=1e-4)
    assert np.ptp(ends) == pytest.approx(min(1e-5 / np.sin(turn), 2 * half), rel=0.1)


def _floor() -> RigidObject:
    return RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -1.0])), fixed=True)


@pytest.mark.parametrize("overlap", [2e-6, 2e-5, 2e-4])
def test_a_rim_that_presses_into_a_side_touches_at_its_deepest_point(overlap: float) -> None:
    """Where the surfaces cut each other is beside that, as far as the square root of the overlap."""
    free, pressed = (
        max(find_interfaces(_on_rail(depth)), key=lambda each: abs(each.normal[0])) for depth in (-1e-6, overlap)
    )
    assert np.degrees(np.arccos(min(1.0, abs(free.normal @ pressed.normal)))) < 0.1
    assert np.linalg.norm(free.points.mean(axis=0) - pressed.points.mean(axis=0)) < 1e-4 + 2 * overlap
    assert pressed.gap == pytest.approx(-overlap, rel=0.05)


def _on_rail(overlap: float) -> Assembly:
    """The leaning can, pressed into the rail."""
    found = leaning_can(0.5)
    floor, rail, can = found.objects
    rail = replace(rail, pose=Pose(rail.pose.rotation, rail.pose.translation - [overlap, 0, 0]))
    return replace(found, objects=(floor, rail, can))
