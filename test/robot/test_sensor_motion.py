"""SensorMotion: shapes checked on input, gravity seen from the sensor, samples picked."""

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.robot import SensorMotion

TURNED_ABOUT_X = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # sensor z points along world -y


def test_gravity_is_seen_along_the_axis_that_points_up():
    motion = SensorMotion.at_rest([0, 1], [np.eye(3), TURNED_ABOUT_X])
    np.testing.assert_allclose(motion.gravity_in_sensor([0, 0, -9.81]), [[0, 0, -9.81], [0, -9.81, 0]], atol=1e-15)
    np.testing.assert_allclose(motion.gravity_in_sensor()[0], [0, 0, -9.80665])


def test_select_keeps_all_fields_in_step():
    stamps = np.arange(5) * 10
    vectors = np.arange(15.0).reshape(5, 3)
    motion = SensorMotion(stamps, np.tile(np.eye(3), (5, 1, 1)), vectors, 2 * vectors, 3 * vectors)
    picked = motion.select(np.array([False, True, False, True, False]))
    assert len(picked) == 2
    np.testing.assert_array_equal(picked.stamps, [10, 30])
    np.testing.assert_array_equal(picked.angular_acceleration_in_sensor, 2 * vectors[[1, 3]])
    np.testing.assert_array_equal(picked.linear_acceleration_in_sensor, 3 * vectors[[1, 3]])


def test_arrays_are_frozen_and_the_callers_stay_writeable():
    rotations = np.tile(np.eye(3), (2, 1, 1))
    motion = SensorMotion.at_rest([0, 1], rotations)
    with pytest.raises(ValueError, match="read-only"):
        motion.rotation_world_sensor[0, 0, 0] = 2.0
    rotations[0, 0, 0] = 1.0


def test_shapes_that_do_not_belong_together_are_refused_by_name():
    with pytest.raises(InputError, match="rotation_world_sensor") as caught:
        SensorMotion(np.arange(3), np.eye(3), *(np.zeros((3, 3)),) * 3)
    assert caught.value.code is ErrorCode.TYPE_MISMATCH
