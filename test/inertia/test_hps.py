"""Homogeneous part segmentation: non-negative least squares at standstill, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from problems import NoiseLevels, box_body, motion, problem_of, two_boxes
from simulated_loads import random_body

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia.estimators.hps import MAX_PARTS, hps, merge_parts, standing_still, static_regressor
from poise.inertia.model.parameters import InertialParameters
from poise.inertia.model.problem import IdentificationProblem


def known() -> dict[str, np.ndarray]:
    unit_parts, volumes = two_boxes()
    return {"unit_parts": unit_parts, "part_volumes": volumes}


def test_homogeneous_parts_are_weighed_exactly_inertia_included() -> None:
    rng = np.random.default_rng(1)
    body = InertialParameters.from_phi(known()["unit_parts"] @ [0.7, 0.2])
    found = hps(problem_of(body, rng, 12, liveliness=0.0, **known()))
    np.testing.assert_allclose(found.phi, body.phi, rtol=1e-9, atol=1e-12)


def test_samples_in_motion_do_not_count() -> None:
    rng = np.random.default_rng(2)
    problem = problem_of(box_body(), rng, 40, liveliness=0.3, **known())
    still = standing_still(problem)
    assert 0 < still.sum() < 40
    spoilt = replace(problem, wrench=problem.wrench + 5.0 * ~still[:, None])
    np.testing.assert_array_equal(hps(spoilt).phi, hps(problem).phi)


def test_the_masses_satisfy_the_conditions_of_the_optimum() -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        # A body unlike the parts: some masses have to be zero.
        problem = problem_of(random_body(rng), rng, 15, 0.0, NoiseLevels(), wrench_noise=1.0, **known())
        masses = np.linalg.lstsq(problem.unit_parts, hps(problem).phi, rcond=None)[0]
        rows = (static_regressor(problem.gravity_in_sensor) @ problem.unit_parts[:4]).reshape(-1, 2)
        gradient = rows.T @ (rows @ masses - problem.wrench.ravel())
        scale = np.abs(rows.T @ problem.wrench.ravel()).max()
        assert np.all(masses >= -1e-9)
        assert np.all(gradient >= -1e-9 * scale)
        assert np.all(np.abs(gradient * masses) <= 1e-9 * scale)


def test_merging_parts_keeps_volume_and_shape() -> None:
    rng = np.random.default_rng(3)
    bodies = [random_body(rng) for _ in range(9)]
    unit_parts = np.stack([body.phi / body.mass for body in bodies], axis=1)
    volumes = rng.uniform(1e-6, 1e-4, 9)
    merged = merge_parts(unit_parts, volumes, MAX_PARTS)
    assert merged.shape == (10, MAX_PARTS)
    np.testing.assert_allclose(merged[0], 1)
    # The merged parts still add up to the same homogeneous whole, for some volumes.
    shares = np.linalg.lstsq(merged, unit_parts @ volumes / volumes.sum(), rcond=None)[0]
    np.testing.assert_allclose(merged @ shares, unit_parts @ volumes / volumes.sum(), rtol=1e-9)


def test_nine_parts_give_an_answer_too() -> None:
    rng = np.random.default_rng(4)
    unit_parts = np.stack([box_body(1.0, at=(0.02 * k, 0.01 * k * k, 0.0)).phi for k in range(9)], axis=1)
    problem = problem_of(box_body(), rng, 12, 0.0, unit_parts=unit_parts, part_volumes=np.full(9, 1e-5))
    assert hps(problem).phi[0] == pytest.approx(0.8, rel=0.2)


def test_a_sensor_that_never_stands_still_is_refused() -> None:
    rng = np.random.default_rng(5)
    fields = motion(rng, 10) | {"linear_acceleration": np.full((10, 3), 2.0)}
    with pytest.raises(NoAnswerError) as caught:
        hps(IdentificationProblem(**fields, wrench=np.ones((10, 6)), **known()))
    assert caught.value.code == ErrorCode.TOO_FEW_SAMPLES


def test_a_force_with_the_wrong_sign_is_told_so() -> None:
    rng = np.random.default_rng(6)
    problem = problem_of(box_body(), rng, 12, 0.0, **known())
    with pytest.raises(NoAnswerError) as caught:
        hps(replace(problem, wrench=-problem.wrench))
    assert caught.value.code == ErrorCode.NOT_IDENTIFIABLE


def test_no_parts_are_told_so() -> None:
    rng = np.random.default_rng(7)
    with pytest.raises(InputError) as caught:
        hps(problem_of(box_body(), rng, 12, 0.0))
    assert caught.value.code == ErrorCode.UNSUPPORTED
