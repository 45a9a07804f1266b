"""Ordinary work: a grasp and a release are noticed within half a second, pushes and drift are not taken for one."""

import numpy as np
import pytest
from numpy.typing import ArrayLike
from ordinary_work import START, Nuisance, Work, work
from scipy.spatial.transform import Rotation

from poise.inertia import InertialParameters
from poise.inertia.bayes.change import ContinuousEstimator, PayloadChange
from poise.inertia.model.problem import NoiseLevels
from poise.inertia.model.wrench_regressor import regressor
from poise.inertia.pipeline.online import OnlineEstimator
from poise.robot.sources import JointSource

PERIOD = 0.05
NOISE = NoiseLevels(0.1, 0.005, 0.02, 0.05)


def watch(measured: Work) -> tuple[OnlineEstimator, list[tuple[float, PayloadChange]]]:
    """Stream the work as a node would, every 50 ms; the estimator, and when (s) it reported which change."""
    joints, wrench = measured.joints, measured.wrench
    online = OnlineEstimator(
        JointSource(measured.model), frame_id="ft_sensor", method="poise", noise=NOISE, continuous=True
    )
    reported: list[tuple[float, PayloadChange]] = []
    for begin in np.arange(0, (wrench.stamps[-1] - START) * 1e-9, PERIOD):
        span = START + np.round(np.array([begin, begin + PERIOD]) * 1e9).astype(np.int64)
        some = slice(*np.searchsorted(joints.stamps, span))
        online.source.extend(joints.stamps[some], joints.names, joints.position[some])
        some = slice(*np.searchsorted(wrench.stamps, span))
        online.add_wrench(wrench.stamps[some], wrench.wrench_in_sensor[some])
        online.update()
        reported += [(begin + PERIOD, change) for change in online.changes[len(reported) :]]
    return online, reported


@pytest.mark.parametrize("seed", [3])
def test_a_grasp_and_a_release_are_reported_within_half_a_second_and_weighed(seed):
    measured = work(np.random.default_rng([seed, 7]), 17.0, every=2)
    online, reported = watch(measured)
    assert len(reported) == len(measured.changes) >= 2
    for (when, change), event, before, after in zip(
        reported, measured.changes, measured.payloads[:-1, 0], measured.payloads[1:, 0], strict=True
    ):
        assert event < when < event + 0.5
        assert event < (change.since - START) * 1e-9 < when
        assert change.mass_before == pytest.approx(before, abs=0.03)
        assert change.mass_after == pytest.approx(after, abs=0.05)
    estimate = online.estimate()
    assert estimate.since == reported[-1][1].since
    assert estimate.parameters.mass == pytest.approx(measured.payloads[-1, 0], abs=0.01)


def test_right_after_a_change_the_estimate_is_already_that_of_the_new_payload():
    measured = work(np.random.default_rng([0, 7]), 7.5, every=2)
    (event,) = measured.changes
    cut = int(np.searchsorted(measured.wrench.stamps, START + round((event + 0.6) * 1e9)))
    early = type(measured.wrench)(measured.wrench.stamps[:cut], measured.wrench.wrench_in_sensor[:cut], "ft_sensor")
    online, reported = watch(Work(measured.model, measured.joints, early, measured.changes, measured.payloads))
    assert len(reported) == 1
    estimate = online.estimate()
    assert abs(estimate.parameters.mass - measured.payloads[-1, 0]) < 4 * estimate.mass_std + 0.01


def test_pushes_and_a_drifting_bias_are_no_other_payload():
    measured = work(np.random.default_rng(40), 25.0, every=0, nuisance=Nuisance(pushes=12, drift=0.3))
    online, reported = watch(measured)
    assert not reported
    assert online.estimate().parameters.mass == pytest.approx(measured.payloads[0, 0], abs=0.03)


def samples(payload: ArrayLike, seconds: float, begin: float, rng: np.random.Generator, force: float = 0.05):
    """Stamps, and rows for a `ContinuousEstimator`: a sensor at 100 Hz that turns at 0.4 rad/s, and holds a payload."""
    at = np.arange(begin, begin + seconds, 0.01)
    turn = Rotation.from_rotvec(np.outer(0.8 * np.sin(0.5 * at), [1.0, 0.4, 0.0]))
    specific = turn.inv().apply([0.0, 0.0, -9.81])
    still = np.zeros((len(at), 3))
    wrench = np.einsum("nij,j->ni", regressor(specific, still, still), payload)
    wrench += rng.normal(size=wrench.shape) * np.repeat([force, force / 20], 3)
    return START + np.round(at * 1e9).astype(np.int64), np.hstack([specific, still, still, wrench]), turn


def fed(estimator: ContinuousEstimator, stamps, rows) -> None:
    """In portions of 50 ms."""
    for begin in range(0, len(stamps), 5):
        estimator.add_rows(stamps[begin : begin + 5], rows[begin : begin + 5])


LIGHT, HELD = (InertialParameters(mass, [0.0, 0.0, 0.05], 1e-5 * np.eye(3)).phi for mass in (0.02, 0.045))


def test_a_change_of_a_light_payload_is_noticed_and_dated():
    rng = np.random.default_rng(5)
    estimator = ContinuousEstimator(None, NoiseLevels(0.05, 0.0025))
    fed(estimator, *samples(LIGHT, 4.0, 0.0, rng)[:2])
    fed(estimator, *samples(HELD, 2.5, 4.0, rng)[:2])
    (change,) = estimator.changes
    assert change.since == pytest.approx(START + 4_000_000_000, abs=300_000_000)
    assert change.mass_after == pytest.approx(0.045, abs=0.01)


def test_a_push_that_lifts_more_than_the_payload_is_no_payload():
    rng = np.random.default_rng(6)
    estimator = ContinuousEstimator(None, NoiseLevels(0.05, 0.0025))
    fed(estimator, *samples(HELD, 4.0, 0.0, rng)[:2])
    stamps, rows, turn = samples(HELD, 2.0, 4.0, rng)
    rows[:, 9:12] += turn.inv().apply([0.0, 0.0, 1.0])  # N, upwards; the payload weighs 0.44 N
    fed(estimator, stamps, rows)
    assert not estimator.changes


def test_a_vertical_push_that_is_taken_for_a_payload_leaves_a_doubt_until_the_sensor_has_turned():
    rng = np.random.default_rng(7)
    heavy = 20 * HELD
    estimator = ContinuousEstimator(None, NoiseLevels(0.05, 0.0025))
    fed(estimator, *samples(heavy, 4.0, 0.0, rng)[:2])
    stamps, rows, turn = samples(heavy, 1.0, 4.0, rng)
    rows[:, 9:12] += turn.inv().apply([0.0, 0.0, 3.0])
    fed(estimator, stamps, rows)
    assert estimator.changes
    solution = estimator.solve()
    doubts = estimator.doubts(solution.bias)
    spread = np.sqrt(sum(each.spread(solution.phi)[0, 0] for each in doubts) + solution.covariance[0, 0])
    assert abs(solution.phi[0] - 0.9) < 3 * spread
    fed(estimator, *samples(heavy, 4.0, 5.0, rng)[:2])
    assert not estimator.doubts(estimator.solve().bias)
    solution = estimator.solve()
    assert abs(solution.phi[0] - 0.9) < 3 * np.sqrt(solution.covariance[0, 0])


@pytest.mark.parametrize("seed", [10, 11])
def test_a_push_that_imitates_a_payload_at_first_is_told_by_the_bias_however_far_the_sensor_turns(seed):
    rng = np.random.default_rng(seed)
    heavy, bias = 20 * HELD, np.array([1.0, -2.0, 0.5, 0.02, 0.0, -0.03])
    estimator = ContinuousEstimator(None, NoiseLevels(0.05, 0.0025, force_bias=np.inf, torque_bias=np.inf))
    for payload, seconds, begin, push in ((LIGHT, 5.0, 0.0, 0.0), (heavy, 4.0, 5.0, 0.0), (heavy, 5.0, 9.0, 3.0)):
        stamps, rows, turn = samples(payload, seconds, begin, rng)
        aside = 0.6 * (stamps - stamps[0]) * 1e-9 if push else np.zeros(len(stamps))  # N
        rows[:, 9:12] += turn.inv().apply(np.column_stack([aside, 0 * aside, 0 * aside + push]))
        rows[:, 9:] += bias
        for first in range(0, len(stamps), 50):
            fed(estimator, stamps[first : first + 50], rows[first : first + 50])
            if push and len(estimator.changes) > 1:
                solution = estimator.solve()
                spread = sum(each.spread(solution.phi)[0, 0] for each in estimator.doubts(solution.bias))
                assert abs(solution.phi[0] - 0.9) < 3 * np.sqrt(spread + solution.covariance[0, 0])
    assert len(estimator.changes) == 2
    np.testing.assert_allclose(estimator.tare, bias, atol=0.05)


def test_the_offset_of_an_accelerometer_is_no_contact_and_does_not_add_up_over_grasps():
    rng = np.random.default_rng(3)
    noise = NoiseLevels(0.05, 0.0025, force_bias=np.inf, torque_bias=np.inf)
    estimator = ContinuousEstimator(None, noise, offset=0.5)
    for number in range(8):
        stamps, rows, _ = samples((LIGHT, 20 * HELD)[number % 2], 3.5, 3.5 * number, rng)
        rows[:, 0] += 0.3  # m/s2
        fed(estimator, stamps, rows)
        assert len(estimator.changes) == number
        assert not any(each.probability == 0.5 for each in estimator.doubts(estimator.solve().bias))
    assert estimator.bias_spread[0] == pytest.approx(0.5 * (0.9 - 0.02), rel=0.1)


@pytest.mark.parametrize("seed", [8, 9])
def test_until_a_release_in_much_noise_is_certain_the_estimate_of_a_light_payload_covers_it(seed):
    rng = np.random.default_rng(seed)
    estimator = ContinuousEstimator(None, NoiseLevels(0.09, 0.0045))
    fed(estimator, *samples(HELD, 5.0, 0.0, rng, 0.09)[:2])
    stamps, rows, _ = samples(LIGHT, 3.0, 5.0, rng, 0.09)
    for begin in range(0, len(stamps), 5):
        estimator.add_rows(stamps[begin : begin + 5], rows[begin : begin + 5])
        if begin < 60 or begin % 10:
            continue
        solution = estimator.solve()
        spread = sum(each.spread(solution.phi)[0, 0] for each in estimator.doubts(solution.bias))
        assert abs(solution.phi[0] - 0.02) < 3 * np.sqrt(spread + solution.covariance[0, 0])
