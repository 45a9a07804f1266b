"""The payload as an object of a scene: its inertia and covariance stay symmetric in any attitude."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poise.assembly.scene import Box, RigidObject
from poise.geometry import Pose
from poise.inertia import InertialParameters
from poise.nodes.estimate_message import inertia_message
from poise.nodes.payload import weighed
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
