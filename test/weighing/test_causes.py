"""The search for causes: each kind of trouble on the same simulated weighing, and the repair of those that have one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from troubled_weighings import BIAS, CLEAN, GRAVITY, KINDS, LOAD, MOTION, NOISE, READ, SECONDS, hose, late, weight

from poise.errors import ErrorCode
from poise.inertia import InertialParameters, identify
from poise.inertia.model import signal_columns
from poise.recording import WrenchStream, open_recording
from poise.weighing import (
    after_repair,
    causes_of,
    find_causes,
    is_withheld,
    named_and_possible,
    repaired_wrench,
    with_causes,
)
from poise.weighing.causes import chances
from poise.weighing.fitting import explain, impossible_payload, plain_design


def named(wrench):
    return find_causes(replace(MOTION, wrench=wrench))


@pytest.mark.parametrize("kind", KINDS)
def test_the_cause_is_named_first_and_its_repair_gives_the_payload(kind):
    wrench, code = KINDS[kind]
    cause = named(wrench)[0]
    assert cause.code is code
    assert np.isfinite(list(cause.evidence.values())).all()
    if cause.repair is None or code is ErrorCode.IN_CONTACT:
        return
    stream = repaired_wrench(WrenchStream(MOTION.stamps, wrench, "ft"), MOTION, cause.repair)
    rows = np.isin(MOTION.stamps, stream.stamps) if code is not ErrorCode.CLOCK_LATE else SECONDS < 11.5
    values = stream.wrench_in_sensor
    if code is ErrorCode.CLOCK_LATE:
        then = MOTION.stamps[rows]
        values = np.stack([np.interp(then, stream.stamps, column) for column in values.T], axis=1)
    again = explain(replace(MOTION.select(rows), wrench=values), plain_design)
    assert again.phi[0] == pytest.approx(LOAD.mass, rel=0.01)
    assert again.phi[1:4] / again.phi[0] == pytest.approx(LOAD.com, abs=2e-3)


def test_a_healthy_weighing_has_no_cause():
    assert named(READ) == ()


def test_a_cause_with_several_payloads_is_compared_by_the_last_one():
    cause = named(KINDS["grasped"][0])[0]
    assert cause.phi[0] == pytest.approx(LOAD.mass, rel=0.01)
    assert abs(cause.explanation.phi[0]) < 0.02  # before the grasp
    released = named(np.where((SECONDS < 5)[:, None], CLEAN, 0.4 * CLEAN) + BIAS + NOISE)[0]
    assert released.code is ErrorCode.PAYLOAD_CHANGED
    assert released.phi[0] == pytest.approx(0.4 * LOAD.mass, rel=0.02)


def test_a_second_error_is_named_besides_the_likeliest_cause():
    first, *_, last = named(late(0.15) * np.repeat([1, 1000], 3))
    assert [first.code, last.code] == [ErrorCode.CLOCK_LATE, ErrorCode.TORQUE_UNIT]
    assert last.besides
    for kind in ("late", "touched"):
        assert not any(cause.besides for cause in named(KINDS[kind][0]))


def test_gravity_of_another_size_or_direction_is_named():
    large = replace(MOTION, gravity=10 * GRAVITY)
    signals = MOTION.signals.copy()
    signals[:, :3] += 9 * MOTION.gravity_in_sensor
    assert find_causes(replace(large, signals=signals, wrench=READ))[0].code is ErrorCode.GRAVITY_WRONG
    lean = Rotation.from_rotvec([np.radians(8), 0, 0]).as_matrix()
    rotation = lean @ MOTION.rotation_world_sensor
    signals = MOTION.signals.copy()
    signals[:, :3] += np.einsum("nji,j->ni", rotation, GRAVITY) - MOTION.gravity_in_sensor
    cause = find_causes(replace(MOTION, rotation_world_sensor=rotation, signals=signals, wrench=READ))[0]
    assert cause.code is ErrorCode.GRAVITY_WRONG
    assert abs(cause.evidence["roll"]) == pytest.approx(np.radians(8), abs=2e-3)


def test_at_rest_a_torque_in_newton_millimetres_is_seen_by_its_centre_of_mass():
    rows = np.arange(0, len(SECONDS), 12)
    still = MOTION.signals[rows].copy()
    still[:, :3], still[:, 3:12] = MOTION.gravity_in_sensor[rows], 0.0
    held = replace(MOTION.select(rows), signals=still)
    wrench = signal_columns(still)[:, :, :10] @ LOAD.phi + BIAS + NOISE[rows]
    assert find_causes(replace(held, wrench=wrench * np.repeat([1, 1000], 3)))[0].code is ErrorCode.TORQUE_UNIT
    assert find_causes(replace(held, wrench=wrench)) == ()


def test_a_payload_that_no_hand_holds_is_said_to_be_impossible():
    known = 1e-6 * np.eye(10)
    assert impossible_payload(LOAD.phi, known) == ""
    assert "mass" in impossible_payload(-LOAD.phi, known)
    assert "centre of mass" in impossible_payload(LOAD.phi * np.r_[1, [20] * 3, [400] * 6], known)
    assert impossible_payload(np.zeros(10), known) == ""


def test_a_number_that_contradicts_its_cause_is_withheld():
    from poise.inertia.pipeline import InertialEstimate
    from poise.inertia.verdict import FitTest, FitVerdict

    wrench, _ = KINDS["turned"]
    plain = explain(replace(MOTION, wrench=wrench), plain_design)
    failed = FitVerdict((FitTest("residual_force", 2.0, 1.0, 9.0, "a residual"),))
    estimate = InertialEstimate(
        *(0, "ft", InertialParameters.from_phi(plain.phi), plain.phi, 1e-6 * np.eye(10), np.zeros(6), np.eye(6)),
        *(np.nan, np.nan, "poise", True, (), 1.0, len(SECONDS), (), 0.1, 0.1),
        fit=failed,
        samples=replace(MOTION, wrench=wrench),
    )
    causes = causes_of(estimate)
    assert is_withheld(estimate, causes)
    assert with_causes(estimate, causes).findings[0].code is ErrorCode.SENSOR_ROTATED
    passed = replace(estimate, fit=FitVerdict())
    assert causes_of(passed)[0].code is ErrorCode.SENSOR_ROTATED  # a cause also explains a small residual
    good = replace(passed, phi=LOAD.phi, samples=replace(MOTION, wrench=READ))
    assert causes_of(good) == ()
    assert with_causes(good, ()).findings == ()


def test_a_wrong_unit_that_little_shows_withholds_a_number_that_passes_the_tests():
    from poise.inertia.pipeline import InertialEstimate
    from poise.inertia.verdict import FitVerdict

    wrench = (CLEAN + 100 * NOISE) * np.repeat([1 / 4.4482216, 1], 3) + BIAS
    samples = replace(MOTION, wrench=wrench)
    plain = explain(samples, plain_design)
    estimate = InertialEstimate(
        *(0, "ft", InertialParameters.from_phi(plain.phi), plain.phi, plain.covariance[:10, :10], BIAS, np.eye(6)),
        *(np.nan, np.nan, "poise", True, (), 1.0, len(SECONDS), (), 0.1, 0.1),
        fit=FitVerdict(),
        samples=samples,
    )
    causes = causes_of(estimate)
    assert causes[0].code is ErrorCode.FORCE_UNIT
    assert causes[0].fixed
    assert 5 < causes[0].gain < 15  # a cause with parameters of its own would need 15
    assert is_withheld(estimate, causes)
    assert causes_of(replace(estimate, phi=LOAD.phi, samples=replace(MOTION, wrench=CLEAN + 100 * NOISE))) == ()


def test_a_number_contains_a_cause_that_is_not_named_by_its_probability():
    wrench = (CLEAN + 100 * NOISE) * np.repeat([1 / 4.4482216, 1], 3) + BIAS
    light = estimated(replace(MOTION, wrench=wrench))
    found, _ = named_and_possible(light)
    assert abs(light.phi[0] - LOAD.mass) > 10 * light.mass_std
    widths = []
    for gain in (-5.0, 2.0, 4.0):
        weak = replace(found[0], gain=gain, shown=False)
        odds = 0.01 * np.exp(gain)
        assert chances([weak, weak]) == pytest.approx(odds / (1 + 2 * odds))
        wide = with_causes(light, (), (weak,))
        assert all(each.code is not ErrorCode.FORCE_UNIT for each in wide.findings)
        step = weak.explanation.phi[0] - light.phi[0]
        assert wide.mass_std == pytest.approx(np.hypot(light.mass_std, step * np.sqrt(odds / (1 + odds))), rel=0.01)
        widths.append(wide.mass_std)
    assert widths[0] < 0.1 * widths[1]
    assert abs(light.phi[0] - LOAD.mass) < 3 * widths[2]
    healthy = estimated(replace(MOTION, wrench=CLEAN + 100 * NOISE))
    assert named_and_possible(healthy) == ((), ())


def test_causes_that_do_not_change_a_healthy_real_recording_do_not_widen_it():
    recording = open_recording(Path(__file__).resolve().parents[2] / "bags" / "kuka_vibration.mcap")
    assert named_and_possible(identify(recording, keep_history=False).estimate) == ((), ())


def test_gravity_that_is_not_that_of_the_earth_is_a_finding():
    from poise.inertia.pipeline import InertialEstimate

    strange = replace(MOTION, wrench=READ, gravity=GRAVITY * 9.0 / 9.80665)
    estimate = InertialEstimate(
        *(0, "ft", LOAD, LOAD.phi, 1e-6 * np.eye(10), np.zeros(6), np.eye(6)),
        *(np.nan, np.nan, "poise", True, (), 1.0, len(SECONDS), (), 0.1, 0.1),
        samples=strange,
    )
    assert [each.code for each in with_causes(estimate, ()).findings] == [ErrorCode.GRAVITY_WRONG]
    drift = [
        cause
        for cause in find_causes(replace(MOTION, wrench=KINDS["drift"][0]))
        if cause.code is ErrorCode.SENSOR_DRIFT
    ]
    named = [each.code for each in with_causes(estimate, drift[:1]).findings]
    assert named == [ErrorCode.SENSOR_DRIFT, ErrorCode.GRAVITY_WRONG]


def estimated(samples, **more):
    """The estimate that plain least squares makes of samples."""
    from poise.inertia.pipeline import InertialEstimate

    plain = explain(samples, plain_design)
    return InertialEstimate(
        *(0, "ft", InertialParameters.from_phi(plain.phi), plain.phi, plain.covariance[:10, :10], BIAS, np.eye(6)),
        *(np.nan, np.nan, "poise", True, (), 1.0, len(SECONDS), (), 0.1, 0.1),
        **{"samples": samples} | more,
    )


@pytest.mark.parametrize("kind", ["hose", "constant pull", "mirrored"])
def test_what_is_given_beside_a_cause_is_as_wide_as_the_cause_leaves_it(kind):
    estimate = estimated(replace(MOTION, wrench=KINDS[kind][0]))
    causes = causes_of(estimate)
    assert causes
    named = with_causes(estimate, causes)
    error = np.abs(estimate.phi[:4] - LOAD.phi[:4])
    assert np.any(error > 3 * np.sqrt(np.diag(estimate.covariance)[:4]))
    assert np.all(error < 3 * np.sqrt(np.diag(named.covariance)[:4]))


@pytest.mark.parametrize("lift", [5.0, 7.0])
def test_a_pull_looks_like_a_mass_at_the_point_where_it_acts(lift):
    estimate = estimated(replace(MOTION, wrench=hose(lift)))
    causes = causes_of(estimate)
    assert causes[0].open_pull > 0
    error = np.abs(estimate.phi[1:4] - LOAD.phi[1:4])
    assert np.all(error < 3 * np.sqrt(np.diag(with_causes(estimate, causes).covariance)[1:4]))


def test_gravity_that_was_given_wrongly_is_in_the_uncertainty():
    signals = MOTION.signals.copy()
    signals[:, :3] += (9.0 / 9.80665 - 1) * MOTION.gravity_in_sensor
    estimate = estimated(replace(MOTION, wrench=READ, signals=signals, gravity=GRAVITY * 9.0 / 9.80665))
    assert abs(estimate.phi[0] - LOAD.mass) > 3 * estimate.mass_std
    assert abs(estimate.phi[0] - LOAD.mass) < 3 * with_causes(estimate, ()).mass_std


def test_a_mass_of_nearly_zero_is_withheld_unless_inertial_forces_confirm_it():
    """A compensated pen and an empty hand look alike; 15 g that also accelerate as 15 g are an object."""
    slow = np.concatenate([0.02 * (MOTION.signals[:, :3] - MOTION.gravity_in_sensor), MOTION.signals[:, 3:]], axis=1)
    slow[:, :3] += MOTION.gravity_in_sensor
    pen = replace(MOTION, signals=slow)
    own = signal_columns(slow)[:, :, :10] @ (LOAD.phi / 24)
    compensated = replace(pen, wrench=own - weight(LOAD.phi / 24) + BIAS + NOISE)
    assert is_withheld(estimated(compensated), ())
    assert is_withheld(estimated(replace(MOTION, wrench=BIAS + NOISE)), ())
    light = estimated(replace(MOTION, wrench=CLEAN / 80 + BIAS + 0.1 * NOISE))
    assert light.phi[0] == pytest.approx(0.015, abs=0.002)
    assert not is_withheld(light, ())


def test_a_repaired_gravity_is_that_of_the_earth():
    signals = MOTION.signals.copy()
    signals[:, :3] += (9.0 / 9.80665 - 1) * MOTION.gravity_in_sensor
    cause = find_causes(replace(MOTION, wrench=READ, signals=signals, gravity=GRAVITY * 9.0 / 9.80665))[0]
    assert cause.code is ErrorCode.GRAVITY_WRONG
    assert cause.repair.gravity == pytest.approx(9.80665 / 9.0)


def test_a_repair_by_a_fitted_gravity_is_as_uncertain_as_the_accelerations_that_show_it():
    """Accelerations 7 % too small make gravity and mass wrong by as much, and leave nothing in the residual."""
    small, given = 0.93 * MOTION.acceleration_in_sensor, 9.0 / 9.80665

    def weighed_in(gravity):
        signals = MOTION.signals.copy()
        signals[:, :3] = gravity * MOTION.gravity_in_sensor - small
        return replace(MOTION, wrench=READ, signals=signals, gravity=GRAVITY * gravity)

    cause = find_causes(weighed_in(given))[0]
    assert cause.certain
    fitted = given * cause.repair.gravity
    assert fitted == pytest.approx(0.93, abs=0.01)
    found = estimated(weighed_in(fitted))
    assert not causes_of(found)
    assert abs(found.phi[0] - LOAD.mass) < 2 * after_repair(found, cause).mass_std
