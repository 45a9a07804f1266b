"""Solids without the bias of carving, against shapes whose volume and moments are known in closed form."""

import numpy as np
import pytest
import shape_samples as samples

from benchmarks.random_objects import make_composite
from poise.inertia.model.object_shape import parts_of_segmentation, parts_of_solid
from poise.inertia.model.parameters import pseudo_inertia
from poise.shape.carving import carve, spacing_of
from poise.shape.segmentation import segment
from poise.shape.solid import Solid
from poise.shape.unbiased import unbiased
from poise.types import Array

COUNT = 2000


def both(points: Array) -> tuple[Solid, Solid]:
    carved = carve(points)
    return carved, unbiased(carved, np.zeros(len(carved.tetrahedra), dtype=np.int64), spacing_of(points))


def box_inertia(sides: tuple[float, float, float]) -> Array:
    """(3,) m2, of 1 kg about the centre."""
    squares = np.square(sides)
    return np.array([squares[1] + squares[2], squares[0] + squares[2], squares[0] + squares[1]]) / 12


@pytest.mark.parametrize(
    "sides", [(0.1, 0.06, 0.04), (0.2, 0.02, 0.02), (0.3, 0.03, 0.002)], ids=["box", "bar", "ruler"]
)
def test_edges_that_chords_cut_off_come_back(sides: tuple[float, float, float]) -> None:
    """Both the volume and the inertia per kg come nearer to those of the box, over five clouds."""
    off: list[list[float]] = []
    for seed in range(5):
        points = samples.box(np.random.default_rng(seed), sides, COUNT)
        for solid in both(points):
            phi = parts_of_solid(solid).unit_phi[:, 0]
            inertia = np.abs(phi[[4, 7, 9]] / box_inertia(sides) - 1).max()
            off.append([abs(solid.volume / np.prod(sides) - 1), inertia])
    carved, unbiased_solid = np.mean(off[::2], axis=0), np.mean(off[1::2], axis=0)
    assert np.all(unbiased_solid < 0.7 * carved)


@pytest.mark.parametrize("noise", [2e-4, 4e-4])
def test_noise_hardly_thickens(noise: float) -> None:
    """What noise adds to the volume of a sphere, beyond what the same points add without it."""
    added = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        points = samples.sphere(rng, 0.03, COUNT)
        pairs = zip(both(points + rng.normal(0, noise, points.shape)), both(points), strict=True)
        added.append([noisy.volume - clean.volume for noisy, clean in pairs])
    carved, unbiased_solid = np.mean(added, axis=0)
    assert carved > 0.005 * 4 / 3 * np.pi * 0.03**3
    assert abs(unbiased_solid) < 0.4 * carved


def test_flat_ground_stays_flat() -> None:
    sides = (0.1, 0.06, 0.04)
    carved, unbiased_solid = both(samples.box(np.random.default_rng(1), sides, COUNT))
    inside = np.abs(carved.vertices[:, :2]).max(axis=1) < 0.02
    assert inside.sum() > 100
    assert unbiased_solid.vertices[inside, 2] == pytest.approx(carved.vertices[inside, 2], abs=1e-12)


def test_the_volume_is_still_that_inside_the_surface() -> None:
    """By the divergence theorem, whichever tetrahedra the push has turned inside out."""
    _, unbiased_solid = both(samples.torus(np.random.default_rng(2), 0.06, 0.02, COUNT))
    triangles, _ = unbiased_solid.surface
    assert np.any(unbiased_solid.volumes < 0)
    assert np.linalg.det(unbiased_solid.vertices[triangles]).sum() / 6 == pytest.approx(unbiased_solid.volume)


@pytest.mark.parametrize("seed", range(400, 406))
def test_every_part_of_a_random_object_is_a_possible_body(seed: int) -> None:
    made = make_composite(seed, 3e-4)
    parts = parts_of_segmentation(segment(made.points, made.colours))
    assert all(np.linalg.eigvalsh(pseudo_inertia(phi)).min() > 0 for phi in parts.unit_phi.T)


def test_a_part_without_volume_does_not_end_the_segmentation() -> None:
    points = samples.box(np.random.default_rng(1), (0.1, 0.08, 0.06), 400)
    carved = carve(points, spacing_of(points))
    labels = np.zeros(len(carved.tetrahedra), dtype=np.int64)
    labels[0] = 2  # part 1 has no tetrahedron at all
    assert unbiased(carved, labels, spacing_of(points)).volume == pytest.approx(carved.volume, rel=0.2)
