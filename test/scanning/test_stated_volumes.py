"""What is stated of the volume of a sweep is neither too sure nor useless, in two worlds of errors of the depth."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import views_of

from benchmarks.sweep_objects import SPOT, thing
from poise.fake_robots.depth_noise import D435, StereoNoise
from poise.fake_robots.rasteriser import Body, Scene
from poise.scanning import View, scan
from poise.types import Array

SEEDS = (0, 1, 5, 7, 10, 11, 15)
"""Three composites, two L-shapes and two things of pieces: nothing with a hollow that no view sees."""


def stated(noise: StereoNoise, bias: float) -> tuple[Array, Array]:
    """Errors of the volumes, and their stated sigmas, over the true ones; of depth that is too long by a share."""
    rows = []
    for seed in SEEDS:
        made = thing(seed)
        views = views_of(Scene((Body(made.corners, made.colours),), middle=SPOT), 24, (*SPOT, 0.02), noise)
        solid = scan([too_long(view, bias) for view in views]).segmented().solid
        rows.append((solid.volume / made.volume - 1, solid.volume_std / made.volume))
    errors, sigmas = np.array(rows).T
    return errors, sigmas


def too_long(view: View, share: float) -> View:
    depth = (view.frame.depth * np.float32(1 + share)).astype(np.float32)
    return replace(view, frame=replace(view.frame, depth=depth))


@pytest.mark.parametrize(
    ("noise", "bias"),
    [
        (D435, 0.0),  # as the constants were fitted
        (replace(D435, smear=2.5, step=3e-3), 0.007),  # alike over many pixels, in coarse steps, of a wrong scale
    ],
)
def test_the_truth_is_within_two_sigma_of_a_useful_statement(noise: StereoNoise, bias: float) -> None:
    errors, sigmas = stated(noise, bias)
    off = np.sort(np.abs(errors) / sigmas)
    assert off[-1] < 3
    assert off[-2] < 2
    assert np.median(sigmas) < 0.08
