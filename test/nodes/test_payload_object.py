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
    estimate = InertialEstimate()
    estimate.inertia = inertia_message(InertialParameters(40.0, rng.normal(size=3), (inertia + inertia.T) / 2))
    estimate.covariance = np.eye(10).ravel()
    item = RigidObject("crate", Box(np.array([0.5, 0.5, 0.5])), Pose.identity(), mass=1.0)
    found = weighed(item, estimate, Pose(Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)))
    np.testing.assert_array_equal(found.inertia, found.inertia.T)
    np.testing.assert_array_equal(found.covariance, found.covariance.T)
    np.testing.assert_allclose(np.linalg.eigvalsh(found.inertia), [60.0, 80.0, 100.0])
