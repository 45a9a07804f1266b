"""What colours say about densities: parts that look alike are expected to be alike, and forces may still object."""

from dataclasses import replace

import numpy as np
import pytest
from problems import EXACT, problem_of

from poise.errors import InputError
from poise.inertia.bayes.estimator import PoiseEstimator
from poise.inertia.bayes.hypotheses import hypotheses_for_shape
from poise.inertia.bayes.mass_model import MassModel
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


def inertia_of(
    parts: Parts, densities: np.ndarray, given: Parts, liveliness: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimated (at rest) and true inertia tensors, and the standard deviations of the first's entries in phi."""
    truth = InertialParameters.from_phi(parts.unit_phi @ (densities * parts.volumes))
    problem = problem_of(truth, np.random.default_rng(0), 40, liveliness=liveliness, noise=EXACT, wrench_noise=1.0)
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


def test_parts_of_one_colour_may_each_have_a_density_of_their_own() -> None:
    """A cube has three times the density of those of its colour: motion shows it, and rest does not exclude it."""
    parts = blocks()
    densities = np.where(COLOURS[:, 0] > 0.6, 1000.0, 2000.0)
    densities[np.argmin(COLOURS[:, 0])] *= 3
    alike = replace(parts, likeness=likeness_of_colours(COLOURS))
    for liveliness, close in ((1.0, 0.02), (0.0, 0.3)):
        found, truth, sigmas = inertia_of(parts, densities, alike, liveliness)
        assert np.linalg.norm(found - truth) < close * np.linalg.norm(truth)
        assert np.all(np.abs(np.diag(found - truth)) < 3 * sigmas[[0, 3, 5]])


def test_densities_are_of_one_colour_or_their_own_only_where_some_are_alike() -> None:
    parts, noise = blocks(), EXACT
    for likeness, kinds in ((None, 2), (np.eye(9), 2), (likeness_of_colours(COLOURS), 4)):
        model = MassModel.of_parts(parts.unit_phi, parts.volumes, likeness)
        cases = hypotheses_for_shape(model, 0.001, 0.0, noise)
        assert len(cases) == 9 * kinds
        assert np.exp(cases.log_probability).sum() == pytest.approx(1.0)
        assert np.all(cases.twins[9:] == np.arange(9, len(cases)))
    axes = model.likeness_axes[1]
    own, one, given = (axes * cases.state_variances[9 * kind, :9] @ axes.T for kind in (1, 2, 3))
    np.testing.assert_allclose(own, np.eye(9), atol=1e-9)
    np.testing.assert_allclose(given, likeness_of_colours(COLOURS), atol=1e-9)
    assert one[0, 3] == pytest.approx(1 - (1 - SAME_DENSITY) / 100)
