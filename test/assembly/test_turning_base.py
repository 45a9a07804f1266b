"""The base under an assembly: how its tilt turns gravity, how odometry gives its turning rate, and what that leaves."""

import numpy as np
import pytest
from assembly_scenes import G, box, cube, on_floor

from poise.assembly import Analysis, acceleration_limits
from poise.assembly.robustness.turning_base import SMOOTHING, TurningBase
from poise.errors import ErrorCode, InputError
from poise.geometry import rotation_of_quaternion

LEVEL = TurningBase(np.array([0.0, 0.0, 1.0]))


def test_a_tilted_base_feels_gravity_as_its_rotation_says():
    roll, pitch = 0.3, -0.2
    turn_x = rotation_of_quaternion([np.sin(roll / 2), 0, 0, np.cos(roll / 2)])
    turn_y = rotation_of_quaternion([0, np.sin(pitch / 2), 0, np.cos(pitch / 2)])
    base = TurningBase.tilted(roll, pitch, 0.0, 0.0)
    np.testing.assert_allclose(base.gravity(np.array([0, 0, -G])), (turn_y @ turn_x).T @ [0, 0, -G], atol=1e-12)
    np.testing.assert_allclose(TurningBase(np.array([0.0, 0, -1])).gravity(np.array([0, 0, -G])), [0, 0, G])


def test_odometry_gives_the_attitude_and_the_smoothed_turning():
    half = 0.1
    quaternion = [0, np.sin(half), 0, np.cos(half)]
    base, speed = LEVEL, 0.0
    for _ in range(400):
        speed += 0.01 * 0.5
        base = base.after(0.01, quaternion, speed)
    np.testing.assert_allclose(base.up, [-np.sin(2 * half), 0, np.cos(2 * half)], atol=1e-12)
    # A first-order filter follows a ramp with its slope, late by its time constant.
    assert base.acceleration == pytest.approx(0.5, rel=1e-6)
    assert base.speed == pytest.approx(speed - 0.5 * SMOOTHING, abs=0.5 * 0.01)
    assert base.after(-1.0, quaternion, 3.0).acceleration == 0.0
    for wrong in (float("nan"), 1e300, -101.0):
        with pytest.raises(InputError) as raised:
            base.after(0.1, quaternion, wrong)
        assert raised.value.code == ErrorCode.NOT_FINITE


def test_what_turning_leaves_is_sustained_where_it_can_be_solved():
    """A block on a turntable, small enough that only its centre matters: |a + centrifugal| <= mu g."""
    mu, radius, speed = 0.5, 1.0, 1.5
    block = on_floor(box("block", (0.02, 0.02, 0.001), (radius, 0, 0.0005)), friction=mu)
    found = acceleration_limits(Analysis.of(block), 16)
    assert found.angular_speed**2 * radius == pytest.approx(mu * G, rel=5e-3)
    turning = found.while_turning(speed, 0.0)
    felt = -turning.directions * turning.limits[:, None] + [speed**2 * radius, 0, 0]
    assert np.all(np.linalg.norm(felt, axis=1) <= mu * G * (1 + 1e-6))
    assert not np.any(found.while_turning(10.0, 0.0).limits)
    assert not np.any(found.while_turning(1.0, found.angular_acceleration).offsets)
    np.testing.assert_array_equal(found.while_turning(0.0, 0.0).limits, found.limits)


def test_the_axis_of_turning_may_be_anywhere():
    about_origin = acceleration_limits(Analysis.of(cube()), 4)
    shifted = on_floor(box("cube", (1, 1, 1), (2, -1, 0.5)))
    about_itself = acceleration_limits(Analysis.of(shifted), 4, axis=(2, -1))
    assert about_itself.angular_acceleration == pytest.approx(about_origin.angular_acceleration, rel=1e-6)
    assert acceleration_limits(Analysis.of(shifted), 4).angular_speed < 0.2 * min(about_itself.angular_speed, 1e3)
