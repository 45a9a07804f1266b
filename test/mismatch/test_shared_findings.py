"""What one signal or one joint shows is not asked of another: shared effects, rivals, drifts and delays."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from cases import make_case
from field_robots import ARM, Recorded, read, urdf
from test_effort_recordings import NOISE, PHI, ROBOT, URDF

from poise.mismatch.answer import diagnose, effects_called
from poise.mismatch.effects import UnreportedBaseMotion, effect_named
from poise.mismatch.inference import FittedEffect, effort_problem, exceeds_tolerance, wrench_problem
from poise.mismatch.reading import (
    MeasuredStreams,
    NominalModel,
    ReadRecording,
    acting_on_efforts,
    on_efforts,
    read_streams,
    with_rest,
)
from poise.mismatch.reading.load_on_efforts import MotionOnEfforts, by_acceleration
from poise.mismatch.recorded import RecordedMotion, joint_torques
from poise.robot import RobotModel
from poise.simulation import FourierTrajectory, IdealRobot, JointMotion, record
from poise.types import Array

G = 9.80665
TILT = (0.02, -0.05)


def read_both(tilt: Sequence[float]) -> ReadRecording:
    """8 s of wrench and noisy efforts of a UR10 on a base that is tilted."""
    motion = FourierTrajectory.random(ROBOT, np.random.default_rng(2), duration=8.0, speed=0.3)
    turned = np.array([tilt[1] * G, -tilt[0] * G, -G * np.sqrt(1.0 - tilt[0] ** 2 - tilt[1] ** 2)])
    made = record(IdealRobot(ROBOT, PHI, turned), motion, np.random.default_rng(2), NOISE)
    noise = np.random.default_rng(3).normal(size=made.joints.effort.shape) * 0.1
    joints = replace(made.joints, effort=made.joints.effort + noise)
    model = NominalModel(sensor_frame="ft_sensor", phi=PHI)
    return read_streams(MeasuredStreams("test", made.wrench, lambda _: joints, None, lambda: URDF), model)


def test_a_tilt_that_the_wrench_shows_is_not_named_again_for_the_efforts() -> None:
    reading = read_both(TILT)
    library = effects_called(["base_tilt", "world_force", "effort_offset", "motor_gain"])
    found = diagnose(reading.recorded, reading.model, library=library)
    assert [each.effect.name for each in found.findings] == ["base_tilt"]
    (values,) = (each.values for each in found.findings)
    assert [values["rotation_x"], values["rotation_y"]] == pytest.approx(TILT, abs=0.004)
    assert len(found.examinations) == 2


def test_a_zero_of_an_encoder_that_the_wrench_hides_is_named_from_the_efforts_beside_it() -> None:
    """It turns the weight of the arm; the tolerance of the sensor's rotation may hide it in the wrench."""
    reading, effect = read_both((0.0, 0.0)), effect_named("joint_offset")
    recorded, effort = reading.recorded, reading.recorded.effort
    assert effort is not None
    assert effect is not None
    offsets = {p.name: 0.0 for p in effect.parameters(recorded)} | {"offset_2": 0.015}
    acting = acting_on_efforts(effect)
    assert acting is not None
    turned = effort.measured + acting.simulate(recorded, offsets)
    recorded = replace(recorded, effort=replace(effort, measured=turned))
    found = diagnose(recorded, reading.model, library=effects_called(["joint_offset", "link_parameters", "motor_gain"]))
    assert [each.effect.name for each in found.findings] == ["joint_offset"]
    assert found.findings[0].values["offset_2"] == pytest.approx(0.015, abs=0.003)


def test_efforts_distinguish_a_pull_on_the_load_from_a_tilted_base() -> None:
    """At the centre of mass a constant pull turns the load's gravity, and not that of the arm."""
    reading, pull = read_both((0.0, 0.0)), np.array([0.9, -0.5, 0.0])
    recorded, effort = reading.recorded, reading.recorded.effort
    assert effort is not None
    force = np.einsum("nij,i->nj", recorded.rotation_world_sensor, pull)
    wrench = np.hstack([force, np.cross(PHI[1:4] / PHI[0], force)])
    measured = effort.measured + joint_torques(recorded, wrench[:, :, None])[:, :, 0]
    recorded = replace(recorded, wrench=recorded.wrench + wrench, effort=replace(effort, measured=measured))
    library = effects_called(["base_tilt", "world_force", "effort_offset"])
    found = diagnose(recorded, reading.model, library=library)
    assert [each.effect.name for each in found.findings] == ["world_force"]
    assert found.unproven["base_tilt"] == "the joint efforts contradict it"
    alone = diagnose(replace(recorded, effort=None), reading.model, library=library)
    assert [each.effect.name for each in alone.findings] == ["base_tilt"]


@pytest.mark.parametrize("name", ["base_tilt", "joint_offset"])
def test_efforts_follow_the_base_and_the_encoders(name: str) -> None:
    """Against the recursive Newton-Euler algorithm with gravity turned, and with the joints where they are."""
    reading = read(Recorded(seconds=6.0, effort_noise=0.0).joints())
    effort = reading.recorded.effort
    effect = effect_named(name)
    assert effect is not None
    assert effort is not None
    robot = RobotModel.from_urdf(ARM, "link_3")
    values = dict(zip((p.name for p in effect.parameters(reading.recorded)), [3e-3, -2e-3, 4e-3], strict=False))
    turned = [values.get("rotation_y", 0.0) * G, -values.get("rotation_x", 0.0) * G, -G]
    wrong = np.array([values.get(f"offset_{i}", 0.0) for i in (1, 2, 3)])
    true = JointMotion(effort.position - wrong, effort.velocity, effort.acceleration)
    nominal = JointMotion(effort.position, effort.velocity, effort.acceleration)
    change = IdealRobot(robot, np.zeros(10), turned).effort(true) - IdealRobot(robot, np.zeros(10)).effort(nominal)
    acting = acting_on_efforts(effect)
    assert acting is not None
    assert np.abs(acting.simulate(reading.recorded, values) - change).max() < 0.02 * np.abs(change).max()


@pytest.mark.parametrize(("returns", "inert"), [(0.0, ("length",)), (1.0, ())])
def test_what_has_no_effect_on_the_wrench_has_none_on_joint_efforts(returns: float, inert: tuple[str, ...]) -> None:
    """Otherwise evidence is lost for the time at which a change ends, although it stays."""
    step = effect_named("mass_step")
    assert step is not None
    acting = acting_on_efforts(step)
    assert acting is not None
    assert acting.inert({"returns": returns}) == step.inert({"returns": returns}) == inert


def test_efforts_follow_a_base_that_accelerates() -> None:
    """For arm and load, an acceleration of the base is gravity turned: the Newton-Euler algorithm with it added."""
    reading = read(Recorded(seconds=6.0, effort_noise=0.0).joints())
    effort, effect = reading.recorded.effort, effect_named("base_motion")
    assert effort is not None
    assert effect is not None
    acting = acting_on_efforts(effect)
    assert acting is not None
    values = dict.fromkeys((p.name for p in acting.parameters(reading.recorded)), 0.0)
    values |= {"start": 1.0, "length": 3.0, "splines": 10.0, "speed_x_4": 0.2, "speed_y_6": -0.1}
    row = int(np.argmax(np.abs(acting.simulate(reading.recorded, values)).max(axis=1)))
    rows, rates = UnreportedBaseMotion.rates(effort.seconds, values)
    speeds = np.array([[values[f"speed_{axis}_{k}"] for axis in "xy"] for k in range(10)])
    acceleration = (rates @ speeds)[list(rows).index(row)]
    moved = JointMotion(*(part[row : row + 1] for part in (effort.position, effort.velocity, effort.acceleration)))
    robot = RobotModel.from_urdf(ARM, "link_3")
    shaken = IdealRobot(robot, np.zeros(10), [-acceleration[0], -acceleration[1], -G]).effort(moved)
    change = shaken - IdealRobot(robot, np.zeros(10)).effort(moved)
    assert acting.simulate(reading.recorded, values)[row] == pytest.approx(change[0], abs=1e-3 * np.abs(change).max())


def test_a_base_motion_is_named_from_joint_efforts_alone() -> None:
    reading = read(Recorded(seconds=10.0).joints())
    effort = reading.recorded.effort
    assert effort is not None
    window = (effort.seconds > 5.0) & (effort.seconds < 6.5)
    speed = 2.0 * np.pi / 1.5
    push = 0.5 * np.sin(speed * (effort.seconds - 5.0)) * window
    acting = acting_on_efforts(UnreportedBaseMotion())
    assert isinstance(acting, MotionOnEfforts)
    felt = by_acceleration(reading.recorded)[0][:, :, 0] * push[:, None]
    moved = replace(reading.recorded, effort=replace(effort, measured=effort.measured + felt))
    library = effects_called(["base_motion", "coulomb_friction", "payload_parameters", "effort_offset"])
    found = diagnose(moved, reading.model, library=library)
    assert [each.effect.name for each in found.findings] == ["base_motion"]
    assert found.findings[0].windows[0] == pytest.approx((5.0, 6.5), abs=0.4)


def test_a_base_that_rises_is_gravity_that_grows() -> None:
    reading = read(Recorded(seconds=5.0, effort_noise=0.0).joints())
    effort, robot = reading.recorded.effort, RobotModel.from_urdf(ARM, "link_3")
    assert effort is not None
    motion = JointMotion(effort.position, effort.velocity, effort.acceleration)
    lifted, usual = (IdealRobot(robot, np.zeros(10), [0.0, 0.0, -size]).effort(motion) for size in (G + 0.3, G))
    assert 0.3 * by_acceleration(reading.recorded)[0][:, :, 2] == pytest.approx(lifted - usual, abs=1e-9)


def test_a_vibration_is_named_from_the_efforts_of_one_axis() -> None:
    """A line of 0.3 of the noise for four of ten seconds; the efforts of the other blocks do not show it."""
    text = urdf(("axis", "revolute", "0 1 0"))
    reading = read(Recorded(text=text, seconds=10.0).joints(), text)
    effort = reading.recorded.effort
    assert effort is not None
    felt = by_acceleration(reading.recorded)[0]
    inside = (effort.seconds > 4.0) & (effort.seconds < 8.0)
    size = 0.5 * float(np.diff(effort.measured - effort.rigid, axis=0).std()) / float(np.abs(felt[:, :, 2]).max())
    push = size * np.sin(2.0 * np.pi * 13.0 * effort.seconds) * inside
    shaken = replace(reading.recorded, effort=replace(effort, measured=effort.measured + felt[:, :, 2] * push[:, None]))
    library = effects_called(["external_vibration", "gear_ripple", "viscous_friction", "payload_parameters"])
    found = diagnose(shaken, reading.model, library=library)
    assert [each.effect.name for each in found.findings] == ["external_vibration"]
    assert found.findings[0].values["frequency"] == pytest.approx(13.0, abs=0.05)
    assert found.findings[0].windows[0] == pytest.approx((4.0, 8.0), abs=0.5)
    assert diagnose(reading.recorded, reading.model, library=library).verdict == "none"


def test_a_contact_at_the_end_of_its_reach_is_no_answer_for_efforts() -> None:
    """There it follows what friction leaves of some joints, as on a real UR10; the wrench would show the place."""
    recorded = read(Recorded(seconds=6.0).joints()).recorded
    contact = effect_named("contact")
    assert contact is not None
    acting = acting_on_efforts(contact)
    assert acting is not None
    values = {p.name: 0.0 if p.linear else p.from_unit(0.5) for p in acting.parameters(recorded)}
    assert acting.implausible(recorded, values) == ""
    assert "reach" in acting.implausible(recorded, values | {"z": -0.4999999})


def test_what_the_wrench_names_is_fitted_again_for_the_efforts() -> None:
    reading = read(Recorded(seconds=6.0).joints())
    usual, wide = (effort_problem(reading.recorded, reading.model, frozenset(names)) for names in ((), ("tilt",)))
    bounds = [{g.name: g.bound for g in problem.groups(problem.recorded)} for problem in (usual, wide)]
    assert bounds[1]["tilt"] > 10.0 * bounds[0]["tilt"]
    assert {name for name in bounds[0] if bounds[0][name] != bounds[1][name]} == {"tilt"}
    assert wide.of(wide.recorded).widened == wide.widened


def test_what_no_name_explains_of_the_wrench_acts_on_the_joints() -> None:
    """A force that no effect describes is no error of the links."""
    reading = read(Recorded(seconds=6.0, effort_noise=0.0).joints())
    recorded = reading.recorded
    wrench = np.zeros((len(recorded), 6))
    wrench[:, 0] = 3.0 * np.sin(recorded.seconds)
    felt = with_rest(recorded, wrench)
    assert felt.effort is not None
    expected = joint_torques(recorded, wrench[:, :, None])[:, :, 0]
    assert felt.effort.by_rest == pytest.approx(expected, abs=0.02 * np.abs(expected).max())


def test_a_drift_that_begins_at_zero_is_a_drift_alone() -> None:
    """In the middle of the recording its offset is beyond the tolerance of the bias."""

    def spoil(exact: RecordedMotion, wrench: Array, rng: np.random.Generator) -> Array:
        del wrench, rng
        drift = np.array([1.5, -1.2, 0.0, 0.0, 0.1, 0.0])
        return np.asarray(np.outer((exact.seconds - exact.seconds[0]) / exact.duration, drift))

    case = make_case(5, duration=8.0, spoil=spoil)
    found = diagnose(case.recorded(), case.model, library=effects_called(["bias_drift", "sensor_bias"]))
    assert [each.effect.name for each in found.findings] == ["bias_drift"]
    assert found.verdict == "named"
    assert found.findings[0].parameters["force_x"].value == pytest.approx(1.5, abs=0.5)


@pytest.mark.parametrize(("constant", "outside"), [(0.008, False), (0.03, True)])
def test_a_filter_must_delay_by_more_than_two_tolerances_of_the_clock(constant: float, outside: bool) -> None:
    case = make_case(5, duration=8.0)
    problem = wrench_problem(case.recorded(), case.model)
    effect = effect_named("low_pass")
    assert effect is not None
    assert exceeds_tolerance(problem, [FittedEffect(effect, {"time_constant": constant})], effect) == outside


@pytest.mark.parametrize(("stiffness", "outside"), [(4000.0, False), (40.0, True)])
def test_a_load_must_turn_in_its_grip_by_more_than_the_tolerance_of_the_sensors_rotation(
    stiffness: float, outside: bool
) -> None:
    case = make_case(5, duration=8.0)
    problem = wrench_problem(case.recorded(), case.model)
    effect = effect_named("grasp_compliance")
    assert effect is not None
    values = {"stiffness": stiffness, "damping_ratio": 0.2, "height": 0.03}
    turn = effect.derived(problem.recorded, values)["largest_turn"][0]
    assert (turn > case.model.tolerance.sensor_rotation) == outside
    assert exceeds_tolerance(problem, [FittedEffect(effect, values)], effect) == outside
    assert not effect.implausible(problem.recorded, values)
    assert "from the sensor" in effect.implausible(problem.recorded, values | {"height": -0.1})


def test_a_rotor_in_the_tool_does_no_work_on_the_joints() -> None:
    """Its torque is across the angular velocity: the powers of the joints add up to zero."""
    reading = read(Recorded(seconds=6.0, effort_noise=0.0).joints())
    effort, effect = reading.recorded.effort, effect_named("flywheel")
    assert effort is not None
    assert effect is not None
    acting = acting_on_efforts(effect)
    assert acting is not None
    torque = acting.simulate(reading.recorded, {"momentum_x": 0.3, "momentum_y": -0.2, "momentum_z": 0.5})
    power = torque * effort.velocity
    assert np.abs(power).max() > 0.01
    assert np.abs(power.sum(axis=1)).max() < 0.01 * np.abs(power).max()
    assert on_efforts(effect, reading.recorded).signal == "effort"


def test_what_stays_unexplained_in_one_joint_does_not_count_against_the_friction_of_others() -> None:
    made = Recorded(damping=0.5, effort_noise=0.1).joints()
    seconds = (made.stamps - made.stamps[0]) * 1e-9
    hum = np.outer(20.0 * np.sin(9.0 * seconds), [1.0, 0.0, 0.0])
    reading = read(replace(made, effort=made.effort + hum))
    found = diagnose(reading.recorded, reading.model, library=effects_called(["viscous_friction"]))
    assert [each.effect.name for each in found.findings] == ["viscous_friction"]
    assert found.verdict == "mixed"


def test_other_effects_that_fit_one_joint_as_well_are_listed() -> None:
    """A tilted base turns gravity on one axis; so does a wrong zero of its encoder, or a payload's centre of mass."""
    text = urdf(("axis", "revolute", "0 1 0"))
    reading = read(Recorded(text=text, seconds=8.0, effort_noise=0.1).joints(), text)
    effort = reading.recorded.effort
    assert effort is not None
    by_tilt = effort.by_tilt(9.81)
    assert by_tilt is not None
    tilted = replace(effort, measured=effort.measured + by_tilt @ np.array([0.0, 0.05]))
    found = diagnose(replace(reading.recorded, effort=tilted), NominalModel(phi=np.zeros(10)))
    assert not found.findings
    assert found.verdict == "unknown"
    assert found.unknown is not None
    assert all(name in found.unknown.sentence for name in ("base_tilt", "joint_offset", "payload_parameters"))
