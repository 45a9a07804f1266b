"""Events against what the simulation says of a payload or a base that really does it."""

from dataclasses import replace

import numpy as np
import pytest
from effect_worlds import PAYLOAD, ROBOT, TYPICAL, filled, recorded, trajectory
from scipy.signal import butter, sosfilt

from poise.mismatch.answer.named import quantities
from poise.mismatch.effects import effect_named
from poise.mismatch.effects.part_wrench import shaking
from poise.mismatch.effects.plate import PLATE
from poise.mismatch.inference import FittedEffect
from poise.mismatch.reading import complete_values, recorded_from_motion
from poise.simulation import JointMotion

SECONDS = np.arange(0.0, 20.0, 0.005)


def response(name, at, **given):
    effect = effect_named(name)
    return effect.simulate(at, filled(effect, at, given))


def moved(shift=None, turn=0.0):
    """The arm's motion on a base that stands turned, and also moves level in the world: (N, 2) m, m/s, m/s2."""
    whole = trajectory().at(SECONDS)
    position, velocity, acceleration = (np.array(part) for part in whole)
    position[:, 2] += turn
    if shift is not None:
        for part, extra in zip((position, velocity, acceleration), shift, strict=True):
            part[:, :2] += extra
    return recorded_from_motion(ROBOT, SECONDS, JointMotion(position, velocity, acceleration), PAYLOAD.phi)


def with_payload(phi):
    return recorded_from_motion(ROBOT, SECONDS, trajectory().at(SECONDS), phi)


def point_phi(mass, place):
    """A point mass about the sensor's origin."""
    x, y, z = place
    inertia = [y * y + z * z, -x * y, -x * z, x * x + z * z, -y * z, x * x + y * y]
    return np.concatenate([[mass], mass * np.array(place), mass * np.array(inertia)])


def dropped(mass, place):
    """The wrench of the effect for a part that falls, and that of the payload without this part."""
    at = moved()
    moments = dict(zip(("moment_x", "moment_y", "moment_z"), -mass * np.array(place), strict=True))
    found = response("mass_step", at, time=9.3025, mass=-mass, **moments)
    after = at.seconds >= 9.3025
    assert not found[~after].any()
    return found[after], (with_payload(PAYLOAD.phi - point_phi(mass, place)).prediction - at.prediction)[after]


def test_a_dropped_part_is_another_payload_from_then_on():
    """Its inertia about the sensor goes with it: without that, fast motions after a drop looked like a leak."""
    centre = PAYLOAD.phi[1:4] / PAYLOAD.phi[0]
    np.testing.assert_allclose(*dropped(0.3, centre), atol=1e-9)
    # Of a part beside the centre, no more than m d^2 is missing, in torques of angular motion alone.
    off = np.array([0.02, -0.01, 0.015])
    found, true = dropped(0.3, centre + off)
    np.testing.assert_allclose(found[:, :3], true[:, :3], atol=1e-9)
    at = moved()
    turning = np.linalg.norm(at.angular_acceleration, axis=1) + np.sum(at.angular_velocity**2, axis=1)
    assert (np.linalg.norm(found - true, axis=1) <= 2.0 * 0.3 * off @ off * turning[at.seconds >= 9.3025] + 1e-9).all()


def test_a_part_that_moves_is_no_change_of_mass():
    """A loose part that changed its stop once was "8 g heavier", 0.76 m from the sensor."""
    at, step = recorded(), effect_named("mass_step")
    shift = {"time": 9.0, "returns": 0.0, "length": 1.0, "mass": 0.008, "moment_y": 0.004, "moment_z": 0.004}
    said = [step.sentence(at, filled(step, at, shift | {"mass": mass})) for mass in (0.008, 0.3)]
    moved_by = 1e3 * np.hypot(0.004, 0.004) / at.phi[0]
    assert f"its centre of mass by {moved_by:.0f} mm" in said[0]
    assert "became 300 g heavier" in said[1]


def test_a_leak_is_at_each_moment_the_payload_that_is_left():
    at = moved()
    values = {"start": 5.0, "length": 9.0, "rate": 0.01, "x": 0.03, "y": -0.02, "z": 0.12}
    found = at.prediction + response("mass_leak", at, **values)
    for moment in (3.0, 10.0, 19.0):
        lost = point_phi(-0.01 * min(max(moment - 5.0, 0.0), 9.0), (0.03, -0.02, 0.12))
        row = int(moment / 0.005)
        np.testing.assert_allclose(found[row], with_payload(PAYLOAD.phi + lost).prediction[row], atol=1e-9)
    effect = effect_named("mass_leak")
    derived = effect.derived(at, values)
    assert (derived["lost"][0], derived["end"][0]) == (pytest.approx(0.09), pytest.approx(14.0))
    assert "From 5.0 s to 14.0 s" in effect.sentence(at, values)
    earlier = values | effect.defaults  # of a model that an earlier version saved: to the end of the recording
    assert effect.derived(at, earlier) == {"lost": (pytest.approx(0.01 * (SECONDS[-1] - 5.0)), "kg")}


def test_a_base_that_moves_unnoticed_is_a_base_that_moves():
    still = moved(turn=0.7)
    effect = effect_named("base_motion")
    values = filled(effect, still, TYPICAL["base_motion"] | {"speed_y_3": -0.2, "speed_y_6": 0.1})
    columns = effect.rates(still.seconds, values)
    speed = np.array([[values[f"speed_{axis}_{k}"] for axis in "xy"] for k in range(columns[1].shape[1])])
    acceleration = np.zeros((len(SECONDS), 2))
    acceleration[columns[0]] = columns[1] @ speed
    velocity = np.vstack([np.zeros(2), np.cumsum((acceleration[1:] + acceleration[:-1]) * 0.0025, axis=0)])
    way = np.vstack([np.zeros(2), np.cumsum((velocity[1:] + velocity[:-1]) * 0.0025, axis=0)])
    true = moved((way, velocity, acceleration), turn=0.7)
    np.testing.assert_allclose(still.prediction + effect.simulate(still, values), true.prediction, atol=1e-8)
    # From rest to rest, as far as it says.
    assert np.abs(velocity[-1]).max() < 1e-3
    farthest = np.linalg.norm(way, axis=1).max()
    assert farthest == pytest.approx(effect.derived(still, values)["displacement"][0], rel=0.05)
    assert np.abs(acceleration).max() > 0.2


def test_a_contact_pushes_and_does_not_pull():
    still = moved(turn=0.7)
    effect = effect_named("contact")
    values = TYPICAL["contact"]
    assert effect.implausible(still, values) == ""
    swinging = {name: value * (-1.0) ** int(name[-1]) for name, value in values.items() if name.startswith("force_")}
    assert "would pull" in effect.implausible(still, values | swinging)


@pytest.mark.parametrize(("speed", "why"), [(0.1, ""), (-0.3, "move"), (1.5, "accelerate")])
def test_no_base_moves_metres_unnoticed(speed, why):
    still = moved(turn=0.7)
    effect = effect_named("base_motion")
    # A base that sways stays near its place; one that is pushed on does not.
    course = {f"speed_x_{k}": speed * (np.cos(np.pi * k) if speed > 0 else 1.0) for k in range(10)}
    values = filled(effect, still, {"start": 0.5, "length": 6.0, "splines": 10.0} | course)
    assert effect.implausible(still, values).startswith(f"the base would {why}" if why else "")
    assert bool(effect.implausible(still, values)) == bool(why)


def test_a_base_that_shakes_is_a_base_that_shakes():
    """Within the window, away from where the shaking comes and goes."""
    omega = 2 * np.pi * 13.0
    since = SECONDS - (4.0 + 3.0)
    wave = 0.4 * np.sin(omega * since) + 0.2 * np.cos(omega * since)
    rate = (-0.4 * np.cos(omega * since) + 0.2 * np.sin(omega * since)) / omega
    along = [np.stack([part, 0 * part], axis=1) for part in (-wave / omega**2, rate, wave)]
    still, true = moved(), moved(along)
    found = response("external_vibration", still, start=4.0, length=6.0, frequency=13.0, sine_x=0.4, cosine_x=0.2)
    inside = (SECONDS > 4.1) & (SECONDS < 9.9)
    np.testing.assert_allclose((still.prediction + found)[inside], true.prediction[inside], atol=1e-8)
    assert not found[(SECONDS < 3.9) | (SECONDS > 10.1)].any()
    effect = effect_named("external_vibration")
    derived = effect.derived(still, filled(effect, still, {"sine_x": 0.4, "cosine_x": 0.2}))
    assert derived["amplitude"][0] == pytest.approx(np.hypot(0.4, 0.2))
    assert abs(derived["direction_x"][0]) == pytest.approx(1.0)


def test_a_weak_line_counts_where_it_lasts_and_the_arm_does_not_move_at_its_frequency():
    """Errors of differentiated encoders change their phase; an arm that oscillates has them at its own frequency."""
    at = recorded(jitter=0.0)
    own = float(np.sqrt(np.mean(np.sum(at.linear_acceleration**2, axis=1))))
    wave = np.sin(2.0 * np.pi * 13.0 * at.seconds)
    inside = (at.seconds > 1.0) & (at.seconds < at.seconds[-1] - 1.0)

    def found(size, lasts=inside, moving=0.0):
        shaken = at.linear_acceleration + moving * own * wave[:, None]
        residual = np.zeros((len(at), 6))
        residual[:, :3] = -size * own * at.phi[0] * (wave * lasts)[:, None] * at.to_sensor(np.array([0.0, 0.0, 1.0]))
        noise = np.random.default_rng(1).normal(size=residual.shape) * np.repeat([0.1, 0.005], 3)
        moved = replace(at, linear_acceleration=shaken)
        return list(effect_named("external_vibration").starts(moved, residual + noise))

    assert at.duration > 15.0
    assert found(0.06)[0]["frequency"] == pytest.approx(13.0, abs=0.02)
    assert not found(0.06, moving=0.2)
    assert not found(0.06, lasts=(at.seconds > 5.0) & (at.seconds < 6.0))


def test_a_line_that_the_mains_put_into_the_channels_is_no_vibration():
    """It neither turns with the base nor has the lever of the load; a base that vibrates as much has both."""
    at, effect = recorded(jitter=0.0), effect_named("external_vibration")
    noise = np.random.default_rng(5).normal(size=(len(at), 6)) * np.repeat([0.1, 0.005], 3)
    when = {"start": 0.0, "length": at.duration, "frequency": 31.3}
    shaken = effect.simulate(at, filled(effect, at, when | {"sine_x": 0.1, "cosine_y": 0.1}))
    hum = np.sin(2.0 * np.pi * 31.3 * at.seconds)[:, None] * shaken.std(axis=0) * np.sqrt(2.0)
    assert [each["frequency"] for each in effect.starts(at, shaken + noise)] == [pytest.approx(31.3, abs=0.01)]
    assert not list(effect.starts(at, hum + noise))
    assert list(effect.oscillations(at, shaking(at, hum + noise)))


@pytest.mark.parametrize("tone", [0.0, 2.0])
def test_a_line_of_a_noise_of_one_band_is_no_vibration(tone):
    """As corners of a motion leave it above the bandwidth of the encoders: its highest line had 97 nats."""
    at, rng = recorded(jitter=0.0), np.random.default_rng(3)
    passing = butter(4, [15.0, 25.0], "bandpass", fs=1.0 / at.period, output="sos")
    band = sosfilt(passing, rng.normal(size=(len(at), 3)), 0)
    shake = 2.0 * band / band.std() + tone * np.sin(2.0 * np.pi * 19.0 * at.seconds)[:, None]
    residual = np.zeros((len(at), 6))
    residual[:, :3] = -at.phi[0] * at.to_sensor(shake)
    starts = list(effect_named("external_vibration").starts(at, residual))
    assert [each["frequency"] for each in starts] == ([pytest.approx(19.0, abs=0.05)] if tone else [])


@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize(("length", "knots"), [(0.8, 7), (2.6, 15)])
def test_the_window_of_a_contact_is_found_inside_a_longer_burst(length, knots, seed):
    """A calibration that was fitted with the contact lengthens the burst; a course needs a knot every 0.15 s or so."""
    at, effect = recorded(jitter=0.0, seed=seed), effect_named("contact")
    pushed = effect.simulate(at, TYPICAL["contact"] | {"start": 8.0, "length": length})
    pushed += np.random.default_rng(2).normal(size=pushed.shape) * np.repeat([0.05, 0.002], 3)
    known = np.hstack([np.ones((len(at), 1)), at.specific, at.prediction])
    found = list(effect.starts(at, pushed - known @ np.linalg.lstsq(known, pushed)[0]))
    near = [each for each in found if [each["start"], each["length"]] == pytest.approx([8.0, length], abs=0.05)]
    assert max(each["knots"] for each in near) == knots


def test_a_contact_of_an_earlier_version_has_seven_knots():
    at, effect = recorded(), effect_named("contact")
    values = TYPICAL["contact"]
    later = ("knots", "law", *PLATE)
    saved = {name: value for name, value in values.items() if name not in later and value != 0.0}
    assert len(saved) == 5 + 3 * 7
    assert complete_values(effect, at, saved) == values


def test_a_contact_is_a_force_at_a_point_that_comes_and_goes():
    at = recorded(jitter=0.0)
    values = TYPICAL["contact"]
    effect = effect_named("contact")
    found = effect.simulate(at, values)
    start, end = effect.windows(at, values)[0]
    inside = (at.seconds > start) & (at.seconds < end)
    assert not found[~inside].any()
    point = np.array([values[axis] for axis in "xyz"])
    np.testing.assert_allclose(found[:, 3:], np.cross(point, found[:, :3]), atol=1e-12)
    force = np.einsum("nij,nj->ni", at.rotation_world_sensor, found[:, :3])
    knots = start + (end - start) * np.arange(9) / 8
    for axis, name in enumerate("xyz"):
        course = [0.0, *(values[f"force_{name}_{k}"] for k in range(7)), 0.0]
        np.testing.assert_allclose(force[:, axis], np.interp(at.seconds, knots, course), atol=1e-9)
    peak = effect.derived(at, values)["peak_force"][0]
    assert peak == pytest.approx(np.linalg.norm([8, 2, -3]))
    assert f"{peak:.3g} N" in effect.sentence(at, values)


def test_the_end_of_a_leak_has_an_error_where_it_is_hardly_before_that_of_the_recording():
    """Beside these values the leak lasts to the end, and has none."""
    at = moved()
    effect = effect_named("mass_leak")
    values = {"start": 5.0, "length": SECONDS[-1] - 5.0 - 1e-4, "rate": 0.01, "x": 0.03, "y": -0.02, "z": 0.12}
    covariance = np.diag([0.1 if p.name in ("start", "length") else 1e-6 for p in effect.parameters(at)])
    said = quantities(FittedEffect(effect, values), at, covariance)
    assert said["end"].value == pytest.approx(SECONDS[-1] - 1e-4)
    assert np.isfinite(said["end"].std)
