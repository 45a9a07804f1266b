"""The regressor against pinocchio's RNEA, under changes of frame, and at rest."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from simulated_loads import random_body, random_motion

from poise.geometry import cross_matrix
from poise.inertia import frame_change
from poise.inertia.model import regressor


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def test_the_wrench_is_what_pinocchios_rnea_says_with_the_sign_of_the_load(rng):
    """A free-flying body: RNEA gives what must push it; the load pushes back on the sensor."""
    for _ in range(100):
        body = random_body(rng)
        model = pin.Model()
        joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "sensor")
        model.appendBodyToJoint(
            joint, pin.Inertia(body.mass, np.array(body.com), np.array(body.inertia)), pin.SE3.Identity()
        )
        attitude = Rotation.random(random_state=rng)
        q = np.concatenate([rng.normal(size=3), attitude.as_quat()])
        v, a = rng.normal(0.0, 2.0, (2, 6))
        effort = pin.rnea(model, model.createData(), q, v, a)
        gravity_in_sensor = attitude.apply(model.gravity.linear, inverse=True)
        # Pinocchio's body acceleration is spatial; that of the origin adds omega x v.
        acceleration = a[:3] + np.cross(v[3:], v[:3])
        wrench = regressor(gravity_in_sensor - acceleration, v[3:], a[3:]) @ body.phi
        np.testing.assert_allclose(wrench, -effort, atol=1e-11)


def test_at_rest_the_force_is_the_weight_and_the_torque_its_lever(rng):
    body = random_body(rng)
    gravity_in_sensor = np.array([0.0, 3.0, -9.0])
    wrench = regressor(gravity_in_sensor, np.zeros(3), np.zeros(3)) @ body.phi
    np.testing.assert_allclose(wrench[:3], body.mass * gravity_in_sensor)
    np.testing.assert_allclose(wrench[3:], np.cross(body.com, body.mass * gravity_in_sensor))


def test_the_wrench_does_not_depend_on_the_frame_it_is_computed_in(rng):
    """Move the origin and turn the axes: motion, parameters and wrench all follow, and still agree."""
    body = random_body(rng)
    specific, omega, alpha = random_motion(rng, 40)
    rotation, translation = Rotation.random(random_state=rng).as_matrix(), rng.normal(0.0, 0.3, 3)
    wrench = regressor(specific, omega, alpha) @ body.phi
    # The new origin, seen from the old frame, and its acceleration.
    origin = -rotation.T @ translation
    specific_at_new = specific - np.cross(alpha, origin) - np.cross(omega, np.cross(omega, origin))
    moved = regressor(specific_at_new @ rotation.T, omega @ rotation.T, alpha @ rotation.T)
    wrench_in_new = moved @ frame_change(rotation, translation) @ body.phi
    force, torque = wrench[:, :3], wrench[:, 3:]
    np.testing.assert_allclose(wrench_in_new[:, :3], force @ rotation.T, atol=1e-12)
    np.testing.assert_allclose(wrench_in_new[:, 3:], (torque - np.cross(origin, force)) @ rotation.T, atol=1e-12)


def test_many_samples_at_once_are_the_same_as_one_by_one(rng):
    motion = random_motion(rng, 20)
    together = regressor(*motion)
    for k in range(20):
        np.testing.assert_array_equal(together[k], regressor(*(part[k] for part in motion)))


def test_the_cross_matrix_is_the_cross_product(rng):
    a, b = rng.normal(size=(2, 30, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", cross_matrix(a), b), np.cross(a, b), atol=1e-15)
