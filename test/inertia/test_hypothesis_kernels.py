"""The compiled search through hypotheses against its form in Python, with bad input, and with rounding errors."""

from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from problems import AT, BOX, EXACT, box_body, problem_of, wild_problem

from poise.errors import InputError
from poise.inertia.bayes import averaging, curvature
from poise.inertia.bayes.estimator import PoiseEstimator
from poise.inertia.bayes.search import PosteriorSearch
from poise.inertia.model import IdentificationProblem, NoiseLevels, Parts, signals
from poise.inertia.model.parts import box_moments
from poise.kernels import CompiledSearch, weighed_sums

MODULES: tuple[ModuleType, ...] = (averaging, signals)
NOISE = NoiseLevels(0.1, 0.005, 0.05, 0.5)


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


def solved(given: Parts | None, problem: IdentificationProblem, **options: Any) -> list[tuple[PosteriorSearch, Any]]:
    """The search and the solution, compiled and in Python."""
    found: list[tuple[PosteriorSearch, Any]] = []
    for whether in (True, False):
        with pytest.MonkeyPatch.context() as patch:
            compiled(patch, whether)
            estimator = PoiseEstimator(given, problem.noise, **options)
            estimator.add_problem(problem)
            solution = estimator.solve()
            assert estimator._search is not None
            found.append((estimator._search, solution))
    return found


def same_answers(found: list[tuple[PosteriorSearch, Any]], phi: float, covariance: float) -> None:
    """Within so many sigmas, and variances."""
    (_, one), (_, other) = found
    sigmas = np.sqrt(np.diag(other.covariance))
    np.testing.assert_allclose(one.phi / sigmas, other.phi / sigmas, atol=phi, rtol=0)
    unit = np.outer(sigmas, sigmas)
    np.testing.assert_allclose(one.covariance / unit, other.covariance / unit, atol=covariance, rtol=0)
    assert [finding.code for finding in one.findings] == [finding.code for finding in other.findings]


@pytest.mark.parametrize("shape", ["unknown", "parts", "alike parts"])
@pytest.mark.parametrize("trouble", ["none", "noise", "slow errors", "contact", "bias", "one lag"])
def test_the_search_finds_the_same(shape: str, trouble: str) -> None:
    rng = np.random.default_rng(4)
    count = 60 if trouble == "none" else 400
    bias = np.array([4.0, -2.0, 9.0, 0.1, 0.3, -0.2]) if trouble == "bias" else None
    level = 1.4 if trouble == "noise" else 1.0
    problem = problem_of(box_body(), rng, count, noise=NOISE, wrench_noise=level, bias=bias)
    wrench = problem.wrench
    if trouble == "slow errors":
        wrench = wrench + NOISE.wrench * np.repeat(rng.normal(size=(count // 20, 6)), 20, axis=0)
    if trouble == "contact":
        wrench = wrench + np.outer(np.arange(count) // 60 == 2, [5.0, 0.0, 3.0, 0.0, 0.2, 0.0])
    given = None if shape == "unknown" else parts(shape == "alike parts")
    options = {"longest_delay": 0.0} if trouble == "one lag" else {}
    found = solved(given, replace(problem, wrench=wrench), **options)
    same_answers(found, 1e-7, 1e-6)
    (one, first), (other, second) = found
    np.testing.assert_allclose([first.delay, first.delay_std], [second.delay, second.delay_std], rtol=1e-6)
    for name in ("left", "weights", "states"):
        ours, theirs = (getattr(each.posterior, name) for each in (one, other))
        np.testing.assert_allclose(ours, theirs, atol=1e-6)
    np.testing.assert_array_equal(one.keep, other.keep)
    np.testing.assert_allclose(one.slow, other.slow, rtol=1e-8)
    for name, theirs in vars(other.found).items():
        np.testing.assert_allclose(getattr(one.found, name), theirs, rtol=1e-6, atol=1e-7 * np.abs(theirs).max())
    assert (trouble == "contact") == (not one.keep.all())
    assert (trouble == "slow errors") == bool((one.slow > 1).all())


def test_the_search_finds_the_same_whatever_is_asked() -> None:
    for seed in range(25):
        problem = wild_problem(np.random.default_rng(seed))
        if len(problem) < 3:
            continue
        assert problem.unit_parts is not None
        assert problem.part_volumes is not None
        for given in (None, Parts(problem.unit_parts, problem.part_volumes, np.zeros((0, 3)))):
            same_answers(solved(given, problem), 0.03, 0.03)  # where a search stops depends on rounding


def test_sums_are_weighed_as_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    moments, unknowns = sums(rng), rng.normal(size=16)
    covariance = signals.residual_covariance(unknowns[:10], NOISE)
    cases: list[Any] = []
    for whether in (True, False):
        compiled(monkeypatch, whether)
        many = signals.normal_equations(moments, np.full(5, 29.5), covariance, NOISE)
        quiet = signals.normal_equations(moments[0], 30.0, np.diag(NOISE.wrench**2), EXACT)
        cases.append((many.information, many.vector, quiet.information, quiet.vector))
    for one, other in zip(*cases, strict=True):
        assert one.shape == other.shape
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10 * np.abs(other).max())


@pytest.mark.parametrize("whether", [True, False])
def test_a_covariance_does_not_depend_on_rounding(whether: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sensor at rest shows four numbers of ten: which directions the others have is not for rounding to decide."""
    compiled(monkeypatch, whether)
    rng, covariances = np.random.default_rng(5), []
    problem = problem_of(box_body(), np.random.default_rng(2), 40, liveliness=0.0, noise=NOISE)
    for _ in range(3):
        estimator = PoiseEstimator(parts(), NOISE, shape_accuracy=0.02)
        wrench = problem.wrench * (1 + 1e-15 * rng.normal(size=problem.wrench.shape))
        estimator.add_problem(replace(problem, wrench=wrench))
        covariances.append(estimator.solve().covariance)
    sigmas = np.sqrt(np.diag(covariances[0]).clip(min=1e-300))
    for covariance in covariances[1:]:
        np.testing.assert_allclose((covariance - covariances[0]) / np.outer(sigmas, sigmas), 0.0, atol=1e-5)


def test_other_shapes_and_cases_are_refused_and_no_numbers_pass() -> None:
    (search, _), _ = solved(parts(), problem_of(box_body(), np.random.default_rng(3), noise=NOISE))
    kernel = search.average.kernel
    assert isinstance(kernel, CompiledSearch)
    states, arrays, numbers = search.average.states, search.kernel_arrays, search.kernel_numbers
    assert kernel.run(states, arrays, numbers).states.shape[1] == states.shape[1]
    for name in arrays:
        with pytest.raises(InputError):
            kernel.run(states, arrays | {name: arrays[name][..., :-1]}, numbers)
    with pytest.raises(InputError):
        kernel.run(states[1:], arrays, numbers)
    for name in ("bias_case", "twins", "scouts"):
        for wrong in (-1, 18):
            with pytest.raises(IndexError):
                kernel.run(states, arrays | {name: np.full_like(arrays[name], wrong)}, numbers)
    with pytest.raises(np.linalg.LinAlgError):
        kernel.run(states, arrays | {"moments": np.full_like(arrays["moments"], np.nan)}, numbers)
    with pytest.raises(np.linalg.LinAlgError):
        weighed_sums(np.zeros((1, 19, 19)), np.ones(1), -np.eye(6), 1.0, signals.ENTRIES)


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
