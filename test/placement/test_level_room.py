"""Room on level surfaces, and cylinders between chocks, against closed forms and the planner without them."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import shapely

from poise.assembly import Analysis, Assembly, Box, Cylinder, Mesh, RigidObject
from poise.errors import NoAnswerError
from poise.geometry import Pose, rotation_about
from poise.placement import KeptFree, Options, Validator, cause_of, plan_placement
from poise.placement.chocks import Chocks
from poise.placement.outlines import meeting_region, parts_between

UP = np.array([0.0, 0.0, 1.0])


def body(
    name: str, size: tuple[float, float, float], low: tuple[float, float, float], fixed: bool = True
) -> RigidObject:
    pose = Pose(np.eye(3), np.array(low) + np.array(size) / 2)
    return RigidObject(name, Box(size), pose, mass=0.0 if fixed else 0.3, fixed=fixed)


def turned(assembly: Assembly, angle: float) -> Assembly:
    turn = rotation_about(UP, angle)
    pose = [Pose(turn @ b.pose.rotation, turn @ b.pose.translation) for b in assembly.objects]
    return replace(assembly, objects=tuple(replace(b, pose=p) for b, p in zip(assembly.objects, pose, strict=True)))


def compartments(free: float, angle: float) -> Assembly:
    """A drawer turned by an angle; three compartments are full, and one is `free` wide."""
    bodies, x = [body("bottom", (0.295 + free, 0.11, 0.01), (0, -0.005, -0.01))], 0.0
    for k, wide in enumerate((0.09, 0.07, free, 0.11)):
        bodies.append(body(f"wall_{k}", (0.005, 0.1, 0.06), (x, 0, 0)))
        if k != 2:
            bodies.append(body(f"load_{k}", (wide - 0.01, 0.09, 0.05), (x + 0.01, 0.005, 0), fixed=False))
        x += 0.005 + wide
    bodies.append(body("wall_4", (0.005, 0.1, 0.06), (x, 0, 0)))
    bodies += [body("front", (x, 0.005, 0.06), (0, -0.005, 0)), body("back", (x, 0.005, 0.06), (0, 0.1, 0))]
    return turned(Assembly(tuple(bodies), friction=0.5), angle)


ITEM = RigidObject("item", Box((0.08, 0.09, 0.04)), Pose(np.eye(3), np.zeros(3)), mass=0.2)
RIM = (("over the rim", KeptFree(np.array([-9.0, -9.0, 0.06]), np.array([9.0, 9.0, 9.0]))),)


@pytest.mark.parametrize("angle", [0.4, 2.0, -1.1])
def test_an_object_is_put_into_the_only_compartment_of_a_drawer_turned_by_any_angle(angle: float) -> None:
    scene = compartments(0.087, angle)
    found = plan_placement(scene, ITEM, Options(on="fixed", looks=RIM, attempts=60), 1)
    middle = rotation_about(UP, -angle) @ found.pose.translation
    assert 0.17 + 0.04 < middle[0] < 0.17 + 0.047 + 0.005
    assert found.analysis.stability().stable


def test_a_compartment_that_is_too_narrow_is_refused_for_want_of_room() -> None:
    small = replace(ITEM, shape=Box((0.055, 0.056, 0.055)))
    with pytest.raises(NoAnswerError) as refusal:
        plan_placement(compartments(0.05, 0.4), small, Options(on="fixed", looks=RIM, attempts=100), 1)
    assert refusal.value.data["cause"] == "no_room"


def test_two_outlines_meet_where_their_minkowski_sum_says() -> None:
    rng = np.random.default_rng(3)
    fixed, moving = (
        np.array(shapely.MultiPoint(rng.normal(size=(9, 2))).convex_hull.exterior.coords)[:-1][::-1] for _ in range(2)
    )
    region = shapely.Polygon(meeting_region(fixed, moving))
    all_pairs = shapely.MultiPoint((fixed[:, None] - moving).reshape(-1, 2)).convex_hull
    assert region.symmetric_difference(all_pairs).area == pytest.approx(0, abs=1e-12)


def test_a_slice_of_a_cone_is_as_wide_as_at_its_lower_end() -> None:
    peak = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0, 0, 2.0]])
    sides = [(0, 2, 1), (0, 3, 2), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]
    (outline,) = parts_between(Mesh(peak, np.array(sides)).polyhedron, peak, 0.5, 1.0)
    assert shapely.Polygon(outline).area == pytest.approx((2 * 0.75) ** 2)


def test_a_plate_stands_on_two_rails_between_tines() -> None:
    """A disc of radius r over a gap g sinks to a height of sqrt(r^2 - g^2/4) over the rails."""
    rails = [body(f"rail_{k}", (0.3, 0.01, 0.02), (0, y, 0)) for k, y in enumerate((-0.05, 0.04))]
    tines = [
        body(f"tine_{k}_{j}", (0.005, 0.01, 0.08), (0.03 * k, y, 0.02))
        for k in range(10)
        for j, y in enumerate((-0.05, 0.04))
    ]
    scene = turned(Assembly((*rails, *tines), friction=0.5), 0.7)
    plate = RigidObject("plate", Cylinder(0.09, 0.012), Pose(np.eye(3), np.zeros(3)), mass=0.3)
    chocks = Chocks(scene, np.arange(len(scene.objects)), plate, np.zeros(3))
    validator = Validator(Analysis.of(scene), plate)
    rng = np.random.default_rng(0)
    poses = [pose for _ in range(20) for pose in chocks.poses(rng)]
    stand = [pose for pose in poses if abs(pose.translation[2] - (0.02 + np.sqrt(0.09**2 - 0.04**2))) < 1e-9]
    assert any(validator.accept(pose) is not None for pose in stand)


def test_a_condition_on_the_pose_alone_is_not_the_cause_where_other_poses_passed_it() -> None:
    counts = Counter({"over the rim": 300, "overlaps": 5})
    assert cause_of(counts, ["over the rim"]) == "no_room"
    assert cause_of(counts) == "condition_not_met"
