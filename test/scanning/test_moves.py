"""An object that is pushed once during a sweep is reported and corrected; and healthy sweeps, in two worlds."""

from dataclasses import replace
from functools import cache, partial
from importlib import import_module

import numpy as np
import pytest
from scenes import BRICK, EXACT, box, brick_views, views_of
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.fake_robots.depth_noise import D435
from poise.fake_robots.rasteriser import Body, Scene
from poise.scanning import scan
from poise.scanning.moves import ObjectMove

VOLUME = float(np.prod(BRICK))
PUSHED_AT = 11
"""The first view after the push, of 24."""


@cache
def rendered(push=(0.0, 0.0, 0.0), camera_like_d435=True):
    """A brick that was pushed along x and y, m, and turned, degrees."""
    body = box(BRICK, (0.0, 0.0, 0.025), (0.8, 0.2, 0.1))
    turn = Rotation.from_euler("z", push[2], degrees=True).as_matrix()
    moved = Body(body.triangles @ turn.T + np.array([push[0], push[1], 0.0]), body.colours)
    return tuple(views_of(Scene((moved,)), noise=D435 if camera_like_d435 else EXACT))


def foreign(views, noise, seed=3):
    """White noise, m, instead of a stereo camera's, and a hand-eye transform off by 0.3 mm and 0.06 deg an axis."""
    rng = np.random.default_rng(seed)
    tilt = Rotation.from_rotvec(rng.normal(size=3) * np.deg2rad(0.06)).as_matrix()
    shift = rng.normal(size=3) * 3e-4
    changed = []
    for view in views:
        depth = view.frame.depth
        noisy = np.where(depth > 0, depth + rng.normal(scale=noise, size=depth.shape), 0).astype(np.float32)
        changed.append(
            replace(
                view,
                frame=replace(view.frame, depth=noisy),
                rotation_world_camera=view.rotation_world_camera @ tilt,
                translation_world_camera=view.translation_world_camera + view.rotation_world_camera @ shift,
            )
        )
    return changed


def reported(found):
    """The sentences about a push."""
    return [note for note in found.notes if "the object moved by" in note]


def sweep_with(push, world):
    whole = rendered(camera_like_d435=world == "stereo")
    views = [*whole[:PUSHED_AT], *rendered(push, world == "stereo")[PUSHED_AT:]]
    return views if world == "stereo" else foreign(views, 1e-3)


@pytest.mark.parametrize("count", [24, 28])
def test_a_thin_bar_at_rest_was_not_pushed_and_keeps_its_volume(count):
    """Both of its sides fit better on top of each other: 3.6 mm were "found", and 0.68 of the volume."""
    sides = (0.15, 0.012, 0.012)
    found = scan(views_of(Scene((box(sides, (0.0, 0.0, 0.006), (0.8, 0.2, 0.1)),)), count))
    assert not reported(found)
    assert found.segmented().solid.volume == pytest.approx(np.prod(sides), rel=0.06)


@pytest.mark.parametrize(
    ("push", "distance", "world"),
    [
        ((0.008, 0.0, 0.0), 8, "stereo"),
        ((0.0, 0.008, 0.0), 8, "foreign"),
        ((0.015, 0.013, 0.0), 20, "stereo"),
        ((0.015, 0.013, 0.0), 20, "foreign"),
    ],
)
def test_a_push_is_reported_and_the_views_before_it_are_taken_along(push, distance, world):
    found = scan(sweep_with(push, world))
    (note,) = reported(found)
    assert note.startswith("2.6 s after the first view")  # frames are 0.24 s apart
    assert float(note.split("moved by ")[1].split(" mm")[0]) == pytest.approx(distance, abs=2)
    assert found.foot[:2] == pytest.approx(push[:2], abs=2e-3)  # where it stood at last
    assert found.agreed > 0.97
    solid = found.segmented().solid
    assert solid.volume == pytest.approx(VOLUME, rel=0.1)
    assert abs(solid.volume - VOLUME) < 2 * solid.volume_std


@pytest.mark.parametrize(("push", "world"), [((0.003, 0.0, 0.0), "stereo"), ((0.0, 0.003, 0.0), "foreign")])
def test_smaller_pushes_leave_the_volume_within_its_uncertainty(push, world):
    solid = scan(sweep_with(push, world)).segmented().solid
    assert abs(solid.volume - VOLUME) < min(2 * solid.volume_std, 0.15 * VOLUME)


def test_a_turn_by_a_touch_is_reported():
    (note,) = reported(scan(sweep_with((0.0, 0.0, 5.0), "stereo")))
    assert "(+5 deg)" in note


def test_views_that_no_motion_brings_together_are_refused_with_the_likely_cause():
    """A brick that was turned by a quarter: the search does not reach so far."""
    with pytest.raises(InputError, match="the object moved by") as caught:
        scan(sweep_with((0.0, 0.0, 90.0), "stereo"))
    assert caught.value.code == ErrorCode.SCAN_INCOMPLETE


@pytest.mark.parametrize("noise", [0.0, 1e-3, 2e-3])
def test_an_object_at_rest_has_not_moved(noise):
    assert not reported(scan(foreign(rendered(camera_like_d435=False), noise, seed=7)))


def test_at_rest_before_a_stereo_camera_it_has_not_moved_either():
    assert not reported(scan(brick_views()))
    assert not reported(scan(foreign(brick_views(), 0.0, seed=8)))


def test_a_move_that_leaves_nothing_to_see_does_not_spoil_views_that_agree(monkeypatch):
    """With the views before, the table would lean by 40 degrees: no level plane is found."""
    views = brick_views()
    lean = Rotation.from_euler("x", 40, degrees=True).as_matrix()
    wrong = ObjectMove(views[-1].frame.stamp, 5.0, lean, np.zeros(3), 0.02, 0.0)
    monkeypatch.setattr(import_module("poise.scanning.observing"), "find_move", lambda views, footprint: wrong)
    found = scan(views)
    assert not reported(found)
    assert found.segmented().solid.volume == pytest.approx(VOLUME, rel=0.1)


def test_frames_that_stop_halfway_leave_a_volume_that_knows_it():
    found = scan(brick_views()[:12])
    assert any("sides are guessed" in note for note in found.notes)
    solid = found.segmented().solid
    assert abs(solid.volume - VOLUME) < 2 * solid.volume_std


def test_a_hand_near_the_lens_is_not_a_part_of_the_object():
    covered = [
        replace(view, frame=replace(view.frame, depth=np.full_like(view.frame.depth, 0.1))) if 6 <= row < 10 else view
        for row, view in enumerate(brick_views())
    ]
    found = scan(covered)
    assert not reported(found)
    assert found.n_objects == 2  # and a note says which one was taken
    np.testing.assert_allclose(np.ptp(found.points, axis=0), BRICK, atol=6e-3)


def test_a_turn_after_which_the_object_looks_alike_is_no_push(monkeypatch):
    """A brick turned by a half: views agree before and after it alike, so that nothing says that it moved."""
    views = tuple(foreign(brick_views(), 1e-3, seed=11))
    half = Rotation.from_euler("z", 180, degrees=True).as_matrix()
    for first in (8, 12, 16):
        wrong = ObjectMove(views[first].frame.stamp, 2.0, half, np.zeros(3), 0.07, np.pi)
        found_move = partial(lambda move, *_: move, wrong)
        monkeypatch.setattr(import_module("poise.scanning.observing"), "find_move", found_move)
        assert not reported(scan(views))
