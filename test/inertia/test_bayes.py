"""The poise estimator: right when it can be, sure of as much as it knows, and never an impossible body."""

import os
from dataclasses import replace

import numpy as np
import pytest
from composites import composite, measured, motion, without_shape
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia import frame_change
from poise.inertia.bayes.estimator import BayesSolution, PoiseEstimator, poise
from poise.inertia.estimators.hps import hps
from poise.inertia.estimators.registry import method
from poise.inertia.model.parts import Parts, box_moments
from poise.inertia.model.problem import IdentificationProblem, NoiseLevels
from poise.inertia.model.signals import without_noise
from poise.inertia.model.wrench_regressor import regressor


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


def estimator_of(problem: IdentificationProblem, **options) -> PoiseEstimator:
    parts = None
    if problem.unit_parts is not None:
        parts = Parts(problem.unit_parts, problem.part_volumes, problem.shape_points)
    return PoiseEstimator(parts, problem.noise, **options)


def feed(estimator: PoiseEstimator, problem: IdentificationProblem, rows) -> None:
    estimator.add(
        problem.stamps[rows],
        problem.gravity_in_sensor[rows],
        problem.linear_acceleration[rows],
        problem.angular_velocity[rows],
        problem.angular_acceleration[rows],
        problem.wrench[rows],
    )


def errors_in_sigma(solution: BayesSolution, phi) -> np.ndarray:
    return np.abs(solution.phi - phi) / np.sqrt(np.diag(solution.covariance))


def nees(solution: BayesSolution, phi) -> float:
    deviation = np.sqrt(np.diag(solution.covariance))
    scaled = (solution.phi - phi) / deviation
    return float(scaled @ np.linalg.solve(solution.covariance / np.outer(deviation, deviation), scaled))


def test_one_by_one_in_portions_and_at_once_give_the_same_answer(rng):
    held = composite(rng)
    problem = measured(rng, held.phi, delay=0.013, parts=held.parts)
    at_once = poise(problem)
    for cuts in (range(1, 150), sorted(rng.choice(np.arange(1, 150), 12, replace=False))):
        estimator = estimator_of(problem)
        for rows in np.split(np.arange(150), cuts):
            feed(estimator, problem, rows)
        other = estimator.solve()
        scale = np.sqrt(np.diag(at_once.covariance))
        np.testing.assert_allclose(other.phi, at_once.phi, rtol=1e-9, atol=1e-9 * scale.min())
        np.testing.assert_allclose(other.covariance, at_once.covariance, rtol=1e-9, atol=1e-9 * scale.min() ** 2)
        np.testing.assert_allclose(other.bias, at_once.bias, atol=1e-9)
        assert other.delay == pytest.approx(at_once.delay, abs=1e-12)
        assert other.n_samples == at_once.n_samples == 150


def test_looking_in_between_changes_nothing(rng):
    held = composite(rng)
    problem = measured(rng, held.phi, parts=held.parts)
    estimator = estimator_of(problem)
    for rows in np.split(np.arange(150), 10):
        feed(estimator, problem, rows)
        estimator.solve()
    np.testing.assert_allclose(estimator.solve().phi, poise(problem).phi, rtol=1e-9, atol=1e-12)


def test_without_noise_the_parts_give_everything_away(rng):
    quiet = NoiseLevels(force=1e-4, torque=1e-5, linear_acceleration=1e-5, angular_acceleration=1e-5)
    for _ in range(5):
        held = composite(rng)
        solution = poise(measured(rng, held.phi, noise=quiet, parts=held.parts))
        scale = np.abs(held.phi).max() * np.array([1.0, *[0.1] * 3, *[0.01] * 6])
        np.testing.assert_allclose(solution.phi, held.phi, atol=5e-3 * scale.min(), rtol=5e-3)
        assert solution.consistent
        assert solution.com_in_hull


def test_the_answer_turns_with_the_sensor(rng):
    held = composite(rng)
    problem = measured(rng, held.phi, parts=held.parts)
    turn = Rotation.random(random_state=rng).as_matrix()
    turned_wrench = np.concatenate([problem.wrench[:, :3] @ turn.T, problem.wrench[:, 3:] @ turn.T], axis=1)
    change = frame_change(turn, np.zeros(3))
    turned = replace(
        problem,
        gravity_in_sensor=problem.gravity_in_sensor @ turn.T,
        linear_acceleration=problem.linear_acceleration @ turn.T,
        angular_velocity=problem.angular_velocity @ turn.T,
        angular_acceleration=problem.angular_acceleration @ turn.T,
        wrench=turned_wrench,
        unit_parts=change @ problem.unit_parts,
        shape_points=problem.shape_points @ turn.T,
    )
    here, there = poise(problem), poise(turned)
    np.testing.assert_allclose(there.phi, change @ here.phi, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(there.covariance, change @ here.covariance @ change.T, rtol=1e-4, atol=1e-12)


def random_input(rng: np.random.Generator) -> tuple[PoiseEstimator, Parts | None]:
    """Samples that need not make any sense: noise, signs turned, a motion that stands still, any scale."""
    n = int(rng.integers(3, 60))
    stamps = np.cumsum(rng.integers(1, 100, n)) * 1_000_000
    gravity = rng.normal(size=(n, 3))
    gravity *= 9.8 / np.linalg.norm(gravity, axis=1, keepdims=True)
    scales = 10.0 ** rng.uniform(-3, 2, 4)
    linear, omega, alpha = (rng.normal(size=(n, 3)) * scale for scale in scales[:3])
    if rng.random() < 0.25:
        gravity[:], linear, omega, alpha = gravity[0], 0 * linear, 0 * omega, 0 * alpha
    wrench = rng.normal(size=(n, 6)) * scales[3] + rng.normal(size=6) * 10 ** rng.uniform(-3, 2)
    parts = None
    if rng.random() < 0.7:
        held = composite(rng)
        parts = held.parts
        if rng.random() < 0.5:
            strange = rng.choice([1, -1, 0.001, 30])
            wrench = regressor(gravity - linear, omega, alpha) @ held.phi * strange + rng.normal(size=(n, 6)) * 0.05
    spread = 10 ** rng.uniform(-2, 1, 2) if rng.random() < 0.5 else rng.choice([0.0, np.inf]) * np.ones(2)
    noise = NoiseLevels(*10 ** rng.uniform(-4, 0, 4), *np.nan_to_num(spread, nan=0.0, posinf=np.inf))
    accuracy = 10 ** rng.uniform(-4, -0.5)
    estimator = PoiseEstimator(parts, noise, longest_delay=rng.choice([0, 0.06]), shape_accuracy=accuracy)
    estimator.add(stamps, gravity, linear, omega, alpha, wrench)
    return estimator, parts


def check_random_inputs(seeds: range) -> None:
    for seed in seeds:
        estimator, parts = random_input(np.random.default_rng([9, seed]))
        solution = estimator.solve()
        deviation = np.sqrt(np.diag(solution.covariance))
        assert np.isfinite(solution.phi).all(), seed
        assert solution.consistent, seed
        assert np.linalg.eigvalsh(solution.covariance / np.outer(deviation, deviation))[0] > -1e-9, seed
        if parts is not None and not solution.com_in_hull:
            assert any(finding.code == ErrorCode.SHAPE_MISMATCH for finding in solution.findings), seed


@pytest.mark.filterwarnings("error")
def test_whatever_comes_in_the_answer_is_a_body_that_can_exist():
    check_random_inputs(range(int(os.environ.get("POISE_RANDOM_INPUTS", "250"))))  # 10,000 take a quarter of an hour


@pytest.mark.parametrize(("delay", "bias"), [(0.0, 0.0), (0.03, 1.0)])
def test_intervals_cover_objects_that_nothing_was_tuned_on(delay: float, bias: float):
    covered, squares = [], []
    for seed in range(60):
        rng = np.random.default_rng([77, seed])
        held = composite(rng, shape_error=7e-4, cut_error=4.5e-3, resolution=1e-5)
        offset = bias * rng.normal(size=6) * np.repeat([0.5, 0.02], 3)
        problem = measured(rng, held.phi, delay=delay, bias=offset, speed=rng.uniform(1.5, 3.0), parts=held.parts)
        solution = poise(problem)
        covered.append(errors_in_sigma(solution, held.phi) < 1.96)
        squares.append(nees(solution, held.phi) / 10)
    assert 0.93 < np.mean(covered) < 0.98
    # Improbable hypotheses (a bad shape, another material) add to the covariance; none of these objects is such a case.
    assert 0.5 < np.mean(squares) < 1.3


def test_without_a_shape_intervals_cover_what_the_motion_shows():
    covered = []
    for seed in range(40):
        rng = np.random.default_rng([78, seed])
        held = composite(rng)
        solution = poise(without_shape(measured(rng, 0.7 * held.phi / held.phi[0], speed=3.0)))
        covered.append(errors_in_sigma(solution, 0.7 * held.phi / held.phi[0])[:4] < 1.96)
    assert np.mean(covered) > 0.88


def test_parts_whose_centroids_lie_in_one_plane_keep_their_masses(rng):
    # Thesis section 3.2.5: standing still, HPS lazily zeroes parts that it does not need.
    centres = np.array([[0.05, 0, 0.1], [-0.05, 0, 0.1], [0, 0.05, 0.1], [0, -0.05, 0.1], [0, 0, 0.1]])
    parts = Parts.from_moments(box_moments(centres, np.full((5, 3), 0.03)), range(5), centres)
    phi = parts.homogeneous_phi * 0.5
    attitudes = Rotation.random(60, random_state=rng).apply([0, 0, -9.80665], inverse=True)
    still = np.zeros((60, 3))
    problem = IdentificationProblem(
        stamps=np.arange(60) * 1_000_000_000,
        gravity_in_sensor=attitudes,
        linear_acceleration=still,
        angular_velocity=still,
        angular_acceleration=still,
        wrench=regressor(attitudes, still, still) @ phi + NoiseLevels().wrench * rng.normal(size=(60, 6)),
        unit_parts=parts.unit_phi,
        part_volumes=parts.volumes,
        shape_points=centres,
    )
    lazy, ours = hps(problem), poise(problem)
    assert np.abs(ours.phi[4:] - phi[4:]).max() < 0.2 * np.abs(lazy.phi[4:] - phi[4:]).max()
    assert np.all(errors_in_sigma(ours, phi) < 4)


@pytest.mark.parametrize("delay", [-0.03, 0.0, 0.05])
def test_the_clocks_are_told_apart(delay: float):
    errors, sure = [], []
    for seed in range(15):
        rng = np.random.default_rng([5, seed])
        held = composite(rng)
        phi = held.phi * 0.5 / held.phi[0]
        solution = poise(measured(rng, phi, delay=delay, parts=held.parts))
        errors.append(abs(solution.delay - delay))
        sure.append(abs(solution.delay - delay) < 3 * solution.delay_std + 1e-3)
    assert np.median(errors) < 0.005
    assert np.mean(sure) > 0.85


def test_a_zeroed_sensor_is_believed_and_a_drifted_one_found_out(rng):
    held = composite(rng)
    phi = held.phi * 0.5 / held.phi[0]
    zeroed = poise(measured(rng, phi, parts=held.parts))
    assert np.abs(zeroed.bias[:3]).max() < 0.02
    offset = np.array([0.8, -0.5, 1.2, 0.03, -0.02, 0.01])
    drifted = poise(measured(rng, phi, parts=held.parts, bias=offset))
    deviation = np.sqrt(np.diag(drifted.bias_covariance))
    assert np.all(np.abs(drifted.bias - offset) < 4 * deviation + 1e-9)
    assert abs(drifted.phi[0] - 0.5) < 4 * np.sqrt(drifted.covariance[0, 0])


def test_a_never_zeroed_sensor_is_no_obstacle(rng):
    held = composite(rng)
    phi = held.phi * 0.9 / held.phi[0]
    offset = np.array([9.0, -1.0, 10.0, 0.4, -0.7, -0.15])
    for noise in (NoiseLevels(), NoiseLevels(force_bias=np.inf, torque_bias=np.inf)):
        solution = poise(measured(rng, phi, noise=noise, bias=offset, parts=held.parts, speed=3.0))
        assert abs(solution.phi[0] - 0.9) < max(0.02, 4 * np.sqrt(solution.covariance[0, 0]))


def test_a_push_is_left_out_and_named(rng):
    held = composite(rng)
    phi = held.phi * 0.6 / held.phi[0]
    problem = measured(rng, phi, samples=300, parts=held.parts)
    wrench = problem.wrench.copy()
    wrench[100:130] += np.outer(np.sin(np.arange(30) / 4), [6, -3, 2, 0.3, 0.4, -0.2])
    pushed = poise(replace(problem, wrench=wrench))
    assert {span.reason for span in pushed.rejected} == {"external_contact"}
    assert all(span.start >= 0.9e9 and span.end <= 1.5e9 for span in pushed.rejected)
    assert 250 <= pushed.n_samples <= 275
    assert np.all(errors_in_sigma(pushed, phi) < 4.5)


def test_samples_that_cannot_be_used_are_named_with_their_reason(rng):
    held = composite(rng)
    problem = measured(rng, held.phi, samples=200, parts=held.parts)
    wrench, omega, stamps = problem.wrench.copy(), problem.angular_velocity.copy(), problem.stamps.copy()
    wrench[20:25] = 700.0
    wrench[60, 2] = np.nan
    omega[80] = np.inf
    wrench[100:120] = wrench[100]
    stamps[150] = stamps[140]
    estimator = estimator_of(problem, limits=np.repeat([600.0, 30.0], 3))
    estimator.add(
        stamps, problem.gravity_in_sensor, problem.linear_acceleration, omega, problem.angular_acceleration, wrench
    )
    solution = estimator.solve()
    found = {(span.reason, span.start // 10_000_000, span.n_samples) for span in solution.rejected}
    assert found == {("saturated", 20, 5), ("not_finite", 60, 1), ("not_finite", 80, 1), ("stale", 103, 17)} | {
        ("out_of_order", 140, 1)
    }
    assert solution.n_samples == 200 - 5 - 1 - 1 - 17 - 1
    assert np.all(errors_in_sigma(solution, held.phi) < 4.5)


def test_noise_that_was_not_told_makes_less_sure(rng):
    held = composite(rng)
    phi = held.phi * 0.5 / held.phi[0]
    loud = NoiseLevels(force=1.0, torque=0.05)
    given, surprised = (
        poise(replace(measured(np.random.default_rng(3), phi, noise=loud, parts=held.parts), noise=noise))
        for noise in (loud, NoiseLevels())
    )
    assert surprised.covariance[0, 0] == pytest.approx(given.covariance[0, 0], rel=0.5)
    assert surprised.residual_force == pytest.approx(1.0, rel=0.1)


def test_what_the_motion_does_not_show_is_named(rng):
    held = composite(rng)
    phi = held.phi * 0.5 / held.phi[0]
    gravity, _, _, _ = motion(rng, np.linspace(0, 5, 300), 2.0)
    still = np.zeros((300, 3))
    wrench = regressor(gravity, still, still) @ phi + NoiseLevels().wrench * rng.normal(size=(300, 6))
    stamps = np.arange(300) * 10_000_000
    for parts in (None, held.parts):
        estimator = PoiseEstimator(parts)
        estimator.add(stamps, gravity, still, still, still, wrench)
        solution = estimator.solve()
        assert {"ixx", "iyy", "izz"} <= set(solution.unidentified)
        assert not {"m", "cx", "cy", "cz"} & set(solution.unidentified)
        assert np.all(np.isfinite(solution.phi))
        assert np.all(errors_in_sigma(solution, phi)[:4] < 4)


def test_gravity_along_one_axis_hides_the_centre_of_mass_along_it(rng):
    gravity = np.tile([0.0, 0.0, -9.80665], (100, 1))
    still = np.zeros((100, 3))
    phi = composite(rng).phi
    wrench = regressor(gravity, still, still) @ phi + NoiseLevels().wrench * rng.normal(size=(100, 6))
    estimator = PoiseEstimator()
    estimator.add(np.arange(100) * 10_000_000, gravity, still, still, still, wrench)
    unseen = set(estimator.solve().unidentified)
    assert "cz" in unseen
    assert not {"cx", "cy"} & unseen


def test_a_sensor_zeroed_while_it_holds_the_object_is_found_out():
    found = []
    for seed in range(10):
        rng = np.random.default_rng([31, seed])
        held = composite(rng)
        phi = held.phi * 0.7 / held.phi[0]
        problem = measured(rng, phi, samples=300, parts=held.parts, speed=3.0)
        at_zeroing = Rotation.random(random_state=rng).apply([0, 0, -9.80665])
        offset = -regressor(at_zeroing, np.zeros(3), np.zeros(3)) @ phi
        solution = poise(replace(problem, wrench=problem.wrench + offset))
        found.append(any(finding.code == ErrorCode.ZEROED_UNDER_LOAD for finding in solution.findings))
        assert abs(solution.phi[0] - 0.7) < 4 * np.sqrt(solution.covariance[0, 0]) + 0.003
        drift = np.array([0.5, -0.4, 0.3, 0.02, 0.01, -0.02])
        drifted = poise(replace(problem, wrench=problem.wrench + drift))
        assert not any(finding.code == ErrorCode.ZEROED_UNDER_LOAD for finding in drifted.findings)
    assert np.mean(found) >= 0.9


def test_another_object_than_the_shape_says_is_found_out(rng):
    held, other = composite(rng), composite(rng)
    phi = held.phi * 0.7 / held.phi[0]
    apart = other.parts.in_frame(np.eye(3), [0.05, -0.04, 0.03])
    solution = poise(measured(rng, phi, parts=apart))
    assert any(finding.code == ErrorCode.SHAPE_MISMATCH for finding in solution.findings)
    assert abs(solution.phi[0] - 0.7) < 0.02
    right = poise(measured(rng, phi, parts=held.parts))
    assert not right.findings


def test_nothing_held_is_said(rng):
    for parts in (None, composite(rng).parts):
        solution = poise(measured(rng, np.zeros(10), parts=parts))
        assert any(finding.code == ErrorCode.NOT_IDENTIFIABLE for finding in solution.findings)
        assert solution.phi[0] < 0.01


def test_two_samples_are_too_few(rng):
    problem = measured(rng, composite(rng).phi)
    with pytest.raises(NoAnswerError) as caught:
        poise(problem.select(slice(0, 2)))
    assert caught.value.code == ErrorCode.TOO_FEW_SAMPLES
    estimator = PoiseEstimator()
    estimator.add(np.arange(5), *np.zeros((4, 5, 3)), np.full((5, 6), np.nan))
    with pytest.raises(NoAnswerError, match="5 not_finite"):
        estimator.solve()


@pytest.mark.parametrize("options", [{"shape_accuracy": 0.0}, {"longest_delay": -1.0}])
def test_options_that_cannot_be_are_refused(options):
    with pytest.raises(InputError) as caught:
        PoiseEstimator(**options)
    assert caught.value.code == ErrorCode.BAD_INPUT


def test_a_sensor_without_noise_is_refused():
    with pytest.raises(InputError):
        PoiseEstimator(noise=NoiseLevels(force=0.0))


def test_rows_that_do_not_belong_together_are_refused():
    with pytest.raises(InputError) as caught:
        PoiseEstimator().add(np.arange(3), *np.zeros((4, 3, 3)), np.zeros((2, 6)))
    assert caught.value.code == ErrorCode.TYPE_MISMATCH


def test_the_registry_knows_it(rng):
    problem = measured(rng, composite(rng).phi)
    np.testing.assert_allclose(method("poise")(problem).phi, poise(problem).phi)


def test_a_motion_without_noise_has_finite_weights():
    moments = np.eye(19)[None] * 1e3
    found = without_noise(moments[..., :13, :13], np.array([100.0]), NoiseLevels(angular_acceleration=0.0))
    np.testing.assert_array_equal(found, moments[..., :13, :13])
