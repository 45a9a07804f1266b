"""Poses as a camera sees them become poses that touch: what rests on what, by how much, and what is refused."""

from dataclasses import replace

import assembly_scenes as scenes
import numpy as np
import pytest
import shapely
import trimesh
from scipy.special import ndtr

from benchmarks.perceived import KINDS, PerceivedTally, clean_scenes, compare
from poise.assembly import (
    Analysis,
    Assembly,
    Box,
    FrictionPair,
    Mesh,
    Push,
    RigidObject,
    assess,
    assess_settled,
    settle,
)
from poise.assembly.contact import CONTACT_MARGIN, Structure
from poise.assembly.scene import pose_covariance_of, read_scene, scene_content, with_pose_covariance
from poise.assembly.settling import contact_choice
from poise.assembly.settling.belief import POINTS, Belief
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, rotation_of_vector

STD = 0.002, np.radians(0.5)


def uncertain(assembly, position=STD[0], rotation=STD[1]):
    return replace(assembly, objects=with_pose_covariance(assembly.objects, pose_covariance_of(position, rotation)))


def off(item, translation=(0, 0, 0), turn=(0, 0, 0)):
    """An object seen with an error: m, and degrees about its origin."""
    pose = item.pose
    rotation = rotation_of_vector(np.radians(np.asarray(turn, dtype=float))) @ pose.rotation
    return replace(item, pose=Pose(rotation, pose.translation + np.asarray(translation, dtype=float)))


def seen(assembly, rng, position=STD[0], rotation=STD[1]):
    """The assembly with noise on the poses of all that is not fixed."""
    objects = tuple(
        item if item.fixed else off(item, position * rng.normal(size=3), np.degrees(rotation) * rng.normal(size=3))
        for item in assembly.objects
    )
    return uncertain(replace(assembly, objects=objects), position, rotation)


def small_stack(count=3, size=(0.2, 0.15, 0.1)):
    boxes = [scenes.box(f"b{k}", size, (0, 0, (k + 0.5) * size[2])) for k in range(count)]
    return scenes.on_floor(*boxes)


def pallet(layers=2, along=3, across=2, size=(0.2, 0.15, 0.1)):
    x, y, z = size
    return scenes.on_floor(
        *(
            scenes.box(f"b{k}{i}{j}", size, (i * x, j * y, (k + 0.5) * z))
            for k in range(layers)
            for i in range(along)
            for j in range(across)
        )
    )


def test_one_box_is_put_flat_on_the_floor_and_stays_where_it_was_seen_in_the_plane():
    box = off(scenes.box("b", (0.2, 0.15, 0.1), (1, 2, 0.05)), (0.001, 0.002, 0.003), (0.3, -0.6, 0.9))
    found = settle(uncertain(scenes.on_floor(box)))
    (move,) = found.moves
    item = found.assembly.objects[1]
    # Closed form: the errors of all coordinates are independent, so that height and tilt alone change.
    np.testing.assert_allclose(item.pose.translation, [1.001, 2.002, 0.05], atol=2e-5)
    np.testing.assert_allclose(item.pose.rotation[:, 2], [0, 0, 1], atol=1e-5)
    np.testing.assert_allclose(np.degrees(move.rotation[:2]), [-0.3, 0.6], atol=0.01)
    assert move.sigmas == pytest.approx(1.5, abs=0.02)  # 3 mm of 2 mm


def test_the_error_between_two_boxes_is_shared_by_their_covariances():
    left, right = (scenes.box(name, (0.2, 0.2, 0.2), (x, 0, 0.1)) for name, x in (("l", -0.1), ("r", 0.1)))
    left = replace(left, pose_covariance=pose_covariance_of(0.001, 1e-4))
    right = replace(off(right, (0.003, 0, 0)), pose_covariance=pose_covariance_of(0.002, 1e-4))
    found = settle(scenes.on_floor(left, right))
    # The most likely common face parts 5 mm as the variances, 1 to 4.
    assert [move.translation[0] for move in found.moves] == pytest.approx([0.0006, -0.0024], abs=2e-5)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("make", [small_stack, pallet])
def test_settled_scenes_touch_as_the_clean_ones_do(make, seed):
    clean = make()
    found = settle(seen(clean, np.random.default_rng(seed)))
    assert _pairs_on_top(found.assembly) >= _pairs_on_top(clean)
    for item in found.assembly.objects[1:]:
        np.testing.assert_allclose(item.pose.rotation[:, 2], [0, 0, 1], atol=2e-4)
    assert all(abs(interface.gap) < 1e-3 for interface in Structure.of(found.assembly).interfaces)


def _pairs_on_top(assembly):
    ids = [item.id for item in assembly.objects]
    return {
        (ids[i.first], ids[i.second]) for i in Structure.of(assembly).interfaces if i.normal[2] > 0.9 and i.area > 1e-3
    }


def test_a_plank_rests_on_the_higher_support_and_stays_off_the_lower_one():
    posts = [
        scenes.fixed_box(f"p{k}", (0.1, 0.1, h), (x, 0, h / 2)) for k, (x, h) in enumerate([(-0.02, 0.1), (0.2, 0.097)])
    ]
    plank = off(scenes.box("plank", (0.6, 0.1, 0.02), (0, 0, 0.11)), (0, 0, -0.0015), (0, 0.4, 0))
    found = settle(uncertain(scenes.on_floor(*posts, plank)))
    assert _pairs_on_top(found.assembly) == {("p0", "plank")}


def test_a_lying_cylinder_is_put_on_the_floor():
    can = scenes.cylinder("can", 0.04, 0.2, (0, 0, 0.04), quaternion=scenes.turned((0, 1, 0), 90))
    found = settle(uncertain(scenes.on_floor(off(can, (0, 0, 0.003), (0.2, 0.7, -0.4)))))
    item = found.assembly.objects[1]
    assert item.pose.translation[2] == pytest.approx(0.04, abs=2e-5)
    assert abs(item.pose.rotation[2, 2]) < 1e-4


def test_a_board_that_leans_stands_on_its_edges():
    wall = scenes.fixed_box("wall", (0.1, 2, 2), (-0.05, 0, 1))
    tilt = np.radians(60)
    board = scenes.box("board", (1.0, 0.4, 0.02), (0, 0, 0), quaternion=scenes.turned((0, 1, 0), np.degrees(tilt)))
    low = np.min(board.vertices, axis=0)
    board = off(board, (-low[0], 0, -low[2]))
    found = settle(uncertain(scenes.on_floor(wall, off(board, (0.002, 0, 0.003), (0, 0.2, 0)))))
    corners = found.assembly.objects[2].vertices
    np.testing.assert_allclose(corners.min(axis=0)[[0, 2]], 0, atol=3e-4)


def test_what_no_pose_within_three_sigma_explains_is_refused_with_the_pair_and_the_distance():
    high = scenes.box("b", (0.2, 0.2, 0.2), (0, 0, 0.13))
    with pytest.raises(
        InputError, match=r"nothing holds b: the nearest object that could, floor, is 30\.0 mm away"
    ) as caught:
        settle(uncertain(scenes.on_floor(high, scenes.box("lid", (0.2, 0.2, 0.02), (0, 0, 0.241)))))
    assert caught.value.code == ErrorCode.FLOATING
    pair = [scenes.box(name, (0.2, 0.2, 0.2), (x, 0, 0.1)) for name, x in (("a", 0), ("c", 0.15))]
    with pytest.raises(InputError, match=r"objects a and c overlap by 50\.0 mm") as caught:
        settle(uncertain(scenes.on_floor(*pair)))
    assert caught.value.code == ErrorCode.INTERPENETRATION
    assert set(caught.value.data["objects"]) == {"a", "c"}


def test_a_mesh_with_flat_faces_settles_like_its_box():
    polyhedron = Box((0.2, 0.15, 0.1)).polyhedron
    mesh = Mesh(polyhedron.vertices, polyhedron.triangles)
    clean = small_stack(3)
    noisy = seen(clean, np.random.default_rng(4))
    as_mesh = replace(noisy, objects=tuple(i if i.fixed else replace(i, shape=mesh) for i in noisy.objects))
    for one, other in zip(settle(noisy).assembly.objects, settle(as_mesh).assembly.objects, strict=True):
        np.testing.assert_allclose(one.pose.vector, other.pose.vector, atol=1e-9)


def test_what_is_known_exactly_stays_where_it_is():
    exact = small_stack(2)
    assert settle(exact).assembly is exact
    top = replace(off(exact.objects[2], (0, 0, 0.002)), pose_covariance=pose_covariance_of(*STD))
    found = settle(Assembly((*exact.objects[:2], top), exact.gravity))
    assert found.assembly.objects[1].pose is exact.objects[1].pose
    assert [move.id for move in found.moves] == ["b1"]


def test_samples_touch_like_the_scene_and_spread_as_the_covariance_says():
    boxes = scenes.box("b0", (0.3, 0.2, 0.1), (0, 0, 0.05)), scenes.box("b1", (0.2, 0.15, 0.1), (0, 0, 0.15))
    found = settle(seen(scenes.on_floor(*boxes), np.random.default_rng(1)))
    draws = found.samples(np.random.default_rng(2))
    centres = []
    for _ in range(200):
        item = next(draws).objects[2]
        assert item.pose.translation[2] == pytest.approx(0.15, abs=1e-4)
        centres.append(item.pose.translation[:2])
    assert np.std(centres, axis=0) == pytest.approx([STD[0]] * 2, rel=0.15)


def test_a_scene_file_states_the_uncertainty_once_or_for_each_object():
    content = scene_content(small_stack(2)) | {"pose_std": {"position": 0.002, "rotation_deg": 0.5}}
    content["objects"][2]["pose_std"] = {"position": 0.01}
    floor, first, second = read_scene(content).objects
    assert floor.pose_covariance is None
    np.testing.assert_allclose(np.diag(first.pose_covariance), [4e-6] * 3 + [np.radians(0.5) ** 2] * 3)
    np.testing.assert_allclose(np.diag(second.pose_covariance), [1e-4] * 3 + [0] * 3)
    again = read_scene(scene_content(read_scene(content))).objects
    np.testing.assert_allclose(again[2].pose_covariance, second.pose_covariance)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"pose_std": {"position": -1}}, "position of pose_std is -1"),
        ({"pose_std": {"degrees": 1}}, "unknown entry degrees"),
        ({"pose_covariance": [1.0] * 35}, "expected 36 numbers"),
        ({"pose_covariance": [-1.0] + [0.0] * 35}, "not symmetric and positive"),
        ({"pose_covariance": [0.0] * 36, "pose_std": {}}, "not both"),
    ],
)
def test_an_uncertainty_that_is_none_is_refused(entry, words):
    content = scene_content(small_stack(1))
    content["objects"][1] |= entry
    with pytest.raises(InputError, match=words):
        read_scene(content)


def _push(assembly, number=-1):
    item = assembly.objects[number]
    return Push(item.id, item.pose.apply(np.array([-item.shape.size[0] / 2, 0, 0.01])), (1, 0, 0))


def test_intervals_hold_the_robustness_of_the_clean_scene_and_repeat_with_their_seed():
    clean = small_stack(2)
    truth = assess(clean, [_push(clean)]).results[0].robustness
    scene = settle(seen(clean, np.random.default_rng(3)))
    found = assess_settled(scene, [_push(scene.seen)], samples=12, seed=5)
    assert found.lower[0] <= truth <= found.upper[0]
    assert (found.samples, found.fallen, found.refused, found.complete) == (12, 0, 0, True)
    assert found.coverage == pytest.approx(11 / 13)
    again = assess_settled(scene, [_push(scene.seen)], samples=12, seed=5, analysis=Analysis.of(scene.assembly))
    np.testing.assert_array_equal([found.lower, found.upper], [again.lower, again.upper])


def test_intervals_widen_with_masses_and_friction():
    clean = small_stack(1)
    exact = assess_settled(settle(clean), [_push(clean)])
    assert exact.samples == 0  # nothing is uncertain
    covariance = np.zeros((10, 10))
    covariance[0, 0] = 0.1**2
    heavy = replace(clean, objects=(clean.objects[0], replace(clean.objects[1], covariance=covariance)))
    slippery = replace(clean, friction_pairs=(FrictionPair(("floor", "b0"), 0.5, 0.05),))
    for assembly in (heavy, slippery):
        found = assess_settled(settle(assembly), [_push(assembly)], samples=20)
        # Sliding takes mu m g: both vary by a tenth, and 20 draws reach to about 1.9 sigma.
        width = (found.upper[0] - found.lower[0]) / exact.settled.results[0].robustness
        assert 0.2 < width < 0.6


def test_without_time_for_samples_the_answer_says_so():
    scene = settle(seen(small_stack(2), np.random.default_rng(0)))
    found = assess_settled(scene, [_push(scene.seen)], deadline=0.0)
    assert not found.complete
    assert found.samples == 0
    assert found.coverage == 0


def test_cartons_of_one_size_are_stacked_in_line_and_others_are_not_moved():
    found = settle(seen(pallet(2, 2, 2), np.random.default_rng(3)))
    places = np.array([item.pose.translation for item in found.assembly.objects[1:]])
    np.testing.assert_allclose(places[:4, :2], places[4:, :2], atol=1e-5)
    np.testing.assert_allclose(places[2] - places[0], places[3] - places[1], atol=1e-5)
    large, small = scenes.box("l", (0.2, 0.2, 0.1), (0, 0, 0.05)), scenes.box("s", (0.15, 0.15, 0.1), (0.001, 0, 0.15))
    (_, move) = settle(uncertain(scenes.on_floor(large, small))).moves
    np.testing.assert_allclose(move.translation, 0, atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_a_slice_of_the_benchmark_is_answered_near_the_truth(kind):
    rng, tally = np.random.default_rng(11), PerceivedTally()
    for clean, _ in zip(clean_scenes(kind, rng), range(2), strict=False):
        compare(clean, rng, "gauss", 0, tally)
    assert tally.answered == tally.scenes == 2
    assert np.median(tally.errors) < 0.1


def test_errors_of_contacts_that_follow_from_others_do_not_move_bodies_far():
    # Four cartons in a square, one of them 0.3 mm too wide: the contacts around the square disagree.
    wide = replace(
        pallet(1, 2, 2), objects=(*pallet(1, 2, 2).objects[:4], scenes.box("w", (0.2003, 0.15, 0.1), (0.2, 0.15, 0.05)))
    )
    for seed in range(5):
        found = settle(seen(wide, np.random.default_rng(seed)))
        assert all(move.sigmas < 3.5 for move in found.moves)
        assert len(Structure.of(found.assembly).interfaces) >= 6


def test_how_many_are_asked_together_changes_no_contact(monkeypatch):
    scene = seen(pallet(), np.random.default_rng(8))
    found = settle(scene)._problem.choice
    monkeypatch.setattr(contact_choice, "_AHEAD", 1)
    one_by_one = settle(scene)._problem.choice
    assert one_by_one.contacts == found.contacts
    assert one_by_one.rows == found.rows


def test_a_contact_conditions_the_gaussian_as_kalman_says():
    problem = settle(seen(small_stack(), np.random.default_rng(2)))._problem
    belief, rows = Belief(problem.bodies, problem.candidates.rows), slice(0, POINTS)
    distance, jacobian = (of[rows] for of in problem.bodies.jacobian(problem.candidates.rows, problem.bodies.poses))
    before = belief.covariance.copy()
    assert belief.accept(0)
    gain = before @ jacobian.T @ np.linalg.inv(jacobian @ before @ jacobian.T + 1e-8 * np.eye(POINTS))
    np.testing.assert_allclose(belief.mean, -gain @ distance, rtol=0, atol=1e-9)
    np.testing.assert_allclose(belief.covariance, before - gain @ jacobian @ before, rtol=0, atol=1e-14)


def _side_by_side(gap):
    """Two boxes on a floor, with a gap between them."""
    boxes = [scenes.box(name, (0.2, 0.2, 0.2), (x, 0, 0.1)) for name, x in (("l", -0.1), ("r", 0.1 + gap))]
    return scenes.on_floor(*boxes)


def _touch(assembly):
    return any((i.first, i.second) == (1, 2) for i in Structure.of(assembly).interfaces)


def test_parallel_faces_are_no_more_than_a_hint_of_contact():
    """Boxes on a shelf are mostly parallel, whether they touch or not: most of the evidence is the gap that is seen."""
    deviation = np.sqrt(2) * STD[0]
    within = ndtr(0.04 / deviation) - ndtr(CONTACT_MARGIN / deviation)
    by_gap = 0.04 / (np.sqrt(2 * np.pi) * deviation * within)  # odds against a gap of up to 40 mm
    chance = settle(uncertain(_side_by_side(0.0))).doubtful_pairs["l", "r"]
    assert by_gap < chance / (1 - chance) < 2 * by_gap


def test_contacts_of_before_stay_while_they_explain_what_is_seen():
    """Four millimetres are 1.4 sigma of the distance of two boxes: with contacts known, no frame decides otherwise."""
    apart = [_touch(settle(uncertain(_side_by_side(gap))).assembly) for gap in (0.0, 0.012)]
    assert apart == [True, False]
    for start in (0.0, 0.012):
        known = settle(uncertain(_side_by_side(start))).assembly
        for gap in (0.004, 0.006, 0.001, 0.004):
            known = settle(uncertain(_side_by_side(gap)), known).assembly
            assert _touch(known) == (start == 0.0)


def test_contacts_of_before_are_given_up_when_they_no_longer_explain_it():
    touching = settle(uncertain(_side_by_side(0.0))).assembly
    assert not _touch(settle(uncertain(_side_by_side(0.015)), touching).assembly)  # 5 sigma
    far = settle(uncertain(_side_by_side(0.3)), touching).assembly
    assert not _touch(far)
    assert _touch(settle(uncertain(_side_by_side(0.001)), far).assembly)  # it came back: nothing of before counts
    added = replace(touching, objects=(*touching.objects, scenes.box("new", (0.1, 0.1, 0.1), (1, 1, 0.051))))
    assert len(settle(uncertain(added), touching).assembly.objects) == 4


@pytest.mark.parametrize("seed", range(6))
def test_cartons_of_heights_that_differ_by_tenths_of_a_millimetre_settle(seed):
    """Three layers of touching cartons, each turned against the one below; in truth some do not touch those below."""
    rng, boxes, top = np.random.default_rng(seed), [], 0.0
    for layer in range(3):
        nx, ny = (3, 2) if layer % 2 else (2, 3)
        for i in range(nx):
            for j in range(ny):
                height = 0.1 - float(rng.uniform(0, 5e-4))
                middle = ((i + 0.5) * 0.6 / nx, (j + 0.5) * 0.6 / ny, top + height / 2)
                boxes.append(scenes.box(f"b{len(boxes)}", (0.6 / nx, 0.6 / ny, height), middle))
        top += 0.1
    found = settle(seen(scenes.on_floor(*boxes), rng))
    assert found.worst.sigmas < found.accepted
    assert Analysis.of(found.assembly).stability().stable


def _frame(name, x):
    outline = shapely.box(-0.05, -0.05, 0.05, 0.05).difference(shapely.box(-0.045, -0.045, 0.045, 0.045))
    surface = trimesh.creation.extrude_polygon(outline, 0.04)
    mesh = Mesh(np.asarray(surface.vertices), np.asarray(surface.faces, dtype=np.int64))
    return RigidObject(name, mesh, scenes.pose((x, 0, 0)), mass=0.3)


def test_thin_walls_beside_each_other_do_not_touch_through_each_other():
    """The inner sides of both walls look towards each other, and are nearer than three sigma through the walls."""
    answered = 0
    for seed in range(8):
        noisy = seen(scenes.on_floor(_frame("a", 0.0), _frame("b", 0.101)), np.random.default_rng(seed))
        try:
            found = settle(noisy).assembly.objects
        except InputError:
            continue
        answered += 1
        assert found[2].vertices[:, 0].min() > found[1].vertices[:, 0].max() - 2e-3
    assert answered >= 7
