"""Poses that are late, or of a camera that sits elsewhere: corrected and said, or in the volume's uncertainty."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scenes import BRICK, box, views_of
from scipy.spatial.transform import Rotation

from poise.fake_robots.rasteriser import Scene, look_at
from poise.scanning import CameraPoses, Ring, ScanOptions, Sweep, causes, scan
from poise.scanning.causes import likely_cause
from poise.scanning.depth_scale import rescaled
from poise.scanning.fusion import Surface
from poise.scanning.pose_doubt import pose_doubt
from poise.scanning.shared_errors import Path, without_shared
from poise.shape.segmentation import segment

COUNT, PERIOD = 24, 0.24
COARSE = ScanOptions(voxel=2.5e-3)
RINGS = {"arm": Ring(low=0.4, high=1.1, sways=2), "turntable": Ring(low=0.75, high=0.75)}
POINT = np.array([0.0, 0.0, 0.02])
VOLUME = float(np.prod(BRICK))


@cache
def seen(ring):
    return tuple(views_of(Scene((box(BRICK, (0.0, 0.0, 0.025), (0.8, 0.2, 0.1)),)), COUNT, ring=RINGS[ring]))


def posed(ring, late=0.0, shift=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0), jitter=0.0):
    """Views whose poses are wrong: of later instants by a share of a period, or of a camera that sits elsewhere."""
    fine = 100
    places = RINGS[ring].places(POINT, fine * (COUNT - 1) + 1)
    at = np.minimum(fine * np.arange(COUNT) + round(fine * late), len(places) - 1)
    mounting = Rotation.from_rotvec(np.deg2rad(turn)).as_matrix()
    away = jitter * np.random.default_rng(3).normal(size=(COUNT, 3))
    views = []
    for view, place, off in zip(seen(ring), places[at], away, strict=True):
        rotation = look_at(place, POINT)
        place = place + rotation @ shift + off
        views.append(replace(view, rotation_world_camera=rotation @ mounting, translation_world_camera=place))
    return views


def answer(views):
    """Volume and sigma over the truth, and the notes."""
    found = scan(views, COARSE)
    solid = found.segmented().solid
    return solid.volume / VOLUME, solid.volume_std / VOLUME, "; ".join(found.notes)


@pytest.mark.parametrize("late", [0.5, -0.33])
def test_late_poses_are_corrected_and_the_delay_is_said(late):
    right, _, said = answer(posed("arm"))
    assert "corrected" not in said
    volume, sigma, said = answer(posed("arm", late=late))
    assert volume == pytest.approx(right, abs=0.015)
    assert abs(volume - 1) < 2 * sigma
    assert sigma < 0.05
    assert "late against the poses" in said if late > 0 else "early against the poses" in said
    path = without_shared(posed("arm", late=late), Path.of(posed("arm", late=late), None), None, 1.2)[1]
    assert path.change[0] == pytest.approx(late * PERIOD, abs=2e-3)


def test_a_camera_that_sits_elsewhere_is_corrected_and_said():
    volume, sigma, said = answer(posed("arm", shift=(1e-3, 2.8e-3, 0.0), turn=(0.3, 0.0, -0.4)))
    assert abs(volume - 1) < min(2 * sigma, 0.03)
    assert "the hand-eye transform is not this camera's" in said
    assert "the camera is turned by 0.5 deg" in said
    assert "--delay" not in said


@pytest.mark.parametrize("wrong", [{"late": 0.33}, {"shift": (0.0, 3e-3, 0.0)}, {"shift": (0.0, 0.0, -3e-3)}])
def test_from_one_height_the_volume_is_within_its_uncertainty(wrong):
    volume, sigma, said = answer(posed("turntable", **wrong))
    assert abs(volume - 1) < min(2 * sigma, 0.06)
    assert sigma < 0.12
    assert ("hand-eye transform" in said) == ("shift" in wrong)


def test_the_scale_of_depth_shows_in_the_surface_where_the_table_does_not_show_it():
    longer = rescaled(seen("turntable"), 1 / 1.01 - 1)
    path = Path.of(longer, None)
    assert without_shared(longer, path, None, 1.2)[2] == []  # the table looks flat
    volume, sigma, _ = answer(longer)
    assert abs(volume - 1) < 2 * sigma


def late_sweep(late):
    """A sweep whose images are late, s; the poses of each quarter of a period are known."""
    fine = 4
    places = RINGS["arm"].places(POINT, fine * (COUNT - 1) + 1)

    def poses_at(delay):
        at = fine * np.arange(COUNT) + round(fine * (late - delay) / PERIOD)
        known = (at >= 0) & (at < len(places))
        at = np.clip(at, 0, len(places) - 1)
        rotation = np.array([look_at(place, POINT) for place in places[at]])
        return CameraPoses(rotation, places[at], known, known)

    sweep = Sweep([], "base", poses_at=poses_at, frames=tuple(view.frame for view in seen("arm")))
    return replace(sweep, views=sweep.delayed(0.0))


def test_the_likely_cause_is_a_late_clock_other_poses_or_a_moved_object():
    up = np.array([0.0, 0.0, 1.0])
    assert "+950 ms late" in likely_cause(late_sweep(4 * PERIOD), up, 1.2)
    agreeing = Sweep(list(seen("turntable")), "base")
    assert "the object moved" in likely_cause(agreeing, up, 1.2)
    assert "better about the object with other poses" in likely_cause(agreeing, up, 1.2, poses=True)


def test_a_mounting_that_fits_anything_is_no_cause(monkeypatch):
    sweep = Sweep(posed("arm", turn=(4.0, 0.0, 0.0)), "base")
    up = np.array([0.0, 0.0, 1.0])
    assert "turned by 4.0 deg" in likely_cause(sweep, up, 1.2)
    monkeypatch.setattr(causes, "_TURNED", np.deg2rad(3.0))
    assert likely_cause(sweep, up, 1.2) == ""


def test_views_that_are_off_one_by_one_widen_the_volume():
    right, wrong = answer(posed("arm"))[1], answer(posed("arm", jitter=4e-4))[1]
    assert wrong > 1.1 * right


def test_a_shift_of_all_poses_with_the_table_is_no_doubt():
    """All views shifted down by the same: the surface and the table with them, so that nothing is off."""
    views = [view.moved(np.eye(3), [0.0, 0.0, 5e-3]) for view in seen("arm")]
    found = scan(views, COARSE)
    seen_surface = Surface(found.points[found.seen], None, found.normals[found.seen], np.ones(found.seen.sum()))
    doubt = pose_doubt(views, Path.of(views, None), seen_surface, found.plane, 1.2)
    assert abs(doubt.off) < 5e-5
    assert not doubt.clear


def test_doubt_of_what_was_seen_counts_over_its_whole_area():
    found = scan(seen("arm"), COARSE)
    none, all_of_it = (
        segment(found.points, normals=found.normals, seen=found.seen, doubt=np.where(found.seen, off, 1e-6)).solid
        for off in (0.0, 1e-3)
    )
    area = BRICK[0] * BRICK[1] + 2 * BRICK[2] * (BRICK[0] + BRICK[1])
    assert np.sqrt(all_of_it.volume_std**2 - none.volume_std**2) == pytest.approx(1e-3 * area, rel=0.1)
