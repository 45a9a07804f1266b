"""Error measures of thesis chapter 3: closed forms, invariances, and the formula that the thesis misprints."""

import numpy as np
import pytest
from problems import BOX, box_body
from scipy.spatial.transform import Rotation
from simulated_loads import random_body

from poise.errors import ErrorCode, InputError
from poise.inertia.model.metrics import (
    com_errors,
    effort_error,
    errors,
    expected_errors,
    inertia_errors,
    mass_error,
    predict_wrench,
    riemannian_error,
)
from poise.inertia.model.parameters import UPPER, InertialParameters
from poise.robot.motion import SensorMotion


def any_motion(rng: np.random.Generator, n: int = 50) -> SensorMotion:
    return SensorMotion(
        np.arange(n) * 10_000_000, Rotation.random(n, random_state=rng).as_matrix(), *rng.normal(size=(3, n, 3))
    )


def test_a_perfect_estimate_has_no_error() -> None:
    body = box_body()
    found = errors(body, body, BOX)
    assert (found.mass, found.com, found.inertia) == (0, 0, 0)
    assert found.riemannian == pytest.approx(0, abs=1e-7)
    assert found.consistent


def test_errors_are_shares_of_the_bounding_box_and_of_the_solid_cuboid() -> None:
    truth = box_body()
    estimate = InertialParameters(1.1 * truth.mass, truth.com + 0.01 * BOX, 2 * truth.inertia)
    assert mass_error(estimate, truth) == pytest.approx(10)
    np.testing.assert_allclose(com_errors(estimate, truth, BOX), 1)
    # Twice the inertia of a solid cuboid is wrong by exactly one cuboid.
    np.testing.assert_allclose(np.diag(inertia_errors(estimate, truth, BOX)), 100)


def test_products_of_inertia_are_measured_in_masses_times_two_sides() -> None:
    truth = box_body()
    product = 0.5 * truth.mass / 12 * BOX[0] * BOX[2]
    estimate = InertialParameters(
        truth.mass, truth.com, truth.inertia + product * np.eye(3)[[2, 1, 0]] * [[1], [0], [1]]
    )
    assert inertia_errors(estimate, truth, BOX)[0, 2] == pytest.approx(50)


def test_errors_do_not_depend_on_mass_and_size(rng: np.random.Generator) -> None:
    truth, estimate = random_body(rng), random_body(rng)

    def grown(body: InertialParameters) -> InertialParameters:
        return InertialParameters(7 * body.mass, 3 * body.com, 7 * 9 * body.inertia)

    small, large = errors(estimate, truth, BOX), errors(grown(estimate), grown(truth), 3 * BOX)
    for name in ("mass", "com", "inertia", "riemannian"):
        assert getattr(large, name) == pytest.approx(getattr(small, name))


def test_the_inertia_error_is_about_the_centre_of_mass() -> None:
    truth = box_body(at=(0.5, 0, 0))
    estimate = InertialParameters(truth.mass, truth.com + np.array([0.01, 0, 0]), truth.inertia)
    assert errors(estimate, truth, BOX).inertia == pytest.approx(0)


def test_e_rie_is_a_distance_that_no_frame_changes(rng: np.random.Generator) -> None:
    one, two = random_body(rng), random_body(rng)
    rotation, translation = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)
    moved = [body.in_frame(rotation, translation) for body in (one, two)]
    assert riemannian_error(*moved) == pytest.approx(riemannian_error(one, two), rel=1e-9)
    assert riemannian_error(two, one) == pytest.approx(riemannian_error(one, two), rel=1e-9)


def test_e_rie_of_a_body_s_times_as_heavy_is_root_two_times_log_s() -> None:
    body = box_body()
    heavier = InertialParameters.from_phi(3 * body.phi)
    assert riemannian_error(heavier, body) == pytest.approx(np.sqrt(2) * np.log(3))


def test_equation_3_29_as_printed_is_not_zero_for_a_perfect_estimate() -> None:
    body = box_body()
    eigenvalues = np.linalg.eigvals(np.linalg.inv(body.pseudo_inertia) @ body.pseudo_inertia).real
    assert np.sqrt(np.sum(eigenvalues) / 2) == pytest.approx(np.sqrt(2))
    assert riemannian_error(body, body) == pytest.approx(0, abs=1e-7)


@pytest.mark.parametrize(
    "inertia", [np.diag([1e-3, 1e-3, 3e-3]), np.diag([1e-3, 1e-3, -1e-3]), np.full((3, 3), np.nan)]
)
def test_e_rie_is_undefined_for_what_cannot_exist(inertia: np.ndarray) -> None:
    assert np.isnan(riemannian_error(InertialParameters(0.8, np.zeros(3), inertia), box_body()))


def test_expected_errors_are_the_means_of_errors_drawn_from_the_covariance(rng: np.random.Generator) -> None:
    truth = box_body()
    root = rng.normal(size=(10, 10)) * 1e-5 * truth.mass
    drawn = truth.phi + rng.normal(size=(4000, 10)) @ root.T
    found = [errors(InertialParameters.from_phi(phi), truth, BOX) for phi in drawn]
    shares, deviations = expected_errors(root @ root.T, truth, BOX)
    means = np.mean([(one.mass, one.com, one.inertia) for one in found], axis=0)
    np.testing.assert_allclose(shares, means, rtol=0.05)
    inertias = [InertialParameters.from_phi(phi).inertia[UPPER] for phi in drawn]
    np.testing.assert_allclose(deviations[4:], np.std(inertias, axis=0), rtol=0.06)


def test_effort_at_rest_is_the_weight_at_the_centre_of_mass(rng: np.random.Generator) -> None:
    body = random_body(rng)
    attitude = Rotation.random(5, random_state=rng).as_matrix()
    wrench = predict_wrench(body, SensorMotion.at_rest(np.arange(5), attitude))
    weight = body.mass * np.array([0, 0, -9.80665]) @ attitude
    np.testing.assert_allclose(wrench[:, :3], weight)
    np.testing.assert_allclose(wrench[:, 3:], np.cross(body.com, weight), atol=1e-12)


def test_a_load_thought_one_percent_heavier_costs_one_percent_more_effort(rng: np.random.Generator) -> None:
    body = random_body(rng)
    heavier = InertialParameters.from_phi(1.01 * body.phi)
    np.testing.assert_allclose(effort_error(heavier, body, any_motion(rng)), 1, rtol=1e-9)


@pytest.mark.parametrize("box", [[1, 1, 0], [1, 1], [1, np.nan, 1]])
def test_a_bounding_box_without_size_is_refused(box: list[float]) -> None:
    with pytest.raises(InputError) as caught:
        errors(box_body(), box_body(), box)
    assert caught.value.code == ErrorCode.BAD_INPUT


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)
