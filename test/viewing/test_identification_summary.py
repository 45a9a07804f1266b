"""What is said about an identification, against closed forms."""

import numpy as np
import pytest
from scipy.signal import lfilter
from swinging_payload import with_estimate

from poise.inertia.model.parameters import UPPER, InertialParameters
from poise.inertia.pipeline.estimate import Identification
from poise.viewing.summary import (
    com_covariance,
    correlation,
    covariance_ellipsoid,
    equivalent_ellipsoid,
    parameter_rows,
    shown_parameters,
    shown_sigmas,
    whiteness,
)
from poise.viewing.wording import NOT_IDENTIFIABLE


@pytest.mark.parametrize("seed", range(10))
def test_white_noise_is_called_white(seed: int) -> None:
    white = whiteness(np.random.default_rng(seed).normal(size=3000))
    assert white.verdict == "white"
    assert abs(white.rms - 1) < 0.05


@pytest.mark.parametrize("rho", [0.3, 0.6, 0.95])
def test_noise_with_memory_is_not_white_and_its_memory_is_measured(rho: float) -> None:
    driven = np.random.default_rng(1).normal(size=20_000)
    white = whiteness(lfilter([1.0], [1.0, -rho], driven))
    assert white.verdict == "not white"
    assert abs(white.neighbour_correlation - rho) < 0.03


def test_few_samples_and_none_are_not_judged() -> None:
    assert whiteness(np.array([1.0, -1.0, 2.0])).verdict == "too few samples"
    assert whiteness(np.zeros(0)).verdict == "all equal"
    assert whiteness(np.zeros(1000)).verdict == "all equal"


def test_an_offset_is_reported_as_mean_and_in_the_rms() -> None:
    white = whiteness(np.random.default_rng(2).normal(size=1000) + 3)
    assert abs(white.mean - 3) < 0.2
    assert abs(white.rms - np.sqrt(10)) < 0.2


def test_the_ellipsoid_of_the_centre_of_mass_has_its_covariance(identification: Identification) -> None:
    half_axes, rotation = covariance_ellipsoid(identification.estimate)
    assert np.allclose(rotation @ np.diag(half_axes**2) @ rotation.T, com_covariance(identification.estimate))
    assert np.isclose(np.linalg.det(rotation), 1)
    assert np.allclose(np.sqrt(np.diag(com_covariance(identification.estimate))), identification.estimate.com_std)


def test_a_homogeneous_ellipsoid_is_recovered_from_its_inertia(identification: Identification) -> None:
    a, b, c, mass = 0.05, 0.08, 0.12, 1.7
    inertia = mass / 5 * np.diag([b**2 + c**2, a**2 + c**2, a**2 + b**2])
    parameters = InertialParameters(mass, np.zeros(3), inertia)
    half_axes, rotation = equivalent_ellipsoid(with_estimate(identification, parameters=parameters).estimate)
    assert np.allclose(np.sort(half_axes), [a, b, c])
    assert np.isclose(np.linalg.det(rotation), 1)


def test_a_body_that_cannot_exist_or_is_not_known_has_no_ellipsoid(identification: Identification) -> None:
    impossible = InertialParameters(1.0, np.zeros(3), np.diag([1.0, 1.0, 3.0]))
    assert np.isnan(equivalent_ellipsoid(with_estimate(identification, parameters=impossible).estimate)[0]).any()
    unknown = InertialParameters(1.0, np.zeros(3), np.full((3, 3), np.nan))
    assert np.isnan(equivalent_ellipsoid(with_estimate(identification, parameters=unknown).estimate)[0]).all()


def test_correlations_lie_between_minus_one_and_one(identification: Identification) -> None:
    matrix = correlation(identification.estimate.covariance)
    assert np.allclose(np.diag(matrix), 1)
    assert np.all(np.abs(matrix) <= 1 + 1e-12)


def test_an_unknown_variance_leaves_the_other_correlations() -> None:
    covariance = np.array([[1.0, 0.5, np.nan], [0.5, 1.0, np.nan], [np.nan] * 3])
    assert np.allclose(correlation(covariance)[:2, :2], [[1, 0.5], [0.5, 1]])
    assert np.isnan(correlation(covariance)[2]).all()


def test_the_rows_are_the_estimate_rounded_to_its_uncertainty(identification: Identification) -> None:
    estimate = identification.estimate
    exact = np.concatenate([[estimate.parameters.mass], estimate.parameters.com, estimate.parameters.inertia[UPPER]])
    scale = np.array([1.0] + [1e3] * 9)
    rows = parameter_rows(identification)
    assert np.allclose([row.exact for row in rows], exact * scale, rtol=1e-15)
    for row, sigma in zip(rows, shown_sigmas(estimate) * scale, strict=True):
        assert abs(float(row.value) - row.exact) <= 0.0501 * sigma
        assert abs(float(row.sigma) - sigma) <= 0.0501 * sigma


def test_what_rest_cannot_show_says_why(static_identification: Identification) -> None:
    rows = parameter_rows(static_identification)
    assert [row.value for row in rows[4:]] == [NOT_IDENTIFIABLE] * 6
    assert all("angular acceleration about x, y, z was 0, 0, 0 rad/s²" in row.reason for row in rows[4:])
    assert not any(row.reason for row in rows[:4])


def test_a_value_that_is_named_unidentified_is_not_shown(identification: Identification) -> None:
    estimate = with_estimate(identification, unidentified=("cz",)).estimate
    assert np.flatnonzero(np.isnan(shown_parameters(estimate))).tolist() == [3]
