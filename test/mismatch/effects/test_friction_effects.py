"""Effects on joint efforts against closed forms, energy, and pinocchio's inverse dynamics of the true motion."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from effect_worlds import HOME, PAYLOAD, ROBOT, TYPICAL, effort_world, filled

from poise.mismatch.effects import effect_named
from poise.mismatch.effects.joint_friction import COULOMB_TRANSITION
from poise.mismatch.effects.stops import between_stops
from poise.mismatch.reading import effort_track
from poise.mismatch.recorded import LinkTrack
from poise.simulation import JointMotion

JOINTS = range(1, 7)


def response(name, at, **given):
    effect = effect_named(name)
    return effect.simulate(at, filled(effect, at, given))


def test_friction_takes_energy_and_never_gives_any():
    at = effort_world()
    for name in ("viscous_friction", "coulomb_friction", "load_dependent_friction", "stribeck_friction"):
        effect = effect_named(name)
        found = response(name, at, **(TYPICAL[name] if name != "load_dependent_friction" else ratios(0.08)))
        assert (found * at.effort.velocity >= -1e-12).all(), effect.name
        assert np.abs(found).max() > 0.1


def ratios(value, inertial=1.0):
    return {"inertial": inertial, "transition": COULOMB_TRANSITION} | {f"ratio_{i}": value for i in JOINTS}


def test_dry_friction_jumps_by_twice_itself_and_viscous_friction_is_a_line():
    at = effort_world()
    velocity = at.effort.velocity
    fast = np.abs(velocity) > 5 * COULOMB_TRANSITION
    width = {"transition": COULOMB_TRANSITION}
    dry = response("coulomb_friction", at, **width, **{f"torque_{i}": float(i) for i in JOINTS})
    np.testing.assert_allclose(dry[fast], (np.sign(velocity) * np.arange(1, 7))[fast], rtol=1e-3)
    wet = response("viscous_friction", at, **{f"damping_{i}": 0.5 * i for i in JOINTS})
    np.testing.assert_allclose(wet, velocity * 0.5 * np.arange(1, 7), atol=1e-12)
    load = response("load_dependent_friction", at, **ratios(0.1))
    np.testing.assert_allclose(np.abs(load[fast]), 0.1 * np.abs(at.effort.rigid[fast]), rtol=1e-3)


def test_the_load_without_inertia_is_the_effort_at_constant_speed():
    at = effort_world()
    track = at.effort
    found = response("load_dependent_friction", at, **ratios(0.1, inertial=0.0))
    seconds, motion, whole = bare(at)
    motion.acceleration[:] = 0.0
    load = effort_track(ROBOT, seconds, motion, whole, PAYLOAD.phi).rigid
    np.testing.assert_allclose(found, 0.1 * np.abs(load) * np.tanh(track.velocity / COULOMB_TRANSITION), atol=1e-9)


def test_stribeck_friction_falls_from_stiction_to_coulomb_and_rises_with_speed():
    at = effort_world()
    velocity = np.abs(at.effort.velocity[:, 1])
    values = {"velocity": 0.1, "transition": COULOMB_TRANSITION, "torque_2": 3.0, "stiction_2": 6.0, "damping_2": 2.0}
    size = np.abs(response("stribeck_friction", at, **values)[:, 1])
    slow, fast = (velocity > 4 * COULOMB_TRANSITION) & (velocity < 0.03), velocity > 0.35
    np.testing.assert_allclose(size[slow], 9.0, rtol=0.1)
    np.testing.assert_allclose(size[fast], 3.0 + 2.0 * velocity[fast], rtol=1e-3)
    middle = np.abs(velocity - 0.1) < 0.01
    np.testing.assert_allclose(size[middle], 3.0 + 6.0 / np.e + 0.2, rtol=0.1)


def test_a_rotors_energy_is_that_of_its_speed():
    at = effort_world()
    found = response("motor_inertia", at, **{f"inertia_{i}": 0.8 for i in JOINTS})
    velocity, seconds = at.effort.velocity, at.effort.seconds
    power = found * velocity
    work = np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(seconds)[:, None], axis=0)
    energy = 0.4 * (velocity[1:] ** 2 - velocity[0] ** 2)
    np.testing.assert_allclose(work, energy, atol=2e-3 * energy.max())


def test_a_reflected_rotor_is_pinocchios_armature():
    at = effort_world()
    model = ROBOT.pinocchio.copy()
    armature = np.zeros(model.nv)
    armature[-6:] = TYPICAL["motor_inertia"]["inertia_1"]
    model.armature = armature
    data, plain = model.createData(), ROBOT.pinocchio.createData()
    found = response("motor_inertia", at, **{f"inertia_{i}": 0.8 for i in JOINTS})
    still = np.zeros(3)
    for i in (300, 900, 1700):
        track = at.effort
        q = ROBOT.configuration(np.concatenate([HOME[:3], track.position[i]])[None])[0]
        v, a = np.concatenate([still, track.velocity[i]]), np.concatenate([still, track.acceleration[i]])
        difference = pin.rnea(model, data, q, v, a) - pin.rnea(ROBOT.pinocchio, plain, q, v, a)
        np.testing.assert_allclose(found[i], difference[-6:], atol=1e-9)


def test_a_joint_that_is_dragged_along_feels_the_other_ones_motion_alone():
    at = effort_world()
    found = response("joint_coupling", at, driving=3.0, driven=5.0, shared=0.0, inertia=0.16, damping=0.4)
    exact = 0.16 * at.effort.acceleration[:, 2] + 0.4 * at.effort.velocity[:, 2]
    np.testing.assert_allclose(found[:, 4], exact, atol=1e-12)
    assert not np.delete(found, 4, axis=1).any()


@pytest.mark.parametrize("shared", [1.0, -1.0])
def test_a_shared_motor_and_the_joints_own_rotors_have_the_energy_of_the_sum_of_both_speeds(shared):
    """With both joints' own rotors and dampers the torques are those of one motor, and its power is never negative."""
    at = effort_world()
    velocity, acceleration = at.effort.velocity[:, [2, 4]], at.effort.acceleration[:, [2, 4]]
    found = response(
        "joint_coupling", at, driving=5.0, driven=3.0, shared=shared, inertia=0.16, damping=0.4, friction=0.7
    )[:, [2, 4]]
    speed = velocity @ [1.0, shared]
    torque = 0.16 * (acceleration @ [1.0, shared]) + 0.4 * speed + 0.7 * np.tanh(speed / COULOMB_TRANSITION)
    exact = torque[:, None] * [1.0, shared]
    np.testing.assert_allclose(found + 0.16 * acceleration + 0.4 * velocity, exact, atol=1e-12)


def test_a_shared_motor_whose_friction_would_drive_the_joints_is_impossible():
    at, effect = effort_world(), effect_named("joint_coupling")
    given = {"driving": 5.0, "driven": 3.0, "inertia": 0.1, "damping": -0.4, "friction": -0.5}
    assert "would drive" in effect.implausible(at, given | {"shared": 1.0})
    assert effect.implausible(at, given | {"shared": 1.0, "damping": 0.4, "friction": 0.5}) == ""
    # What one joint does to another has the sign of their axes.
    assert effect.implausible(at, given | {"shared": 0.0}) == ""


def test_a_joint_that_stands_still_drives_no_other():
    """In a healthy recording the noise of its encoder was a coupling (54 %)."""
    at, effect = effort_world(), effect_named("joint_coupling")
    track, rng = at.effort, np.random.default_rng(2)
    parts = [part.copy() for part in (track.position, track.velocity, track.acceleration)]
    for part, level in zip(parts, (2e-5, 1e-3, 0.05), strict=True):
        part[:, 4] = level * rng.normal(size=len(part))
    still = replace(track, position=parts[0], velocity=parts[1], acceleration=parts[2])
    at = replace(at, effort=still)
    residual = np.zeros(track.measured.shape)
    residual[:, 2] = still.acceleration[:, 4]
    assert list(still.moves) == [True] * 4 + [False, True]
    assert all(start["driving"] != 5.0 for start in effect.starts(at, residual) if not start["shared"])
    given = {"driving": 5.0, "driven": 3.0, "inertia": 0.1, "damping": 0.0, "friction": 0.0}
    assert effect.implausible(at, given | {"shared": 0.0}) == "joint 5 stands still"
    assert effect.implausible(at, given | {"shared": 1.0}) == ""


def test_a_mass_on_a_link_is_pinocchios_and_only_independent_parameters_remain():
    at = effort_world()
    links = at.effort.links
    np.testing.assert_allclose(links.efforts.sum(axis=2), effort_track(ROBOT, *bare(at), np.zeros(10)).rigid, atol=1e-9)
    names, columns = links.base_parameters
    assert len(set(names)) == len(names) > 10
    assert "mass_1" not in names  # the first axis is vertical
    flat = columns.reshape(-1, len(names))
    assert np.linalg.cond(flat / np.linalg.norm(flat, axis=0)) < 1e4


def bare(at):
    """Times, motion and efforts of the whole robot with its base at rest."""
    track = at.effort
    base = np.zeros((len(track.seconds), 3))
    parts = [
        np.hstack([base + (HOME[:3] if k == 0 else 0.0), part])
        for k, part in enumerate((track.position, track.velocity, track.acceleration))
    ]
    return track.seconds, JointMotion(*parts), np.zeros((len(track.seconds), 9))


def test_a_gear_that_bends_moves_the_link():
    """The efforts are those of the links' true motion: the encoder's plus the bend, to first order."""
    at = effort_world()
    track = at.effort
    compliance = 2e-4
    found = response("series_elasticity", at, compliance_2=compliance)
    seconds, motion, whole = bare(at)
    bend = -compliance * track.rigid[:, 1]
    rate = np.gradient(bend, seconds)
    for part, extra in zip(
        (motion.position, motion.velocity, motion.acceleration), (bend, rate, np.gradient(rate, seconds)), strict=True
    ):
        part[:, 4] += extra
    true = effort_track(ROBOT, seconds, motion, whole, PAYLOAD.phi).rigid - track.rigid
    # Without the Coriolis torques of the bend's speed, which matter most about the vertical axis.
    bears = (slice(50, -50), slice(1, 4))
    assert np.sqrt(np.mean((found - true)[bears] ** 2)) < 0.12 * np.sqrt(np.mean(true[bears] ** 2))


def test_a_ripple_stands_in_the_joints_position():
    at = effort_world()
    effect = effect_named("gear_ripple")
    values = {"joint": 2.0, "order": 24.0, "sine": 1.2, "cosine": -1.6}
    found = effect.simulate(at, values)
    derived = effect.derived(at, values)
    assert derived["amplitude"][0] == pytest.approx(2.0)
    phase = derived["phase"][0]
    np.testing.assert_allclose(found[:, 1], 2.0 * np.sin(24.0 * at.effort.position[:, 1] + phase), atol=1e-12)


@pytest.mark.parametrize("waves", [1.2, 1.4, 2.6, 7.0])
def test_a_ripple_is_looked_for_from_one_wave_in_the_range(waves):
    """A bend that a cubic explains is no wave."""
    at = effort_world()
    effect, position = effect_named("gear_ripple"), at.effort.position[:, 1]
    order = 2.0 * np.pi * waves / np.ptp(position)
    residual = np.random.default_rng(3).normal(size=at.effort.measured.shape) * 0.3
    residual[:, 1] += effect.simulate(at, {"joint": 2.0, "order": order, "sine": 1.0, "cosine": -2.0})[:, 1]
    first = next(iter(effect.starts(at, residual)))
    assert first["joint"] == 2.0
    # Within a step of the grid of starting points, and within the resolution of the range.
    assert first["order"] == pytest.approx(order, abs=0.45 * 2.0 * np.pi / np.ptp(position))


def test_stiction_does_not_act_over_the_whole_range_of_speeds():
    at = effort_world()
    effect, fastest = effect_named("stribeck_friction"), np.abs(at.effort.velocity).max()
    sizes = {f"torque_{i}": 1.0 for i in JOINTS} | {f"stiction_{i}": 1.0 for i in JOINTS}
    speeds = (0.1 * fastest, 0.7 * fastest, 0.02)
    values = [filled(effect, at, sizes | {"transition": 0.01, "velocity": speed}) for speed in speeds]
    said = [effect.implausible(at, each) for each in values]
    assert not said[0]
    # A peak at the lower end of the range is another law by which Coulomb friction reverses.
    assert "where dry friction reverses" in said[2]
    assert "of speeds" in said[1] or "stiction would reach" in said[1]


def test_with_backlash_the_efforts_are_those_of_the_links_true_motion():
    """Inverse dynamics of the motion with the play in it, but for what is of second order in the gap."""
    at = effort_world()
    track = at.effort
    values = {"joint": 1.0, "gap": 0.01, "settling": 0.03, "own": 1.0, "others": 1.0}
    found = response("backlash", at, **values)
    push = -track.rigid[:, 0] / track.by_acceleration[:, 0, 0]
    play = np.stack(between_stops(track.seconds, push, 0.01, 0.03))
    base = np.zeros((len(track.seconds), 3))
    parts = [
        np.hstack([base + (HOME[:3] if k == 0 else 0.0), part])
        for k, part in enumerate((track.position, track.velocity, track.acceleration))
    ]
    for part, extra in zip(parts, play, strict=True):
        part[:, 3] += extra
    whole = np.zeros((len(track.seconds), 9))
    true = effort_track(ROBOT, track.seconds, JointMotion(*parts), whole, PAYLOAD.phi).rigid - track.rigid
    size = np.abs(true).max()
    assert size > 1.0
    # What is left is the speed of the play times that of the arm (Coriolis): small beside the knocks.
    assert np.quantile(np.abs(found - true), 0.99) < 0.05 * size


def test_across_the_gap_the_joint_bears_nothing():
    at = effort_world()
    track = at.effort
    found = response("backlash", at, joint=1.0, gap=0.03, settling=0.01, own=1.0, others=1.0)
    push = -track.rigid[:, 0] / track.by_acceleration[:, 0, 0]
    beyond, rate, second = between_stops(track.seconds, push, 0.03, 0.01)
    flies = (np.abs(beyond) < 0.013) & (np.abs(rate) > 0.01)
    assert flies.sum() > 5
    # But for the change of the load with the link's own way, which has no weight about the vertical.
    assert np.abs((track.rigid + found)[flies, 0]).max() < 0.02 * np.abs(track.rigid[:, 0]).max()
    # On its flanks the link stands beside the motor by half of the gap: a loop, the same effort from both sides.
    rests = (np.abs(beyond) >= 0.015) & (np.abs(second) < 0.02)
    np.testing.assert_allclose(found[rests], track.by_position[rests, :, 0] * beyond[rests, None], atol=0.06)
    assert {-1.0, 1.0} <= set(np.sign(beyond[rests]))


def test_forces_of_a_slide_do_not_hide_the_links_of_a_wrist() -> None:
    """A carriage that weighs 190 N: an eccentric head was `joint_offset`, since its link had no visible parameter."""
    rng = np.random.default_rng(4)
    efforts = np.stack([[190.0, 0.0], [0.0, 0.4]], axis=1) * np.ones((50, 1, 1))
    response = np.zeros((50, 2, 2, 10))
    response[:, 0, 0, 0], response[:, 1, 1, 1] = 190.0, 0.1 * rng.normal(size=50)
    for slides, seen in (((True, False), ("mass_1", "moment_x_2")), ((False, False), ("mass_1",))):
        track = LinkTrack((1, 2), efforts, response, slides)
        assert track.base_parameters[0] == seen


def test_friction_under_a_load_that_hardly_changes_is_that_of_coulomb():
    """12 N of Coulomb friction in a lift that carries an arm were "3.9 % of the load", at 98.7 %."""
    at, effect = effort_world(), effect_named("load_dependent_friction")
    values = filled(effect, at, ratios(0.0) | {"ratio_2": 0.04})
    assert not effect.implausible(at, values)
    rigid, measured = at.effort.rigid.copy(), at.effort.measured.copy()
    rigid[:, 1] = measured[:, 1] = 300.0 + 6.0 * np.sin(at.effort.position[:, 0])
    lift = replace(at, effort=replace(at.effort, rigid=rigid, measured=measured))
    assert "Coulomb friction" in effect.implausible(lift, values)
    assert not effect.implausible(lift, values | {"ratio_1": 0.04})
