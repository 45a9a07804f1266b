"""InertialParameters: the 10-vector and back, bodies that can exist, other frames, sums of bodies."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from simulated_loads import random_body

from poise.errors import ErrorCode, InputError
from poise.inertia import InertialParameters, about_com_jacobian, frame_change, phi_of_pseudo_inertia, pseudo_inertia

# Pinocchio orders the inertia xx xy yy xz yz zz.
FROM_PINOCCHIO = [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def random_frame(rng: np.random.Generator):
    return Rotation.random(random_state=rng).as_matrix(), rng.normal(0.0, 0.5, 3)


def test_phi_agrees_with_pinocchio(rng):
    for _ in range(50):
        body = random_body(rng)
        theirs = pin.Inertia(body.mass, np.array(body.com), np.array(body.inertia)).toDynamicParameters()
        np.testing.assert_allclose(body.phi, theirs[FROM_PINOCCHIO], rtol=1e-12, atol=1e-15)


def test_phi_and_back_is_the_same_body(rng):
    for _ in range(50):
        body = random_body(rng)
        again = InertialParameters.from_phi(body.phi)
        assert again.mass == pytest.approx(body.mass, rel=1e-14)
        np.testing.assert_allclose(again.com, body.com, atol=1e-14)
        np.testing.assert_allclose(again.inertia, body.inertia, atol=1e-14)


def test_a_uniform_box_has_the_textbook_inertia():
    # A box (a, b, c) on the origin's corner, by summing a fine grid of points: an independent route to phi.
    sides, mass, n = np.array([0.2, 0.1, 0.3]), 2.0, 40
    axes = [(np.arange(n) + 0.5) / n * side for side in sides]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    homogeneous = np.column_stack([points, np.ones(len(points))])
    phi = phi_of_pseudo_inertia(mass / len(points) * homogeneous.T @ homogeneous)
    body = InertialParameters.from_phi(phi)
    squares = sides**2
    np.testing.assert_allclose(body.com, sides / 2, rtol=1e-12)
    np.testing.assert_allclose(body.inertia, np.diag(mass / 12 * (squares.sum() - squares)), rtol=1e-3, atol=1e-12)


def test_pseudo_inertia_is_linear_and_its_inverse_exact(rng):
    a, b = rng.normal(size=(2, 10))
    np.testing.assert_allclose(pseudo_inertia(2 * a - b), 2 * pseudo_inertia(a) - pseudo_inertia(b), atol=1e-14)
    np.testing.assert_allclose(phi_of_pseudo_inertia(pseudo_inertia(a)), a, atol=1e-14)


def test_any_real_body_is_consistent_and_is_so_in_every_frame(rng):
    for _ in range(200):
        body = random_body(rng)
        assert body.is_consistent
        assert body.in_frame(*random_frame(rng)).is_consistent
        assert np.linalg.eigvalsh(body.pseudo_inertia)[0] > 0


@pytest.mark.parametrize(
    ("mass", "principal"),
    [
        (-1.0, (0.1, 0.1, 0.1)),  # no mass is negative
        (0.0, (0.1, 0.1, 0.1)),
        (1.0, (0.1, 0.1, 0.21)),  # breaks the triangle inequality, though positive definite
        (1.0, (0.1, 0.1, 0.2)),  # a flat disc without thickness: the edge of what can exist
        (1.0, (-0.1, 0.1, 0.1)),
        (1.0, (0.0, 0.0, 0.0)),
    ],
)
def test_what_cannot_exist_is_not_consistent(mass, principal, rng):
    rotation = Rotation.random(random_state=rng).as_matrix()
    inertia = rotation @ np.diag(principal) @ rotation.T
    assert not InertialParameters(mass, rng.normal(size=3), (inertia + inertia.T) / 2).is_consistent


def test_consistency_agrees_with_the_pseudo_inertia_on_random_vectors(rng):
    verdicts = []
    for _ in range(500):
        phi = random_body(rng).phi + rng.normal(0.0, 0.003, 10)
        verdicts.append(InertialParameters.from_phi(phi).is_consistent)
        assert verdicts[-1] == bool(np.linalg.eigvalsh(pseudo_inertia(phi))[0] > 0)
    assert 50 < sum(verdicts) < 450


def test_unknown_inertia_leaves_consistency_to_the_mass():
    unknown = np.full((3, 3), np.nan)
    assert InertialParameters(1.0, np.zeros(3), unknown).is_consistent
    assert not InertialParameters(-1.0, np.zeros(3), unknown).is_consistent
    assert not InertialParameters(np.nan, np.zeros(3), np.eye(3)).is_consistent


def test_an_unknown_entry_makes_unknown_only_what_depends_on_it():
    phi = np.array([2.0, 0.02, np.nan, 0.04, 0.1, 0.01, 0.01, 0.1, 0.01, np.nan])
    body = InertialParameters.from_phi(phi)
    np.testing.assert_array_equal(np.isnan(body.com), [False, True, False])
    np.testing.assert_array_equal(np.isnan(body.inertia_vector), [True, True, False, False, True, True])


def test_another_frame_and_back_is_the_same_body(rng):
    for _ in range(50):
        body = random_body(rng)
        rotation, translation = random_frame(rng)
        back = body.in_frame(rotation, translation).in_frame(rotation.T, -rotation.T @ translation)
        np.testing.assert_allclose(back.phi, body.phi, atol=1e-13)


def test_the_linear_frame_change_does_what_the_body_does(rng):
    for _ in range(50):
        body = random_body(rng)
        rotation, translation = random_frame(rng)
        matrix = frame_change(rotation, translation)
        np.testing.assert_allclose(matrix @ body.phi, body.in_frame(rotation, translation).phi, atol=1e-13)


def test_frame_changes_compose(rng):
    (ra, ta), (rb, tb) = random_frame(rng), random_frame(rng)
    composed = frame_change(rb @ ra, rb @ ta + tb)
    np.testing.assert_allclose(frame_change(rb, tb) @ frame_change(ra, ta), composed, atol=1e-13)


def test_a_gripper_is_taken_away_again(rng):
    payload, gripper = random_body(rng), random_body(rng)
    held = payload + gripper
    assert held.mass == pytest.approx(payload.mass + gripper.mass)
    theirs = pin.Inertia(payload.mass, np.array(payload.com), np.array(payload.inertia)) + pin.Inertia(
        gripper.mass, np.array(gripper.com), np.array(gripper.inertia)
    )
    np.testing.assert_allclose(held.inertia, theirs.inertia, atol=1e-13)
    np.testing.assert_allclose((held - gripper).phi, payload.phi, atol=1e-13)


def test_the_jacobian_of_centre_and_inertia_is_that_of_finite_differences(rng):
    def about_com(phi):
        body = InertialParameters.from_phi(phi)
        return np.concatenate([body.com, body.inertia_vector])

    step = 1e-6
    for _ in range(20):
        phi = random_body(rng).phi
        columns = [(about_com(phi + step * unit) - about_com(phi - step * unit)) / (2 * step) for unit in np.eye(10)]
        np.testing.assert_allclose(about_com_jacobian(phi), np.stack(columns, axis=1), atol=1e-7)


def test_parameters_cannot_be_changed_and_do_not_follow_the_callers_arrays(rng):
    com = np.zeros(3)
    body = InertialParameters(1.0, com, np.eye(3))
    com[0] = 5.0
    assert body.com[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        body.com[0] = 1.0


@pytest.mark.parametrize(
    ("com", "inertia", "code"),
    [
        (np.zeros(2), np.eye(3), ErrorCode.TYPE_MISMATCH),
        (np.zeros(3), np.ones(6), ErrorCode.TYPE_MISMATCH),
        (np.zeros(3), np.arange(9.0).reshape(3, 3), ErrorCode.BAD_INPUT),
    ],
)
def test_what_is_no_inertia_is_refused_with_a_code(com, inertia, code):
    with pytest.raises(InputError) as caught:
        InertialParameters(1.0, com, inertia)
    assert caught.value.code is code


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("phi", [[1e-320, 1e300, 0, 0, 1, 0, 0, 1, 0, 1], [1, 1e200, 1e200, 0, 1, 0, 0, 1, 0, 1]])
def test_numbers_that_overflow_give_no_body_and_no_warning(phi):
    body = InertialParameters.from_phi(phi)
    assert not np.isfinite(body.phi).all()
    assert not body.is_consistent
