"""What colours say about densities: parts that look alike are expected to be alike, and forces may still object."""

from dataclasses import replace

import numpy as np
import pytest
from problems import EXACT, problem_of

from poise.errors import InputError
from poise.inertia.bayes.estimator import PoiseEstimator
from poise.inertia.model.parameters import InertialParameters
from poise.inertia.model.parts import SAME_DENSITY, Parts, box_moments, likeness_of_colours

GREY, RED = (0.5, 0.5, 0.5), (0.8, 0.1, 0.1)
COLOURS = np.array([GREY, RED, RED, GREY, RED, GREY, GREY, RED, RED])
SIDE = 0.03


def blocks() -> Parts:
    """Nine cubes on a plate-like grid, which a sensor at rest is far from distinguishing."""
    places = np.array([[x, y, 0.01 * x * y] for x in (-1, 0, 1) for y in (-1, 0, 1)]) * SIDE + [0.02, 0.01, 0.1]
    moments = box_moments(places, np.full((9, 3), SIDE))
    return Parts.from_moments(moments, np.arange(9), np.concatenate([places - SIDE / 2, places + SIDE / 2]))


def inertia_of(parts: Parts, densities: np.ndarray, given: Parts) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimated at rest and true inertia tensors, and the standard deviations of the first's entries in phi."""
    truth = InertialParameters.from_phi(parts.unit_phi @ (densities * parts.volumes))
    problem = problem_of(truth, np.random.default_rng(0), 40, liveliness=0.0, noise=EXACT, wrench_noise=1.0)
    estimator = PoiseEstimator(given, problem.noise, longest_delay=0.0)
    estimator.add_problem(problem)
    found = estimator.solve()
    return found.parameters.inertia, truth.inertia, np.sqrt(np.diag(found.covariance))[4:]


def test_colours_that_are_alike_correlate_and_one_colour_tells_nothing() -> None:
    likeness = likeness_of_colours(COLOURS)
    assert likeness is not None
    assert likeness[0, 3] == pytest.approx(SAME_DENSITY)
    assert likeness[0, 1] < 0.01
    np.testing.assert_array_equal(np.diag(likeness), 1)
    assert np.linalg.eigvalsh(likeness).min() > 0
    assert likeness_of_colours(np.tile(GREY, (4, 1))) is None
    assert likeness_of_colours(np.full((4, 3), np.nan)) is None


def test_nothing_in_common_is_the_same_as_not_told() -> None:
    parts, densities = blocks(), np.linspace(1000, 3000, 9)
    plain = inertia_of(parts, densities, parts)[0]
    given_alike = inertia_of(parts, densities, replace(parts, likeness=np.eye(9)))[0]
    np.testing.assert_allclose(given_alike, plain, rtol=1e-6)


def test_colours_show_what_forces_at_rest_do_not() -> None:
    parts = blocks()
    densities = np.where(COLOURS[:, 0] > 0.6, 1000.0, 7800.0)
    found, truth, _ = inertia_of(parts, densities, replace(parts, likeness=likeness_of_colours(COLOURS)))
    blind = inertia_of(parts, densities, parts)[0]
    assert np.linalg.norm(found - truth) < 0.3 * np.linalg.norm(blind - truth)
    assert np.linalg.norm(found - truth) < 0.02 * np.linalg.norm(truth)


def test_likeness_follows_the_parts_into_another_frame_and_has_to_fit_them() -> None:
    parts = replace(blocks(), likeness=likeness_of_colours(COLOURS))
    moved = parts.in_frame(np.eye(3), [0.1, 0.0, 0.0])
    np.testing.assert_array_equal(moved.likeness, parts.likeness)
    with pytest.raises(InputError, match=r"likeness has shape \(2, 2\), expected \(9, 9\)"):
        replace(parts, likeness=np.eye(2))


@pytest.mark.parametrize("scale", [1 + 1e-15, 1 - 1e-15])
def test_an_answer_at_rest_does_not_depend_on_rounding(scale: float) -> None:
    """The weight is known to 1e-5 and the inertia not at all: the one must not be lost in the rounding of the other."""
    parts = blocks()
    densities = np.where(COLOURS[:, 0] > 0.6, 1000.0, 7800.0)
    alike = replace(parts, likeness=likeness_of_colours(COLOURS))
    found = inertia_of(parts, densities, alike)[0]
    moved = replace(alike, unit_phi=parts.unit_phi * scale)
    np.testing.assert_allclose(inertia_of(parts, densities, moved)[0], found, rtol=0, atol=1e-6 * np.abs(found).max())
