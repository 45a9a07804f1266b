"""The payload as an object of a scene: its inertia and covariance stay symmetric in any attitude."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poise.assembly.scene import Box, RigidObject
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.inertia import InertialParameters
from poise.nodes.estimate_message import inertia_message
from poise.nodes.payload import GraspedPayload, weighed
from poise_msgs.msg import ErrorCode as ErrorCodeMessage
from poise_msgs.msg import InertialEstimate


@pytest.mark.parametrize("seed", range(20))
def test_a_large_inertia_in_any_attitude_is_accepted(seed):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=rng).as_matrix()
    inertia = turn @ np.diag([60.0, 80.0, 100.0]) @ turn.T
    estimate = InertialEstimate(consistent=True)
    pose = Pose(Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3))
    com = pose.apply(rng.uniform(-0.2, 0.2, 3))
    estimate.inertia = inertia_message(InertialParameters(40.0, com, (inertia + inertia.T) / 2))
    estimate.covariance = np.eye(10).ravel()
    item = RigidObject("crate", Box(np.array([2.0, 1.0, 1.0])), Pose.identity(), mass=1.0)
    found = weighed(item, estimate, pose)
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


@pytest.mark.parametrize("code", [ErrorCode.ZEROED_UNDER_LOAD, ErrorCode.LEFT_HANDED_AXES, ErrorCode.IN_CONTACT])
def test_an_estimate_that_its_findings_question_is_not_taken(code):
    payload = GraspedPayload(5.0)
    finding = ErrorCodeMessage(code=code, message="look at the sensor")
    with pytest.raises(InputError, match="look at the sensor") as raised:
        payload.take(hand(3.0, 10, findings=[finding]), 0.0)
    assert (raised.value.code, payload.estimate) == (code, None)
    assert payload.take(hand(3.0, 10, findings=[ErrorCodeMessage(code=ErrorCode.PAYLOAD_CHANGED)]), 0.0)
    with pytest.raises(InputError):
        payload.take(hand(2.0, 20, findings=[finding]), 0.0)
    payload.take(hand(1.0, 30, findings=[finding]), 0.0)  # the release, all the same
    assert not payload.take(hand(9.0, 40), 0.0)
    assert payload.estimate.inertia.m == 3.0


@pytest.mark.parametrize("mass", [np.inf, 1e300, 1e-300])
def test_a_mass_that_no_object_has_is_not_taken(mass):
    with pytest.raises(InputError, match="mass"):
        GraspedPayload(5.0).take(hand(mass, 0), 0.0)


def test_a_centre_of_mass_far_off_the_shape_is_of_another_frame():
    estimate = InertialEstimate(consistent=True)
    estimate.inertia = inertia_message(InertialParameters(2.0, np.array([0.0, 0.0, 3.0]), 0.1 * np.eye(3)))
    item = RigidObject("crate", Box(np.array([0.5, 0.5, 0.5])), Pose.identity(), mass=1.0)
    with pytest.raises(InputError, match="object frame"):
        weighed(item, estimate, Pose.identity())
    there = Pose(np.eye(3), np.array([0.0, 0.0, 2.9]))
    estimate.covariance = (1e-6 * np.eye(10)).ravel()
    assert weighed(item, estimate, there).com[2] == pytest.approx(0.1)
    estimate.covariance[0] = -1.0  # an assembly with it would be refused
    with pytest.raises(InputError, match="positive semi-definite"):
        weighed(item, estimate, there)
