"""Placements stand by an independent count, and what cannot be placed says why."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.placement import scenes
from poise.assembly import Analysis, Assembly, Push, assess
from poise.assembly.scene.scene_files import read_object, read_scene
from poise.assembly.statics import NO_DEADLINE, Deadline
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import Pose
from poise.placement import (
    CancelledError,
    ContactFeatures,
    KeptFree,
    Options,
    PlacementScore,
    Uncertainty,
    Upright,
    Validator,
    choice,
    evaluate,
    kept_free,
    plan_placement,
)
from poise.placement.matching import SupportPoint, poses_on_one, poses_on_two
from poise.placement.refusals import no_placement

FLOOR = {"id": "floor", "fixed": True, "box": [4, 4, 0.1], "pose": [0, 0, -0.05, 0, 0, 0, 1]}
UP = np.array([0.0, 0.0, 1.0])


def box(name: str, size: list[float], position: list[float], **more: object) -> dict[str, object]:
    return {"id": name, "box": size, "pose": [*position, 0, 0, 0, 1], "mass": 2.0, **more}


def scene(*objects: dict[str, object]) -> Assembly:
    return read_scene({"objects": [FLOOR, *objects], "friction": 0.5})


CANYON = (box("left", [0.3, 0.4, 0.3], [-0.2, 0, 0.15]), box("right", [0.3, 0.4, 0.3], [0.2, 0, 0.15]))
CUBE = {"id": "cube", "box": [0.2, 0.2, 0.2], "mass": 3.0}


def test_a_speck_elsewhere_does_not_turn_heavy_objects_away():
    """It stands with a share of its own weight, which is less than the least margin of a heavy object."""
    speck = box("speck", [0.02, 0.01, 0.004], [1.0, 0, 0.002]) | {"mass": 1e-4}
    found = plan_placement(scene(speck), read_object(CUBE))
    assert found.analysis.stability().margin > 0.0


@pytest.mark.parametrize("seed", range(5))
def test_a_placement_stands_and_its_least_robustness_is_that_of_its_weakest_corner(seed):
    found = plan_placement(scene(*CANYON), read_object(CUBE), Options(on="objects"), seed)
    assert Analysis.of(found.analysis.assembly).stability().margin > 0
    corners = [
        Push(item.id, item.pose.apply(corner), -item.pose.rotation @ normal)
        for item in found.analysis.assembly.objects
        if not item.fixed
        for facet, normal in enumerate(item.shape.polyhedron.normals)
        for corner in item.shape.polyhedron.vertices[item.shape.polyhedron.facet_vertices[facet]]
    ]
    answers = assess(found.analysis.assembly, corners).results
    assert found.score.least == pytest.approx(min(one.lower for one in answers), rel=0.03)


def test_same_seed_same_answer():
    first, second = (plan_placement(scene(*CANYON), read_object(CUBE), seed=3) for _ in range(2))
    assert np.array_equal(first.pose.vector, second.pose.vector)


def test_a_face_lies_on_each_of_two_slopes():
    """A V of two planes at right angles takes the edge of a box: both faces flat, the edge in the valley."""
    slopes = [np.array([np.sin(a), 0, np.cos(a)]) for a in (np.pi / 4, -np.pi / 4)]
    contacts = [SupportPoint(np.array([-0.1 * n[0], 0.02 * n[0], 0.1 * abs(n[0])]), n) for n in slopes]
    features = ContactFeatures.of(read_object(CUBE).shape, None)
    rng = np.random.default_rng(0)
    poses = [pose for _ in range(40) for pose in poses_on_two(*contacts, features, rng, 4)]
    flat = 0
    for pose in poses:
        corners = pose.apply(read_object(CUBE).shape.polyhedron.vertices)
        heights = [(corners - contact.point) @ contact.normal for contact in contacts]
        flat += all(np.sum(np.abs(height) < 1e-9) == 4 and height.min() > -1e-9 for height in heights)
    assert flat > len(poses) / 3


def test_the_centre_of_mass_comes_over_the_place():
    features = ContactFeatures.of(
        read_object({**CUBE, "com": [0.03, -0.02, 0.01]}).shape, np.array([0.03, -0.02, 0.01])
    )
    place = SupportPoint(np.array([0.4, 0.5, 0.6]), UP)
    for face in features.faces:
        (pose,) = poses_on_one(place, face, features.com, np.array([0.7]))
        assert pose.apply(features.com)[:2] == pytest.approx([0.4, 0.5])
        assert (pose.apply(read_object(CUBE).shape.polyhedron.vertices)[:, 2]).min() == pytest.approx(0.6)


def test_a_robust_placement_keeps_its_distance_from_the_edge():
    tower = box("tower", [0.2, 0.2, 0.4], [0, 0, 0.2])
    item = read_object({**CUBE, "box": [0.1, 0.1, 0.1]})
    for seed in range(5):
        options = Options(on="objects", uncertainty=Uncertainty(position=0.02, angle=0.01))
        com = plan_placement(scene(tower), item, options, seed).item.com_in_world
        # Leaning by 0.01 rad moves the weight by 0.01 times its height over the support.
        assert np.abs(com[:2]).max() <= 0.1 - (0.02 + 0.01 * 0.05) + 1e-6


def test_a_can_is_not_left_where_it_may_roll():
    can = read_object({"id": "can", "cylinder": [0.04, 0.1], "mass": 0.3})
    for seed in range(5):
        found = plan_placement(scene(*CANYON), can, Options(on="objects"), seed)
        assert abs(found.pose.rotation[2, 2]) == pytest.approx(1.0)
        assert found.score.least > 0


def test_a_room_that_is_kept_free_stays_free():
    table = {"id": "table", "fixed": True, "box": [0.6, 0.6, 0.1], "pose": [0, 0, -0.05, 0, 0, 0, 1]}
    room = KeptFree(np.array([-0.3, -0.3, 0.0]), np.array([0.1, 0.3, 0.4]))
    kept = Options(candidates=1, looks=(("is to stay free", room),))
    turned_away = 0
    for seed in range(6):
        found = plan_placement(read_scene({"objects": [table]}), read_object(CUBE), kept, seed)
        assert found.item.vertices[:, 0].min() >= 0.1 - 1e-9
        turned_away += found.rejected.get("is to stay free", 0)
    assert turned_away > 0  # it would have gone there
    everything = KeptFree(np.full(3, -1.0), np.full(3, 1.0))
    full = Options(attempts=20, looks=(("is to stay free", everything),))
    with pytest.raises(NoAnswerError) as error:
        plan_placement(read_scene({"objects": [table]}), read_object(CUBE), full)
    assert error.value.data["rejected"]["is to stay free"] > 0


def test_nothing_is_placed_over_a_table_that_is_kept_free():
    table, tray = ({"id": name, "fixed": True, "box": [0.3, 0.3, 0.02]} for name in ("table", "tray"))
    assembly = read_scene(
        {"objects": [table | {"pose": [-0.2, 0, 0, 0, 0, 0, 1]}, tray | {"pose": [0.2, 0, 0, 0, 0, 0, 1]}]}
    )
    block = read_object({"id": "block", "box": [0.05, 0.05, 0.05], "mass": 1.0})
    free = Options(candidates=1, looks=kept_free(assembly, ["table", "a_table_that_is_gone"], {"a_table_that_is_gone"}))
    assert len(free.looks) == 1
    for seed in range(4):
        assert plan_placement(assembly, block, free, seed).item.vertices[:, 0].min() > 0.04
    with pytest.raises(InputError, match="no object 'tabel'; it has table, tray") as error:
        kept_free(assembly, ["tabel"])
    assert error.value.code == ErrorCode.OBJECT_UNKNOWN


def test_where_an_object_settled_is_looked_at_again(monkeypatch):
    there = replace(read_object(CUBE), pose=Pose(np.eye(3), np.array([-0.2, 0, 0.4])))
    sunk = replace(there, pose=Pose(np.eye(3), np.array([-0.25, 0, 0.4])))
    room = KeptFree(np.array([-0.4, -0.3, 0.0]), np.array([-0.32, 0.3, 1.0]))
    validator = Validator(Analysis.of(scene(*CANYON)), there, looks=(("is to stay free", room),))
    assert validator.accept(there.pose) is not None
    monkeypatch.setattr(validator, "_standing", lambda analysis, *_: (analysis, sunk))
    assert validator.accept(there.pose) is None
    assert validator.rejected == {"is to stay free": 1}


def test_more_candidates_are_no_worse():
    least = [
        plan_placement(scene(*CANYON), read_object(CUBE), Options(candidates=k, on="objects"), 1).score.least
        for k in (1, 8)
    ]
    assert least[1] >= least[0] * 0.99


def test_refining_does_not_make_it_worse():
    plain, refined = (
        plan_placement(scene(*CANYON), read_object(CUBE), Options(on="objects", refining=refining), 2)
        for refining in (False, True)
    )
    assert evaluate(refined.analysis).least >= evaluate(plain.analysis).least * (1 - 1e-6)


def test_the_score_does_not_count_on_neighbours():
    """Three bricks side by side on a post that ends 3 mm outside the centres of the outer ones."""
    bricks = [box(f"b{k}", [0.2, 0.1, 0.1], [0.2 * k, 0, 0.15]) for k in (-1, 0, 1)]
    post = box("post", [0.406, 0.5, 0.1], [0, 0, 0.05], fixed=True)
    analysis = Analysis.of(scene(post, *bricks))
    corner = Push("b1", (0.1, 0.05, 0.1), (0, 0, 1))
    held = assess(analysis, [corner]).results[0].lower
    assert evaluate(analysis).least <= 1.02 * held < 0.5 * assess(analysis, [corner], "limit").results[0].lower


def test_a_placement_that_elastic_contacts_do_not_confirm_gives_way_to_the_next(monkeypatch):
    first, second = (PlacementScore(least, np.nan, 1.0, 1.0) for least in (3.0, 2.0))
    held = {"first": 1.0, "second": 1.9}
    asked = []

    def confirm(name, least, deadline):
        asked.append(name)
        return min(least, held[name])

    monkeypatch.setattr(choice, "confirm_least", confirm)
    names = ("first", "second")
    assert choice.best_confirmed(names, (first, second), "least", NO_DEADLINE) == 1
    assert asked == ["first", "second"]
    held["first"] = 2.5
    assert choice.best_confirmed(names, (first, second), "least", NO_DEADLINE) == 0
    assert choice.best_confirmed(names, (first, second), "least", Deadline.after(0.0)) == 0
    assert asked == ["first", "second", "first"]


def test_what_balances_nowhere_says_why():
    """A centre of mass outside the object can be over no contact on a level plate smaller than its lever."""
    pedestal = {"id": "pedestal", "fixed": True, "box": [0.1, 0.1, 0.5], "pose": [0, 0, 0.25, 0, 0, 0, 1]}
    item = read_object({**CUBE, "com": [1.0, 1.1, 1.2]})
    with pytest.raises(NoAnswerError) as error:
        plan_placement(read_scene({"objects": [pedestal]}), item, Options(attempts=30))
    assert error.value.code is ErrorCode.NO_PLACEMENT
    assert sum(error.value.data["rejected"].values()) == error.value.data["iterations"] == 30


def test_an_unstable_scene_is_refused():
    leaning = box("leaning", [0.1, 0.1, 0.1], [0, 0, 0.15])
    ledge = box("ledge", [0.1, 0.1, 0.1], [0.08, 0, 0.05], fixed=True)
    with pytest.raises(NoAnswerError) as error:
        plan_placement(scene(ledge, leaning), read_object(CUBE))
    assert error.value.code is ErrorCode.UNSTABLE


@pytest.mark.parametrize(
    "options", [{"criterion": "best"}, {"on": "nothing"}, {"attempts": 0}, {"deadline": float("nan")}]
)
def test_wishes_are_checked(options):
    with pytest.raises(InputError) as error:
        Options(**options)
    assert error.value.code is ErrorCode.BAD_INPUT


def test_an_id_of_the_scene_is_refused():
    with pytest.raises(InputError, match="left"):
        plan_placement(scene(*CANYON), read_object({**CUBE, "id": "left"}))


def test_cancelling_ends_at_the_next_pose():
    seen = []
    with pytest.raises(CancelledError) as error:
        plan_placement(
            scene(*CANYON),
            read_object(CUBE),
            Options(candidates=50),
            progress=lambda p: seen.append(p) or len(seen) < 3,
        )
    assert error.value.code is ErrorCode.CANCELLED
    assert len(seen) == 3


def test_a_deadline_before_the_first_pose_is_said():
    with pytest.raises(NoAnswerError) as error:
        plan_placement(scene(*CANYON), read_object(CUBE), Options(deadline=1e-9))
    assert error.value.code is ErrorCode.DEADLINE


@pytest.mark.parametrize(("late", "words"), [(True, "poses until the deadline (7 over"), (False, "poses (7 over")])
def test_a_deadline_that_ended_the_search_is_said(late, words):
    found = no_placement(read_object(CUBE), Counter({"overlaps": 7}), 7, late)
    assert words in str(found)
    assert str(found).endswith("allow more time" if late else "allow more attempts")
    assert found.data["late"] is late


@pytest.mark.parametrize("seed", range(4))
def test_a_mug_is_placed_upright_when_that_is_asked_for(seed):
    scene = scenes.scene("cube")
    mug = scenes.bowl(200)
    found = plan_placement(scene, mug, Options(candidates=1, looks=[("turned", Upright())]), seed)
    assert found.pose.rotation[2, 2] > np.cos(np.radians(5.0))
