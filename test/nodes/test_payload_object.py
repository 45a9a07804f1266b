"""The payload as an object of a scene: its inertia and covariance stay symmetric in any attitude."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poise.assembly.scene import Box, RigidObject
from poise.geometry import Pose
from poise.inertia import InertialParameters
from poise.nodes.estimate_message import inertia_message
from poise.nodes.payload import GraspedPayload, weighed
from poise_msgs.msg import InertialEstimate


@pytest.mark.parametrize("seed", range(20))
def test_a_large_inertia_in_any_attitude_is_accepted(seed):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=rng).as_matrix()
    inertia = turn @ np.diag([60.0, 80.0, 100.0]) @ turn.T
    estimate = InertialEstimate(consistent=True)
    estimate.inertia = inertia_message(InertialParameters(40.0, rng.normal(size=3), (inertia + inertia.T) / 2))
    estimate.covariance = np.eye(10).ravel()
    item = RigidObject("crate", Box(np.array([0.5, 0.5, 0.5])), Pose.identity(), mass=1.0)
    found = weighed(item, estimate, Pose(Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)))
    np.testing.assert_array_equal(found.inertia, found.inertia.T)
    np.testing.assert_array_equal(found.covariance, found.covariance.T)
    np.testing.assert_allclose(np.linalg.eigvalsh(found.inertia), [60.0, 80.0, 100.0])


def test_what_is_not_identified_is_kept():
    estimate = InertialEstimate(unidentified=["cy", "ixz"], covariance=np.eye(10).ravel())
    estimate.inertia = inertia_message(InertialParameters(4.0, np.ones(3), 9 * np.eye(3)))
    com, inertia = np.array([0.0, 0.1, 0.0]), 0.2 * np.eye(3)
    item = RigidObject(
        "crate", Box(np.array([0.5, 0.5, 0.5])), Pose.identity(), mass=2.0, com=com, inertia=inertia, covariance=None
    )
    found = weighed(item, estimate, Pose.identity())
    assert (found.mass, found.com.tolist(), found.covariance) == (4.0, com.tolist(), None)
    np.testing.assert_allclose(found.inertia, 2 * inertia)


def hand(mass, since, **values):
    found = InertialEstimate(consistent=True, **values)
    found.inertia.m, found.since.sec = mass, since
    return found


def test_the_weight_of_the_object_is_that_of_the_hand_from_its_grasp_to_its_release():
    payload = GraspedPayload(5.0)
    steps = [
        (hand(0.05, 0), 0.05),  # a hand that was not tared
        (hand(4.0, 50), 4.0),  # the grasp
        (hand(4.1, 50), 4.1),
        (hand(3.0, 60), 3.0),  # something was spilled
        (hand(2e-5, 70, unidentified=["m"]), 3.0),  # the release
        (hand(9.0, 80), 3.0),  # another object
    ]
    for estimate, kept in steps:
        payload.take(estimate, 0.0)
        assert payload.estimate.inertia.m == kept
    payload.left_assembly()
    assert payload.estimate is None
    assert payload.take(hand(3.2, 90), 0.0)
    payload.left_assembly()  # it is in the hand
    assert payload.estimate.inertia.m == 3.2
