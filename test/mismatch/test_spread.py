"""Standard deviations of parameters, where the model of the data is right and where it is not."""

import numpy as np
import pytest
from cases import make_case

from poise.mismatch.answer import covariances, quantities
from poise.mismatch.effects import effect_named
from poise.mismatch.inference import FittedEffect, fit, wrench_problem
from poise.mismatch.inference.evidence import WhitenedRegression
from poise.mismatch.reading import NominalModel
from poise.types import Array

_SAMPLES = 600


def regression(target: Array, columns: Array, channels: int = 2) -> WhitenedRegression:
    count = len(columns)
    return WhitenedRegression(
        (columns[:1], columns[1:]), np.full(count, 1e-9), np.zeros(count), target, channels=channels
    )


def motion(rng: np.random.Generator) -> Array:
    """(2, R) columns of a motion in two channels."""
    seconds = np.linspace(0.0, 20.0, _SAMPLES)
    frequencies, phases = rng.uniform(0.3, 1.5, (2, 2, 1)), rng.uniform(0.0, 6.0, (2, 2, 1))
    return np.asarray(np.sin(2.0 * np.pi * frequencies * seconds + phases)).reshape(2, -1)


def noise(rng: np.random.Generator, family: str) -> Array:
    white = rng.normal(size=(2, _SAMPLES))
    if family == "white":
        return white.ravel()
    coloured = np.zeros_like(white)
    for i in range(1, _SAMPLES):  # which the regression takes as white
        coloured[:, i] = 0.95 * coloured[:, i - 1] + np.sqrt(1.0 - 0.95**2) * white[:, i]
    return coloured.ravel()


@pytest.mark.parametrize(("family", "least", "most"), [("white", 0.9, 1.15), ("coloured", 1.7, 2.5)])
def test_a_parameter_is_as_uncertain_as_the_residual_shows(family: str, least: float, most: float) -> None:
    """In units of the spread, errors under either noise have the size of a normal deviate."""
    stated, shown = [], []
    for seed in range(150):
        rng = np.random.default_rng([17, seed])
        columns, truth = motion(rng), np.array([1.0, -0.5])
        known = regression(truth @ columns + noise(rng, family), columns)
        error = known.coefficients() - truth
        stated.extend(error / np.sqrt(np.diag(known.covariance())))
        shown.extend(error / known.spread)
    assert least < np.sqrt(np.mean(np.square(stated))) < most
    assert 0.8 < np.sqrt(np.mean(np.square(shown))) < 1.3


def test_the_spread_is_never_less_than_the_noise_allows() -> None:
    rng = np.random.default_rng(5)
    columns = motion(rng)
    known = regression(columns[0] + 1e-3 * noise(rng, "white"), columns)
    np.testing.assert_allclose(known.spread, np.sqrt(np.diag(known.covariance())))


def test_the_gap_of_a_loose_part_is_no_better_known_than_the_law_of_its_stops() -> None:
    loose = effect_named("loose_part")
    assert loose is not None
    recorded = make_case(3, duration=8.0).recorded()
    problem = wrench_problem(recorded, NominalModel(phi=recorded.phi))
    stated = {"gap": 0.012, "friction": 0.02, "mass": 0.3, "settling": 0.004, "z": 0.1}
    values = {p.name: stated.get(p.name, 0.1) for p in loose.parameters(problem.recorded)}
    found = fit(problem, [FittedEffect(loose, values)], 0)
    inputs = problem.compose(found.parts)[0]
    said = quantities(found.parts[0], inputs[0], covariances(found, inputs)[0])
    assert said["gap"].std >= 0.05 * said["gap"].value
    assert said["mass"].std >= 0.25 * said["mass"].value
    assert said["axis_x"].std > 0.0
