"""Parts of a scan are of materials that exist; where that is false the samples decide, and nothing is said of CAD."""

from dataclasses import replace

import numpy as np
import pytest
from problems import EXACT, problem_of

from poise.inertia.bayes.estimator import BayesSolution, PoiseEstimator
from poise.inertia.bayes.hypotheses import hypotheses_for_shape
from poise.inertia.bayes.mass_model import N_DEFORMATIONS, MassModel
from poise.inertia.bayes.materials import Materials
from poise.inertia.bayes.small_systems import normalised
from poise.inertia.model import NoiseLevels
from poise.inertia.model.parameters import InertialParameters
from poise.inertia.model.parts import Parts, box_moments

SCANNED, FROM_CAD = 0.012, 0.0007
STEEL, WOOD = 7850.0, 700.0
NOISY, FAIR = NoiseLevels(force=0.1, torque=0.01), NoiseLevels(force=0.03, torque=0.003)


def hammer(count: int = 3) -> Parts:
    """A handle along x and a head across its end, then more cubes; no two are alike."""
    centres = np.array([[0.0, 0.0, 0.1], [0.12, 0.0, 0.1], [0.0, 0.03, 0.1], [0.05, 0.0, 0.14], [-0.1, 0.02, 0.12]])
    sides = np.array([[0.24, 0.03, 0.02], [0.03, 0.09, 0.03], *[[0.02] * 3] * 3])
    corners = np.concatenate([centres - sides / 2, centres + sides / 2])
    return Parts.from_moments(box_moments(centres[:count], sides[:count]), np.arange(count), corners)


def solved(
    parts: Parts, densities: list[float], given: Parts, seed: int = 0, lively: float = 0.0, noise: NoiseLevels = NOISY
) -> BayesSolution:
    """What the estimator makes of a scan with the given parts."""
    problem = problem_of(true_body(parts, densities), np.random.default_rng(seed), 40, lively, noise, 1.0)
    estimator = PoiseEstimator(given, noise, longest_delay=0.0, shape_accuracy=SCANNED)
    estimator.add_problem(problem)
    return estimator.solve()


def true_body(parts: Parts, densities: list[float]) -> InertialParameters:
    return InertialParameters.from_phi(parts.unit_phi @ (np.array(densities) * parts.volumes))


def error_of(found: BayesSolution, parts: Parts, densities: list[float]) -> float:
    """Of the inertia, relative."""
    truth = true_body(parts, densities).inertia
    return float(np.linalg.norm(found.parameters.inertia - truth) / np.linalg.norm(truth))


def with_volumes(parts: Parts, factor: float) -> Parts:
    return replace(parts, volumes=factor * parts.volumes)


def test_the_mean_is_that_of_bodies_drawn_from_the_prior_and_weighted_by_the_samples() -> None:
    parts, rng = hammer(2), np.random.default_rng(0)
    model = MassModel.of_parts(parts.unit_phi, parts.volumes)
    prior = Materials.of(model, SCANNED)
    assert prior is not None
    variances = np.full(N_DEFORMATIONS, 0.01**2)
    truth = np.linalg.solve(model.to_sensor, true_body(parts, [WOOD, STEEL]).phi)
    spread = truth[0] * np.array([0.05, 0.1, 0.1, 0.1])
    information = np.diag(np.append(1 / spread**2, np.zeros(6)))
    likely = prior.likely(model.shares, float(truth[0]))
    assert likely is not None
    phi, log = likely.bodies(model.evaluate, (information, information @ truth), variances)

    cases = rng.choice(len(prior.means), 100_000, p=np.exp(prior.log_probability) / np.exp(prior.log_probability).sum())
    roots = np.linalg.cholesky(prior.covariances)[cases]
    drawn = prior.means[cases] + (roots @ rng.normal(size=(len(cases), 2, 1)))[..., 0]
    states = np.concatenate([drawn, np.sqrt(variances) * rng.normal(size=(len(cases), N_DEFORMATIONS))], axis=1)
    bodies = model.evaluate(states)[0]
    weights = np.exp(-(((bodies - truth)[:, :4] / spread) ** 2).sum(axis=1) / 2)
    assert weights.sum() ** 2 / np.sum(weights**2) > 1000
    chances = normalised(log)
    np.testing.assert_allclose(chances @ phi, weights @ bodies / weights.sum(), rtol=0, atol=0.02 * truth[0])


def test_noise_at_rest_is_followed_less_than_with_volumes_in_another_unit() -> None:
    """A density of 1e-9 is of no material, so that it says nothing, and the answer is as good as without."""
    parts, densities = hammer(), [WOOD, STEEL, 1100.0]
    errors = {
        factor: np.array(
            [
                error_of(solved(parts, densities, with_volumes(parts, factor), seed), parts, densities)
                for seed in range(12)
            ]
        )
        for factor in (1.0, 1e9)
    }
    assert errors[1.0].mean() < 0.9 * errors[1e9].mean()
    assert errors[1e9].max() < 0.03


@pytest.mark.parametrize("densities", [[300.0, 15000.0, 50.0], [19300.0, 150.0, 4500.0], [WOOD, STEEL, 2700.0]])
def test_motion_shows_densities_of_any_size(densities: list[float]) -> None:
    parts = hammer()
    found = solved(parts, densities, parts, lively=3.0)
    off = np.abs(found.phi - true_body(parts, densities).phi)
    assert np.all(off < 4 * np.sqrt(np.diag(found.covariance)))
    assert error_of(found, parts, densities) < 0.05


def test_at_rest_the_covariance_holds_for_densities_of_no_material() -> None:
    parts, scores = hammer(), []
    for seed, densities in enumerate(([300.0, 15000.0, 50.0], [4500.0, 4500.0, 300.0], [150.0, 1500.0, 19300.0])):
        found = solved(parts, densities, parts, seed)
        off = found.phi - true_body(parts, densities).phi
        scores.append(off @ np.linalg.solve(found.covariance, off) / 10)
    assert np.mean(scores) < 1.5


def test_a_solid_that_is_too_light_for_anything_is_hollow() -> None:
    """A box open below of which a scan did not see the inside; the same with an inside of plastic is no hollow."""
    outer = box_moments(np.array([[0.0, 0.0, 0.1]]), np.array([[0.1, 0.07, 0.06]]))[0]
    inner = box_moments(np.array([[0.0, 0.0, 0.098]]), np.array([[0.096, 0.066, 0.056]]))[0]
    parts = Parts.from_moments([outer - inner, inner], [0, 1], np.zeros((1, 3)))
    hollow, full = [1200.0, 1.0], [1200.0, 1200.0]
    for noise, factor, densities, least, most in (
        (FAIR, 1.0, hollow, 0.0, 0.03),
        (FAIR, 1e9, hollow, 0.03, 0.1),
        (FAIR, 1.0, full, 0.0, 0.01),
        (EXACT, 1.0, hollow, 0.0, 0.01),
    ):
        given = with_volumes(parts, factor)
        errors = [error_of(solved(parts, densities, given, seed, noise=noise), parts, densities) for seed in range(8)]
        assert least <= np.mean(errors) < most


def test_nothing_is_said_of_bodies_from_cad_of_one_part_and_of_many_colours() -> None:
    for count, accuracy, known in ((2, SCANNED, True), (2, FROM_CAD, False), (1, SCANNED, False), (5, SCANNED, False)):
        parts = hammer(count)
        model = MassModel.of_parts(parts.unit_phi, parts.volumes)
        assert (hypotheses_for_shape(model, accuracy, 0.0, EXACT).materials is not None) == known
    alike = replace(hammer(5), likeness=0.98 + 0.02 * np.eye(5))
    model = MassModel.of_parts(alike.unit_phi, alike.volumes, alike.likeness)
    prior = Materials.of(model, SCANNED)
    assert prior is not None
    light = prior.likely(model.shares, 1000.0 * model.volume)
    assert light is not None
    assert len(light.means) < len(prior.means)
    assert prior.likely(model.shares, 1e-3 * model.volume) is None
    assert np.all(np.linalg.eigvalsh(prior.covariances) > 0)
