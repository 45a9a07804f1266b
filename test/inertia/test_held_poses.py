"""Poses held still: errors that last as long as a pose are in the uncertainty, and few poses are a finding."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode
from poise.inertia import identify
from poise.inertia.estimators import InformationAccumulator, model_matrix, solve
from poise.inertia.model import InertialParameters
from poise.inertia.pipeline.held_poses import HeldPoses
from poise.inertia.verdict import SampleBins
from poise.recording import open_recording
from poise.robot import SensorMotion
from poise.weighing import named_and_possible

GRAVITY = np.array([0.0, 0.0, -9.81])
LOAD = InertialParameters(1.0, [0.0, 0.01, 0.05], 1e-3 * np.eye(3))


def weighed(rng: np.random.Generator, poses: int, each: int = 60, lasting: float = 0.09):
    """The poses of a drawn recording, their least squares, and the same widened."""
    turn = Rotation.random(poses, rng=rng).as_matrix()
    rows = np.repeat(np.arange(poses), each)
    motion = SensorMotion.at_rest(np.arange(len(rows)) * 10_000_000, turn[rows])
    matrix = model_matrix(motion, GRAVITY)
    scale = np.repeat([1.0, 0.05], 3)
    errors = lasting * rng.normal(size=(poses, 6))[rows] + 0.05 * rng.normal(size=(len(rows), 6))
    wrench = matrix @ LOAD.phi + scale * errors
    information, bins = InformationAccumulator(), SampleBins(GRAVITY)
    information.add(matrix, wrench)
    bins.add(motion, wrench)
    held, plain = HeldPoses.of(bins.samples), solve(information)
    return held, plain, held.widened(plain)


@pytest.mark.parametrize("poses", [4, 6, 12])
def test_95_percent_intervals_hold_the_truth_though_each_pose_has_an_error_of_its_own(poses):
    rng = np.random.default_rng(poses)
    inside, narrow = [], []
    for _ in range(30):
        held, plain, wider = weighed(rng, poses)
        assert poses - 1 <= len(held) <= poses  # two may be alike
        for solution, into in ((wider, inside), (plain, narrow)):
            into.append(np.abs(solution.phi - LOAD.phi)[:4] < 1.96 * np.sqrt(np.diag(solution.covariance)[:4]))
    assert 0.9 < np.mean(inside) <= 1.0
    assert np.mean(narrow) < np.mean(inside)


def test_white_noise_of_single_samples_needs_no_more_than_least_squares_says():
    _, plain, wider = weighed(np.random.default_rng(1), 40, each=1)
    np.testing.assert_allclose(np.diag(wider.covariance)[:4], np.diag(plain.covariance)[:4], rtol=0.35)


def test_fewer_than_four_poses_are_a_finding_that_names_a_motion():
    held, *_ = weighed(np.random.default_rng(2), 3)
    found = held.finding({"moving": 420})
    assert found is not None
    assert found.code is ErrorCode.TOO_FEW_SAMPLES
    assert "70% of the samples are in motion, left out; the others show 3 attitudes" in found.message
    assert weighed(np.random.default_rng(2), 4)[0].finding({}) is None


@pytest.mark.parametrize(
    ("name", "method", "code"),
    [
        ("free_motion", "static", ErrorCode.TOO_FEW_SAMPLES),
        ("vibration", "static", ErrorCode.TOO_FEW_SAMPLES),
        ("free_motion", "ols", ErrorCode.TOPIC_MISSING),
    ],
)
def test_a_method_whose_assumption_the_recording_contradicts_says_so_and_no_other_cause_is_named(name, method, code):
    estimate = identify(open_recording(f"bags/kuka_{name}.mcap"), method=method, keep_history=False).estimate
    assert estimate.findings[0].code is code
    assert named_and_possible(estimate) == ((), ())
    assert abs(estimate.phi[0] - 0.9323) < 3 * estimate.mass_std
