"""Sensor effects against closed forms: matrices, filters, shifted clocks, stairs and limits."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from effect_worlds import NOISE, PAYLOAD, filled, recorded
from scipy.spatial.transform import Rotation

from poise.mismatch.effects import effect_named
from poise.mismatch.effects.saturation import limited_readings, plateau
from poise.mismatch.recorded import lattice, load_wrench
from poise.robot import inertia_of, phi_of


def response(name, at, **given):
    effect = effect_named(name)
    return effect.simulate(at, filled(effect, at, given))


def saying(course):
    """A world at uneven stamps in which the sensor should read `course(t)` in every channel."""
    at = recorded()
    return at.with_prediction(np.repeat(course(at.seconds)[:, None], 6, axis=1))


def test_a_bias_is_the_same_at_all_times_and_a_drift_is_told_by_its_whole_change():
    at = recorded()
    bias = response("sensor_bias", at, force_y=2.0, torque_z=-0.1)
    np.testing.assert_array_equal(bias, np.broadcast_to([0, 2.0, 0, 0, 0, -0.1], bias.shape))
    drift = response("bias_drift", at, force_x=0.6, torque_y=0.03)
    np.testing.assert_allclose(drift[-1] - drift[0], [0.6, 0, 0, 0, 0.03, 0], atol=1e-12)
    np.testing.assert_allclose(drift[0] + drift[-1], 0.0, atol=1e-12)
    rate = np.diff(drift[:, 0]) / np.diff(at.seconds)
    np.testing.assert_allclose(rate, 0.6 / at.duration, rtol=1e-6)
    warming = response("bias_drift", at, force_x=0.6, zero=0.0, time_constant=3.0)[:, 0]
    passed = at.seconds - at.seconds[0]
    np.testing.assert_allclose(warming, 0.6 * (1 - np.exp(-passed / 3)) / (1 - np.exp(-passed[-1] / 3)), atol=1e-12)


def test_a_gain_that_warms_up_scales_the_whole_load():
    at = recorded()
    grown = response("gain_drift", at, gain=0.04, zero=0.0, time_constant=3.0)
    course = response("bias_drift", at, force_x=1.0, zero=0.0, time_constant=3.0)[:, :1]
    np.testing.assert_allclose(grown, 0.04 * course * at.prediction, atol=1e-12)


def test_a_gain_that_drifts_needs_a_load_that_changes():
    """Where a load hangs still, a zero that drifts along it has the same response, and is as likely."""
    at = recorded()
    still = at.with_prediction(np.broadcast_to(at.prediction[0], at.prediction.shape))
    gain, drift = effect_named("gain_drift"), effect_named("bias_drift")
    values = filled(gain, at, {"gain": 0.04})
    assert gain.implausible(at, values) == ""
    assert "hardly changes" in gain.implausible(still, values)
    axes = [p.name for p in drift.parameters(at) if p.linear]
    along = filled(drift, at, dict(zip(axes, 0.04 * at.prediction[0], strict=True)))
    assert drift.twins(still, along) == ("gain_drift",)
    assert drift.twins(at, along) == ()
    assert drift.twins(still, {**along, "force_x": along["force_x"] + 1.0}) == ()


def test_gain_is_a_matrix():
    at, matrix = recorded(), 0.05 * np.random.default_rng(0).normal(size=(6, 6))
    effect = effect_named("sensor_gain")
    values = dict(zip([p.name for p in effect.parameters(at) if p.linear], matrix.ravel().tolist(), strict=True))
    read = at.prediction + effect.simulate(at, values)
    np.testing.assert_allclose(read, at.prediction @ (np.eye(6) + matrix).T, atol=1e-12)
    units = {p.name: p.unit for p in effect.parameters(at)}
    assert (units["gain_fx_ty"], units["gain_tx_fy"], units["gain_tx_ty"]) == ("1/m", "m", "")


def test_a_turned_sensor_reads_what_the_load_exerts_in_its_own_axes():
    """The same load, described and moved in the turned axes, by pinocchio's placement of an inertia."""
    at, turn = recorded(), Rotation.from_rotvec([0.3, -0.2, 0.25]).as_matrix()
    phi = phi_of(inertia_of(PAYLOAD.phi).se3Action(pin.SE3(turn, np.zeros(3)).inverse()))
    exact = load_wrench(phi, at.specific @ turn, at.angular_velocity @ turn, at.angular_acceleration @ turn)
    found = response("sensor_rotation", at, rotation_x=0.3, rotation_y=-0.2, rotation_z=0.25)
    np.testing.assert_allclose(at.prediction + found, exact, atol=1e-10)


def test_a_nonlinear_sensor_is_odd_and_grows_as_it_says():
    at = recorded()
    values = {"quadratic_fx": 0.004, "cubic_fx": 1e-4, "cubic_tz": 0.02}
    found = response("sensor_nonlinearity", at, **values)
    np.testing.assert_allclose(response("sensor_nonlinearity", at.with_prediction(-at.prediction), **values), -found)
    doubled = response("sensor_nonlinearity", at.with_prediction(2 * at.prediction), quadratic_fx=0.004, cubic_tz=0.02)
    np.testing.assert_allclose(doubled[:, 0], 4 * 0.004 * at.prediction[:, 0] * np.abs(at.prediction[:, 0]))
    np.testing.assert_allclose(doubled[:, 5], 8 * found[:, 5])
    assert not found[:, 1:5].any()


@pytest.mark.parametrize("time_constant", [0.003, 0.02, 0.3])
def test_a_low_pass_answers_a_step_and_a_sine_as_in_the_book(time_constant):
    step = saying(lambda t: np.where(t > 5.0, 1.0, 0.0))
    begin = step.seconds[step.seconds <= 5.0][-1]
    width = step.seconds[step.seconds > 5.0][0] - begin
    read = (step.prediction + response("low_pass", step, time_constant=time_constant))[:, 0]
    since = step.seconds - begin - width
    # The step is a ramp over one interval: what is left at its end then dies away.
    left = time_constant / width * (1 - np.exp(-width / time_constant))
    after = since >= 0.0
    np.testing.assert_allclose(read[after], 1 - left * np.exp(-since[after] / time_constant), atol=1e-9)
    omega = 2 * np.pi * 1.5
    sine = saying(lambda t: np.sin(omega * t))
    read = (sine.prediction + response("low_pass", sine, time_constant=time_constant))[:, 3]
    gain, phase = 1 / np.hypot(1, omega * time_constant), -np.arctan(omega * time_constant)
    settled = sine.seconds > 12 * time_constant + 1
    np.testing.assert_allclose(read[settled], gain * np.sin(omega * sine.seconds[settled] + phase), atol=1e-3)


@pytest.mark.parametrize("bandwidth", [2.0, 8.0])
def test_a_butterworth_filter_answers_a_sine_as_in_the_book_and_delays_a_ramp_by_its_time_constant(bandwidth):
    constant = np.sqrt(2.0) / (2 * np.pi * bandwidth)
    sine = saying(lambda t: np.sin(2 * np.pi * 1.5 * t))
    read = (sine.prediction + response("low_pass", sine, second_order=1.0, time_constant=constant))[:, 3]
    ratio = 1.5 / bandwidth
    answer = 1.0 / (1.0 - ratio**2 + 1j * np.sqrt(2.0) * ratio)
    settled = sine.seconds > 20 * constant + 1
    expected = np.abs(answer) * np.sin(2 * np.pi * 1.5 * sine.seconds[settled] + np.angle(answer))
    np.testing.assert_allclose(read[settled], expected, atol=1e-3)
    ramp = saying(lambda t: t)
    read = (ramp.prediction + response("low_pass", ramp, second_order=1.0, time_constant=constant))[:, 0]
    np.testing.assert_allclose(read[settled], ramp.seconds[settled] - constant, atol=1e-6)


def test_creep_grows_to_its_share_with_its_time_constant():
    load = saying(lambda t: np.where(t > 2.0, 10.0, 0.0))
    found = response("sensor_creep", load, fraction=0.05, time_constant=3.0)[:, 0]
    since = load.seconds - load.seconds[load.seconds > 2.0][0]
    later = since > 0.0
    np.testing.assert_allclose(found[later], 0.5 * (1 - np.exp(-since[later] / 3.0)), atol=2e-3)
    assert not found[since < -0.02].any()


def test_clocks_shift_and_stretch():
    def course(t):
        return np.sin(2 * np.pi * 0.8 * t)

    at = saying(course)
    inside = (at.seconds > 0.5) & (at.seconds < 19.0)
    for delay in (0.037, -0.021):
        read = (at.prediction + response("clock_offset", at, offset=delay))[inside, 0]
        np.testing.assert_allclose(read, course(at.seconds[inside] - delay), atol=1e-5)
    read = (at.prediction + response("clock_skew", at, skew=0.004))[inside, 0]
    np.testing.assert_allclose(read, course(at.seconds[inside] / 1.004), atol=1e-5)


def test_quantised_readings_are_found_and_their_error_is_that_of_a_uniform_quantiser():
    at = recorded()
    noisy = at.with_prediction(at.prediction + np.random.default_rng(1).normal(size=at.prediction.shape) * NOISE)
    effect, steps = effect_named("quantisation"), {"force_step": 0.5, "torque_step": 0.02}
    error = effect.simulate(noisy, steps)
    size = np.repeat([0.5, 0.02], 3)
    assert (np.abs(error) <= size / 2 * (1 + 1e-9)).all()
    np.testing.assert_allclose(error.std(axis=0), size / np.sqrt(12), rtol=0.05)
    read = noisy.prediction + error
    found = effect.found(replace(at, wrench=read))
    assert found["force_step"] == pytest.approx(0.5, rel=1e-3)
    assert found["torque_step"] == pytest.approx(0.02, rel=1e-3)
    # A driver's own rounding, three decimals later, does not hide it; readings without a step have none.
    assert lattice(np.round(read[:, :3], 3)) == pytest.approx(0.5, rel=1e-3)
    assert effect.found(replace(at, wrench=noisy.prediction)) is None


def test_only_forces_may_be_quantised():
    at = recorded()
    rng = np.random.default_rng(2)
    read = at.prediction + rng.normal(size=at.prediction.shape) * NOISE
    read[:, :3] = np.round(read[:, :3] / 0.25) * 0.25
    found = effect_named("quantisation").found(replace(at, wrench=read))
    assert found["force_step"] == pytest.approx(0.25, rel=1e-3)
    assert found["torque_step"] == pytest.approx(1e-5)


def test_fine_steps_are_no_finding_although_an_axis_stands_at_a_limit():
    at = recorded()
    rng = np.random.default_rng(4)
    read = np.round((at.prediction + rng.normal(size=at.prediction.shape) * NOISE) / (0.3 * NOISE)) * 0.3 * NOISE
    effect = effect_named("quantisation")
    assert effect.found(replace(at, wrench=read)) is not None
    assert effect.detected(replace(at, wrench=read)) is None
    read[:, 0] = read[:, 0].max()
    assert effect.detected(replace(at, wrench=read)) is None


def test_a_limit_is_found_where_readings_stand_at_it_and_nowhere_else():
    at = recorded()
    noisy = at.prediction + np.random.default_rng(3).normal(size=at.prediction.shape) * NOISE
    effect = effect_named("saturation")
    limits = {"force_limit": 15.0, "torque_limit": 1e4}
    read = noisy + effect.simulate(at.with_prediction(noisy), limits)
    np.testing.assert_array_equal(read[:, :3], np.clip(noisy[:, :3], -15, 15))
    np.testing.assert_array_equal(read[:, 3:], noisy[:, 3:])
    seen = replace(at, wrench=read)
    (start,) = effect.starts(seen, read - at.prediction)
    assert start["force_limit"] == 15.0
    limited = limited_readings(seen)
    assert limited is not None
    np.testing.assert_array_equal(limited, np.abs(read) == np.repeat([15.0, np.inf], 3))
    assert effect.detected(seen) == start
    # A load that stays below the limit is not what the readings show.
    assert effect.detected(seen.with_prediction(0.8 * np.clip(at.prediction, -15, 15))) is None
    assert limited_readings(replace(at, wrench=noisy)) is None
    assert not list(effect.starts(replace(at, wrench=noisy), noisy - at.prediction))
    # Coarse steps repeat values too, without a limit.
    assert plateau(np.round(noisy[:, :3] / 0.5) * 0.5) == 0.0
