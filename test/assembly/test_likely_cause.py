"""Scenes that are refused or fall: read by another convention they stand, and that is said."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.broken_scenes import BREAKS, outcome_of
from benchmarks.perceived import clean_scenes, random_pushes, seen
from poise.assembly import Assembly, Box, RigidObject, settle, write_scene
from poise.assembly.robustness import likely_cause
from poise.assembly.scene import pose_covariance_of, scene_findings, with_pose_covariance
from poise.cli import run
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, rotation_about

Change = Callable[[RigidObject], RigidObject]


def scene(change: Change | None = None, gravity: float = -9.81) -> Assembly:
    """Two boxes on a floor, turned about the vertical."""
    made = [RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -0.05])), fixed=True)]
    for k, yaw in enumerate((0.4, 1.9)):
        pose = Pose(rotation_about([0.0, 0.0, 1.0], yaw), np.array([0.0, 0.0, 0.1 + 0.2 * k]))
        item = RigidObject(f"b{k}", Box((0.3, 0.25, 0.2)), pose, mass=2.0)
        made.append(item if change is None else change(item))
    return Assembly(tuple(made), np.array([0.0, 0.0, gravity]))


def w_first(item: RigidObject) -> RigidObject:
    return replace(item, pose=Pose.from_vector(item.pose.vector[[0, 1, 2, 6, 3, 4, 5]]))


def half(item: RigidObject) -> RigidObject:
    return replace(item, shape=Box((0.15, 0.125, 0.1)))


def lower(item: RigidObject) -> RigidObject:
    return replace(item, pose=Pose(item.pose.rotation, item.pose.translation - [0, 0, 0.1]))


@pytest.mark.parametrize(
    ("assembly", "word"),
    [
        (scene(w_first), "w x y z"),
        (scene(half), "half as large"),
        (scene(lower), "bottoms"),
        (scene(gravity=9.81), "gravity is along -z"),
    ],
)
def test_the_cause_is_named(assembly: Assembly, word: str) -> None:
    assert word in str(likely_cause(assembly))


def test_a_board_on_supports_whose_heights_a_camera_saw_unequal() -> None:
    """Supports of 190 mm that were measured as 188.6 and 194.1 mm carry a board; no face of the board lies on both."""
    clean = [
        RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -0.05])), fixed=True),
        RigidObject("left", Box((0.08, 0.15, 0.1886)), Pose(np.eye(3), np.array([-0.09, 0, 0.095])), mass=1.3),
        RigidObject("right", Box((0.08, 0.15, 0.1941)), Pose(np.eye(3), np.array([0.09, 0, 0.095])), mass=1.8),
        RigidObject("board", Box((0.28, 0.12, 0.03)), Pose(np.eye(3), np.array([-0.03, 0, 0.205])), mass=0.9),
    ]
    known = with_pose_covariance(clean, pose_covariance_of(0.002, np.radians(0.5)))
    assembly = Assembly(tuple(known), np.array([0.0, 0.0, -9.81]))
    said = str(likely_cause(assembly))
    assert said.startswith("the scene stands if left, right are equally tall (not 188.6, 194.1 mm)")


def test_a_pose_that_is_off_is_named_beside_other_readings() -> None:
    whole = scene()
    (lowered,) = (replace(item, pose=lower(item).pose) for item in whole.objects if item.id == "b1")
    near = replace(lowered, pose=Pose(lowered.pose.rotation, lowered.pose.translation + np.array([0, 0, 0.08])))
    assert str(likely_cause(whole.with_object(near))).endswith("the pose of b1 is 20 mm off")
    assert "b1 is left out" in str(likely_cause(whole.with_object(lowered)))


def test_what_overlaps_after_settling_is_not_told_to_state_what_it_states() -> None:
    whole, covariance = scene(), pose_covariance_of(0.002, 0.01)
    twice = replace(whole.objects[1], id="again", pose=Pose(np.eye(3), np.array([0.003, 0.002, 0.1])))
    seen_twice = Assembly(with_pose_covariance((*whole.objects, twice), covariance))
    with pytest.raises(InputError, match=r"seen twice|overlap by .* standard deviations") as caught:
        settle(seen_twice)
    assert caught.value.code == ErrorCode.INTERPENETRATION
    assert "how uncertain" not in caught.value.message


def test_no_cause_is_made_up() -> None:
    whole = scene()
    floating = replace(whole, objects=(whole.objects[0], whole.objects[2]))
    assert likely_cause(floating) is None


def test_the_command_warns_of_the_cause(tmp_path, capsys) -> None:
    write_scene(scene(half), tmp_path / "scene.yaml")
    assert run(["robustness", str(tmp_path / "scene.yaml")]) != 0
    assert "half as large" in " ".join(capsys.readouterr().err.split())


def test_seen_quaternions_of_another_order_are_a_finding() -> None:
    rng = np.random.default_rng([1, 1])
    clean = next(clean_scenes("shelf", rng))
    given = seen(clean, rng, "gauss")
    assert not scene_findings(given)
    swapped = replace(given, objects=tuple(item if item.fixed else w_first(item) for item in given.objects))
    (found,) = scene_findings(swapped)
    assert "x y z w" in found.sentence


@pytest.mark.parametrize(
    "name",
    [
        "as stated",
        "all in mm",
        "poses with y up",
        "one object twice",
        "one half size",
        "one mesh in mm",
        "one mesh in cm",
        "one position in mm",
        "one mesh from its corner",
        "one pose missing",
        "errors 4 times those stated",
        "friction in degrees",
    ],
)
def test_outcomes_of_broken_scenes(name: str) -> None:
    rng = np.random.default_rng([3, 0])
    clean = next(clean_scenes("stack", rng))
    given, pushes = seen(clean, rng, "gauss"), random_pushes(clean, rng)
    outcome, _ = outcome_of(name, clean, given, pushes, rng, 0)
    assert outcome == ("cause named" if BREAKS[name].cause else "right")
