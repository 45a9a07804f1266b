"""Least squares inside bounds: the conditions of optimality, with and without a start from a similar problem."""

import numpy as np
import pytest

from poise.mismatch.inference.box import box_minimum


def problem(rng: np.random.Generator, *, collinear: bool):
    """A normal matrix, its right side, and bounds on all coefficients but three."""
    columns = rng.normal(size=(30, 200))
    if collinear:
        columns[10:20] = columns[:10] + 1e-3 * columns[10:20]
    bound = np.where(np.arange(30) < 27, 0.3, np.inf)
    target = rng.normal(size=30) @ columns
    return columns @ columns.T + 1e-3 * np.eye(30), columns @ target, -bound, bound


def misses_of_optimality(normal, right, lower, upper, x):
    """The slopes that could still lower the square, relative to the largest."""
    slope = normal @ x - right
    slope = np.where(
        x <= lower + 1e-6, np.minimum(slope, 0.0), np.where(x >= upper - 1e-6, np.maximum(slope, 0.0), slope)
    )
    return np.abs(slope).max() / np.abs(right).max()


@pytest.mark.parametrize("collinear", [False, True])
@pytest.mark.parametrize("start", ["none", "near", "far"])
def test_the_conditions_of_optimality_hold(collinear, start):
    rng = np.random.default_rng(3)
    for _ in range(10):
        normal, right, lower, upper = problem(rng, collinear=collinear)
        near = {
            "none": None,
            "near": box_minimum(normal, right * 1.02, lower, upper),
            "far": np.clip(rng.normal(size=30), lower, upper),
        }[start]
        found = box_minimum(normal, right, lower, upper, near)
        assert (found >= lower).all()
        assert (found <= upper).all()
        assert misses_of_optimality(normal, right, lower, upper, found) < 1e-5


def test_a_start_changes_nothing():
    rng = np.random.default_rng(4)
    normal, right, lower, upper = problem(rng, collinear=True)
    near = np.clip(rng.normal(size=30), lower, upper)
    np.testing.assert_allclose(
        box_minimum(normal, right, lower, upper, near), box_minimum(normal, right, lower, upper), atol=1e-6
    )


def test_all_coefficients_may_end_at_a_bound():
    bound = np.full(4, 1e-6)
    found = box_minimum(np.eye(4), np.array([1.0, -1.0, 2.0, -2.0]), -bound, bound, np.zeros(4))
    np.testing.assert_array_equal(found, [1e-6, -1e-6, 1e-6, -1e-6])
