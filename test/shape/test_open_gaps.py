"""Gaps that are narrower than the ball, and openings and holes that a ball comes in through, against closed forms."""

import numpy as np
import pytest
import shape_samples as samples

from poise.shape.gaps import without_gaps
from poise.shape.reconstruction import reconstruct

WANTED = 2500
SIDES, GAP, CELL = (0.03, 0.03, 0.01), 2.5e-3, 2e-3
RADIUS, INNER = 0.013, 0.010


def jaws(noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Two slabs with a gap between, of points 1.5 mm apart with noise, m; and places in the gap, on a grid."""
    rng = np.random.default_rng(0)
    points = np.concatenate([samples.box(rng, SIDES, 1400, np.array([0, 0, z])) for z in (0.0, SIDES[2] + GAP)])
    level = np.arange(-0.0145, 0.015, CELL)
    air = np.stack(np.meshgrid(level, level, [(SIDES[2] + GAP) / 2]), axis=-1).reshape(-1, 3)
    return points + noise * rng.normal(size=points.shape), air


def test_a_gap_that_views_see_through_is_open() -> None:
    points, air = jaws(4e-4)
    filled, opened = (reconstruct(points, WANTED, air=places).solid.volume for places in (None, air))
    true, gap = 2 * np.prod(SIDES), SIDES[0] * SIDES[1] * GAP
    assert filled > true + 0.6 * gap
    assert opened == pytest.approx(true, rel=0.03)


def test_air_over_a_plate_takes_nothing_of_it() -> None:
    rng = np.random.default_rng(0)
    points = samples.box(rng, (0.06, 0.06, 0.0015), 2500)
    solid = reconstruct(points, WANTED).carved
    level = np.arange(-0.03, 0.03, CELL)
    over = np.stack(np.meshgrid(level, level, [0.75e-3 + 0.8e-3]), axis=-1).reshape(-1, 3)
    assert without_gaps(solid, over).volume > 0.99 * solid.volume
    assert without_gaps(solid, over + 0.1) is solid


def outward(points: np.ndarray) -> np.ndarray:
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def without_cap(points: np.ndarray, normals: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Those whose direction is not within an angle of the x axis, with noise of 0.2 mm."""
    kept = np.arccos(outward(points)[:, 0]) > angle
    points, normals = points[kept], normals[kept]
    return points + 2e-4 * normals * np.random.default_rng(3).normal(size=(len(points), 1)), normals


def test_normals_tell_a_hole_in_the_sampling_from_an_opening() -> None:
    """What a ball finds behind it is the object where the walls around face away, and a cavity where they face it."""
    rng = np.random.default_rng(0)
    ball = samples.sphere(rng, RADIUS, 1500)
    points, normals = without_cap(ball, outward(ball), 0.3)
    full = 4 / 3 * np.pi * RADIUS**3
    assert reconstruct(points, WANTED).solid.volume < 0.5 * full
    found = reconstruct(points, WANTED, normals=normals).solid
    assert found.volume == pytest.approx(full, rel=0.03)
    assert found.volume_std < 0.05 * full
    both = np.concatenate([ball, samples.sphere(rng, INNER, 900)])
    points, normals = without_cap(both, outward(both) * np.repeat([1, -1], [1500, 900])[:, None], 0.4)
    vase = 2 / 3 * np.pi * (RADIUS**3 - INNER**3) * (1 + np.cos(0.4))
    assert reconstruct(points, WANTED, normals=normals).solid.volume == pytest.approx(vase, rel=0.05)
