"""The compiled search through hypotheses against its form in Python, with bad input, and with rounding errors."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest
from problems import AT, BOX, EXACT, box_body, problem_of

from poise.errors import InputError
from poise.inertia.bayes import averaging, curvature, sensor_bias
from poise.inertia.bayes.averaging import ModelAverage, SolverEffort
from poise.inertia.bayes.estimator import PoiseEstimator
from poise.inertia.bayes.first_guess import states_of_shape
from poise.inertia.bayes.hypotheses import hypotheses_for_shape
from poise.inertia.bayes.mass_model import MassModel
from poise.inertia.bayes.sensor_bias import WithoutBias
from poise.inertia.model import NoiseLevels, NormalEquations, Parts, signals
from poise.inertia.model.parts import box_moments
from poise.kernels import CompiledHypotheses, bias_taken_out, evidence, sums_likelihood, weighed_sums

MODULES: tuple[ModuleType, ...] = (averaging, sensor_bias, signals)
NOISE = NoiseLevels(0.1, 0.005, 0.05, 0.5)
EFFORT = SolverEffort(0.003, 25, 1e-4)


def compiled(monkeypatch: pytest.MonkeyPatch, whether: bool) -> None:
    for module in MODULES:
        monkeypatch.setattr(module, "COMPILED", whether)


def parts(alike: bool = False) -> Parts:
    """Six boxes in a row."""
    places = np.array(AT) + BOX * np.linspace(-0.4, 0.4, 6)[:, None] * [1.0, 0.0, 0.0]
    found = Parts.from_moments(box_moments(places, np.tile(BOX / 6, (6, 1))), np.arange(6), places)
    likeness = 0.3 * np.eye(6) + 0.7 if alike else None
    return Parts(found.unit_phi, found.volumes, found.points, likeness)


def sums(rng: np.random.Generator, count: int = 5) -> np.ndarray:
    """(count, 19, 19) over ten samples of signals each."""
    rows = rng.normal(size=(count, 30, signals.N_SIGNALS))
    rows[..., signals.N_MOTION - 1] = 1.0
    return rows.swapaxes(1, 2) @ rows


@pytest.mark.parametrize("shape", ["unknown", "parts", "alike parts"])
def test_the_search_finds_the_same(shape: str, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_of(box_body(), np.random.default_rng(4), 60, noise=NOISE, wrench_noise=1.0)
    given = None if shape == "unknown" else parts(shape == "alike parts")
    found = []
    for whether in (True, False):
        compiled(monkeypatch, whether)
        estimator = PoiseEstimator(given, problem.noise)
        estimator.add_problem(problem)
        found.append(estimator.solve())
    one, other = found
    sigmas = np.sqrt(np.diag(other.covariance))
    np.testing.assert_allclose(one.phi / sigmas, other.phi / sigmas, atol=1e-8, rtol=0)
    unit = np.outer(sigmas, sigmas)
    np.testing.assert_allclose(one.covariance / unit, other.covariance / unit, atol=1e-6, rtol=0)
    np.testing.assert_allclose([one.delay, one.delay_std], [other.delay, other.delay_std], rtol=1e-7)


def test_sums_are_weighed_as_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    moments, unknowns = sums(rng), rng.normal(size=(5, 16))
    spread = rng.random((3, 6))
    covariance = signals.residual_covariance(unknowns[0, :10], NOISE)
    cases: list[Any] = []
    for whether in (True, False):
        compiled(monkeypatch, whether)
        many = signals.normal_equations(moments, np.full(5, 29.5), covariance, NOISE)
        quiet = signals.normal_equations(moments[0], 30.0, np.diag(NOISE.wrench**2), EXACT)
        bias = WithoutBias.of(NormalEquations(many.information[:3], many.vector[:3]), spread)
        likelihoods = [signals.log_likelihood(each, unknowns, NOISE, (1.0, 2.0)) for each in (moments, moments[1])]
        cases.append((many.information, many.vector, quiet.information, quiet.vector, *likelihoods))
        cases[-1] += tuple(getattr(bias, name) for name in vars(bias))
    for one, other in zip(*cases, strict=True):
        assert one.shape == other.shape
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10 * np.abs(other).max())


def average(alike: bool) -> tuple[ModelAverage, NormalEquations]:
    """About a body that moved in one plane only, and its normal equations in the sensor frame."""
    given = parts(alike)
    model = MassModel.of_parts(given.unit_phi, given.volumes, given.likeness)
    problem = problem_of(box_body(), np.random.default_rng(2), 40, liveliness=0.0, noise=NOISE)
    design = np.concatenate([problem.regressor, np.broadcast_to(np.eye(6), (40, 6, 6))], axis=2).reshape(-1, 16)
    weights = np.tile(NOISE.wrench**-2.0, 40)
    normal = NormalEquations((design.T * weights) @ design, (design.T * weights) @ problem.wrench.ravel())
    hypotheses = hypotheses_for_shape(model, 0.02, 1e-5, NOISE)
    return ModelAverage(model, hypotheses, states_of_shape(model, normal, hypotheses.bias_variances)), normal


@pytest.mark.parametrize("alike", [False, True])
def test_hypotheses_are_solved_as_in_python(alike: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[Any] = []
    for whether in (True, False):
        compiled(monkeypatch, whether)
        asked, normal = average(alike)
        stack = NormalEquations(np.tile(normal.information, (3, 1, 1)), np.tile(normal.vector, (3, 1)))
        posterior = asked.refine(stack, lambda unknowns, cases: np.zeros(len(cases)), EFFORT)
        curved = asked.with_curvature()
        found.append((posterior.states, posterior.log_weights, *asked.along(stack, posterior), curved.covariance))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-8 * np.abs(other).max())


@pytest.mark.parametrize("whether", [True, False])
def test_a_covariance_does_not_depend_on_rounding(whether: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sensor at rest shows four numbers of ten: which directions the others have is not for rounding to decide."""
    compiled(monkeypatch, whether)
    rng, covariances = np.random.default_rng(5), []
    for _ in range(3):
        asked, normal = average(False)
        noise = 1e-15 * rng.normal(size=(16, 16))
        stack = NormalEquations(
            np.tile(normal.information * (1 + noise + noise.T), (3, 1, 1)), np.tile(normal.vector, (3, 1))
        )
        asked.refine(stack, lambda unknowns, cases: np.zeros(len(cases)), EFFORT)
        covariances.append(asked.with_curvature().covariance)
    sigmas = np.sqrt(np.diag(covariances[0]).clip(min=1e-300))
    for covariance in covariances[1:]:
        np.testing.assert_allclose((covariance - covariances[0]) / np.outer(sigmas, sigmas), 0.0, atol=1e-5)


def test_other_shapes_and_cases_are_refused_and_no_numbers_pass() -> None:
    kernel = average(False)[0]._kernel
    assert isinstance(kernel, CompiledHypotheses)
    n, one = 15, np.zeros(2, dtype=np.int64)
    states, variances, information, vector = np.zeros((2, n)), np.ones((2, n)), np.eye(10)[None], np.ones((1, 10))
    for given in ((states[:, 1:], variances), (states, variances[:1]), (states[0], variances)):
        with pytest.raises(InputError):
            kernel.narrowed(*given, one, information)
    for cases in (one + 1, one - 1, one[:1]):
        with pytest.raises(IndexError):
            kernel.climb(states, variances, cases, information, vector, 0.1, 5)
    with pytest.raises(InputError):
        kernel.climb(states, variances, one, information, vector[:, 1:], 0.1, 5)
    moved = kernel.climb(states[:, ::-1], variances, one, np.full((1, 10, 10), np.nan), vector, 0.1, 5)
    assert not np.isfinite(moved[1]).all() or (moved[1] == 0).all()
    assert kernel.climb(states[:0], variances[:0], one[:0], information, vector, 0.1, 5)[0].shape == (0, n)
    with pytest.raises(np.linalg.LinAlgError):
        kernel.narrowed(states, variances, one, np.full((1, 10, 10), np.nan))
    with pytest.raises(InputError):
        evidence(np.zeros((3, 16, 16)), np.zeros((2, 16)), np.zeros((1, 16, 16)), np.zeros((1, 16)))
    with pytest.raises(InputError):
        bias_taken_out(np.zeros((3, 16, 16)), np.zeros((3, 16)), np.zeros((1, 6)))
    with pytest.raises(np.linalg.LinAlgError):
        weighed_sums(np.zeros((1, 19, 19)), np.ones(1), -np.eye(6), 1.0, signals.ENTRIES)
    with pytest.raises(IndexError):
        sums_likelihood(np.zeros((1, 19, 19)), one + 1, np.zeros((2, 16)), signals.ENTRIES, np.ones(6), np.ones(2))


def test_a_basis_of_what_is_not_seen_spans_the_same() -> None:
    rng = np.random.default_rng(6)
    vectors = np.linalg.qr(rng.normal(size=(8, 8)))[0]
    values = np.array([1.0, 1.0, 1.0, 1.0, 2.0, 5.0, 9.0, 1e6])
    turned = vectors.copy()
    turned[:, :4] = vectors[:, :4] @ np.linalg.qr(rng.normal(size=(4, 4)))[0]
    bases = [vectors.copy(), turned]
    for basis in bases:
        curvature._settle(values, basis)
        np.testing.assert_allclose(basis[:, :4] @ basis[:, :4].T, vectors[:, :4] @ vectors[:, :4].T, atol=1e-12)
        np.testing.assert_array_equal(basis[:, 4:], vectors[:, 4:])
    np.testing.assert_allclose(np.abs(bases[0].T @ bases[1]), np.eye(8), atol=1e-9)
