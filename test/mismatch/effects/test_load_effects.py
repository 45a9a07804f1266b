"""What loads do, against Newton's and Euler's laws: momenta in the world, differentiated by splines; and pinocchio."""

from dataclasses import replace

import numpy as np
import pytest
from effect_worlds import (
    AXIS,
    HOME,
    NOISE,
    PAYLOAD,
    PLACE,
    REACH,
    ROBOT,
    TYPICAL,
    filled,
    recorded,
)
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from poise.geometry import STANDARD_GRAVITY
from poise.mismatch.effects import effect_named
from poise.mismatch.effects.cable import _cord, _line
from poise.mismatch.effects.part_motion import hanging
from poise.mismatch.effects.part_wrench import point_wrench, specific_at
from poise.mismatch.effects.stops import between_stops
from poise.mismatch.inference import names, search, wrench_problem
from poise.mismatch.reading import NominalModel, complete_values, recorded_from_motion
from poise.mismatch.recorded.recorded_motion import BaseTrack
from poise.simulation import FourierTrajectory, IdealRobot, JointMotion

DOWN = np.array([0.0, 0.0, -STANDARD_GRAVITY])
POINT = np.array([PLACE[axis] for axis in "xyz"])


def fine(duration=6.0):
    """A smooth motion at 500 Hz, by an even clock."""
    made = FourierTrajectory.random(
        ROBOT, np.random.default_rng(4), duration=30.0, speed=0.4, amplitude=1.0, frequency=0.15, centre=HOME
    )
    moved = FourierTrajectory(HOME, made.sine * REACH, made.cosine * REACH, made.frequency, 30.0, made.ramp)
    seconds = np.arange(3.0, 3.0 + duration, 0.002)
    return recorded_from_motion(ROBOT, seconds - 3.0, moved.at(seconds), PAYLOAD.phi)


def at_rest(duration=8.0, period=0.002, pose=HOME):
    """The arm stands still."""
    seconds = np.arange(0.0, duration, period)
    still = np.zeros((len(seconds), len(HOME)))
    return recorded_from_motion(ROBOT, seconds, JointMotion(still + pose, still, still), PAYLOAD.phi)


def response(name, at, **given):
    effect = effect_named(name)
    return effect.simulate(at, filled(effect, at, given))


def rate(at, values, order=1):
    """Time derivative of (N, k) by a quintic spline."""
    return make_interp_spline(at.seconds, values, k=5)(at.seconds, order)


def in_world(at, vectors):
    return np.einsum("nij,nj->ni", at.rotation_world_sensor, np.broadcast_to(vectors, (len(at), 3)))


def point_mass_wrench(at, mass, place_in_sensor):
    """(N, 6) of a mass that is at (N, 3) places of the sensor, by m (g - p'') of its path in the world."""
    path = at.position_in_world + in_world(at, place_in_sensor)
    force = np.einsum("nji,nj->ni", at.rotation_world_sensor, mass * (DOWN - rate(at, path, 2)))
    return np.hstack([force, np.cross(np.broadcast_to(place_in_sensor, force.shape), force)])


def agree(found, exact, share=2e-3):
    """Away from the ends, where splines know little."""
    inner = slice(25, -25)
    size = np.abs(exact[inner]).max(axis=0)
    assert (np.abs(found - exact)[inner].max(axis=0) <= share * size + 1e-6).all()
    return size


def simulated(at, phi, gravity=DOWN):
    """(N, 6) by the simulation (which is tested against pinocchio's RNEA) along the arm's motion, the base at rest."""
    joints, still = at.joints, np.zeros((len(at), 3))
    motion = JointMotion(*(np.hstack([still, p]) for p in (joints.position, joints.velocity, joints.acceleration)))
    return IdealRobot(ROBOT, phi, gravity).simulate(np.arange(len(at)), motion).wrench_in_sensor


def test_another_payload_is_what_the_simulation_of_it_says():
    at = fine()
    change = np.array([0.2, 0.01, -0.02, 0.015, 0.004, 1e-3, -5e-4, 0.003, 2e-4, 0.002])
    effect = effect_named("payload_parameters")
    names = [p.name for p in effect.parameters(at)]
    found = at.prediction + effect.simulate(at, dict(zip(names, change.tolist(), strict=True)))
    np.testing.assert_allclose(found, simulated(at, PAYLOAD.phi + change), atol=1e-8)


def test_drag_holds_back_with_the_square_of_the_points_speed():
    at = fine()
    found = response("air_drag", at, coefficient=1.5, **PLACE)
    path = at.position_in_world + in_world(at, POINT)
    velocity = rate(at, path)
    exact = np.einsum(
        "nji,nj->ni", at.rotation_world_sensor, -1.5 * velocity * np.linalg.norm(velocity, axis=1)[:, None]
    )
    agree(found[:, :3], exact)
    np.testing.assert_allclose(found[:, 3:], np.cross(POINT, found[:, :3]), atol=1e-12)
    assert (np.einsum("ni,ni->n", in_world(at, found[:, :3]), velocity) <= 1e-9).all()


def test_a_flywheel_resists_as_its_angular_momentum_turns():
    at, spin = fine(), np.array([0.04, -0.03, 0.05])
    found = response("flywheel", at, momentum_x=0.04, momentum_y=-0.03, momentum_z=0.05)
    exact = np.einsum("nji,nj->ni", at.rotation_world_sensor, -rate(at, in_world(at, spin)))
    agree(found[:, 3:], exact)
    assert not found[:, :3].any()
    # It does no work.
    np.testing.assert_allclose(np.einsum("ni,ni->n", found[:, 3:], at.angular_velocity), 0.0, atol=1e-12)


def test_a_constant_force_of_the_world_keeps_its_direction_and_its_point():
    at = fine()
    found = response("world_force", at, force_x=2.0, force_y=-1.0, force_z=0.5, **PLACE)
    np.testing.assert_allclose(in_world(at, found[:, :3]), np.broadcast_to([2.0, -1.0, 0.5], (len(at), 3)), atol=1e-12)
    np.testing.assert_allclose(found[:, 3:], np.cross(POINT, found[:, :3]), atol=1e-12)


@pytest.mark.parametrize(
    ("slack", "out", "damping"), [(0.2, 0.0, 0.0), (0.6, 0.0, 0.0), (0.3, 0.15, 0.0), (0.3, 0.1, 0.4)]
)
def test_the_search_for_a_cable_begins_near_its_anchor_and_its_hook(slack, out, damping):
    """Stiffness and length of a cord are ambiguous where the tool moves little: the lines of its forces hardly meet."""
    at = recorded(jitter=0.0)
    hook = at.position_in_world + at.to_world(np.broadcast_to([0.03, 0.0, out], (len(at), 3)))
    anchor = hook.mean(axis=0) + np.array([0.7, -0.6, 0.4])
    length = np.linalg.norm(anchor - hook, axis=1)
    rest = float(np.quantile(length, slack))
    given = dict(zip(("anchor_x", "anchor_y", "anchor_z"), anchor.tolist(), strict=True))
    given |= {"x": 0.03, "y": 0.0, "z": out}
    pulled = response("cable", at, **given, on_base=0.0, stiffness=14.0, damping_time=damping, rest_length=rest)
    noise = np.random.default_rng(3).normal(size=pulled.shape) * np.repeat([0.05, 0.002], 3)
    start = next(iter(effect_named("cable").starts(at, pulled + noise)))
    assert start["damping_time"] == pytest.approx(damping, abs=0.05)
    assert [start[name] for name in ("anchor_x", "anchor_y", "anchor_z")] == pytest.approx(anchor, abs=0.1)
    assert start["rest_length"] == pytest.approx(rest, abs=0.1)
    assert [start[name] for name in ("x", "y", "z")] == pytest.approx([0.03, 0.0, out], abs=0.01)


def test_a_cable_pulls_as_its_geometry_says_and_not_at_all_while_it_is_slack():
    at = fine()
    values = TYPICAL["cable"] | {"rest_length": 0.0}
    anchor = np.array([values[f"anchor_{axis}"] for axis in "xyz"])
    hook = at.position_in_world + in_world(at, POINT)
    length = np.linalg.norm(anchor - hook, axis=1)
    values["rest_length"] = float(np.median(length))
    found = response("cable", at, **values)
    size = length - values["rest_length"] + values["damping_time"] * rate(at, length)
    size = values["stiffness"] * np.maximum(size, 0.0)
    exact = np.where(length > values["rest_length"], size, 0.0)[:, None] * (anchor - hook) / length[:, None]
    # The sample in which it goes taut counts in part.
    settled = np.abs(length - values["rest_length"]) > 0.01
    np.testing.assert_allclose(in_world(at, found[:, :3])[settled], exact[settled], atol=2e-3)
    np.testing.assert_allclose(found[:, 3:], np.cross(POINT, found[:, :3]), atol=1e-12)
    slack = length < values["rest_length"] - 0.01
    assert slack.any()
    assert not found[slack].any()


@pytest.mark.parametrize("on_base", [0.0, 1.0])
def test_the_slopes_of_a_cord_are_those_of_its_wrench(on_base):
    at = recorded(duration=5.0)
    turns = Rotation.from_euler("z", 0.1 * at.seconds[:, None]).as_matrix()
    drifting = 0.1 * at.seconds[:, None] * [1.0, 0.5, 0.0]
    at = replace(at, base=BaseTrack(turns, drifting, *[np.zeros_like(drifting)] * 4))
    numbers = np.array([0.4, 0.6, 1.9, 1.0, 0.03, -0.02, 0.1, 0.2])

    def wrench(changed):
        return effect_named("cable").columns(at, _cord(changed, on_base))[:, :, 0]

    slopes = _line(at, _cord(numbers, on_base)).slopes(at, np.ones(2))
    assert wrench(numbers).any()
    for place, step in enumerate(np.eye(len(numbers)) * 1e-6):
        numeric = (wrench(numbers + step) - wrench(numbers - step)) / 2e-6
        np.testing.assert_allclose(slopes[:, :, place], numeric, atol=1e-6 * np.abs(numeric).max())


def test_a_cord_with_a_strong_damper_never_pushes():
    at = fine()
    values = TYPICAL["cable"] | {"damping_time": 2.0}
    anchor = np.array([values[f"anchor_{axis}"] for axis in "xyz"])
    away = anchor - at.position_in_world - in_world(at, POINT)
    values["rest_length"] = float(np.linalg.norm(away, axis=1).min())
    pull = np.einsum("ni,ni->n", in_world(at, response("cable", at, **values)[:, :3]), away)
    assert pull.min() == 0.0
    assert pull.max() > 1.0


def test_a_cord_without_damping_is_possible():
    at, cable = recorded(), effect_named("cable")
    pulled = response("cable", at, **TYPICAL["cable"] | {"damping_time": 0.0})
    for start in cable.starts(at, pulled):
        assert start["damping_time"] < 0.02
        assert cable.implausible(at, start | {"stiffness": 25.0}) == ""


def test_a_cable_of_an_earlier_version_states_its_damping():
    at, cable = fine(), effect_named("cable")
    values = TYPICAL["cable"]
    stated = {name: value for name, value in values.items() if name != "damping_time"} | {"damping": 2.0}
    assert complete_values(cable, at, stated)["damping_time"] == pytest.approx(0.08)
    assert cable.derived(at, values)["damping"] == (pytest.approx(2.0), "N s/m")


def test_a_spring_alone_gives_back_what_it_took():
    at = fine()
    values = TYPICAL["cable"] | {"damping_time": 0.0, "rest_length": 0.3}
    hook = at.position_in_world + in_world(at, POINT)
    power = np.einsum("ni,ni->n", in_world(at, response("cable", at, **values)[:, :3]), rate(at, hook))
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(at.seconds))])
    anchor = np.array([values[f"anchor_{axis}"] for axis in "xyz"])
    energy = 0.5 * 25.0 * (np.linalg.norm(anchor - hook, axis=1) - 0.3) ** 2
    np.testing.assert_allclose(work, energy[0] - energy, atol=2e-3 * np.ptp(energy))


@pytest.mark.parametrize("size", [4e-3, 1e-3])
def test_joint_offsets_are_those_of_the_true_pose_but_for_second_order(size):
    at = fine()
    joints, still = at.joints, np.zeros((len(at), 3))
    offsets = size * np.array([1.0, -0.8, 0.6, 1.0, -1.0, 0.7])
    parts = (joints.position - offsets, joints.velocity, joints.acceleration)
    true = recorded_from_motion(
        ROBOT, at.seconds, JointMotion(*(np.hstack([still, part]) for part in parts)), PAYLOAD.phi
    )
    found = response("joint_offset", at, **{f"offset_{i}": float(d) for i, d in enumerate(offsets, start=1)})
    exact = true.prediction - at.prediction
    # What was recorded is of the true pose; the nominal model takes the encoders at their word.
    assert np.abs(found - exact).max() < 3.0 * size * np.abs(exact).max()


def test_a_tilted_floor_is_gravity_that_points_elsewhere():
    at = fine()
    found = response("base_tilt", at, rotation_x=0.05, rotation_y=-0.08)
    gravity = Rotation.from_rotvec([-0.05, 0.08, 0.0]).apply(DOWN)
    np.testing.assert_allclose(at.prediction + found, simulated(at, PAYLOAD.phi, gravity), atol=1e-9)


def test_sloshing_mass_moves_by_newtons_law_and_the_pivot_hands_on_its_damping():
    at = fine()
    values = TYPICAL["slosh"] | {"length": 0.08, "damping_ratio": 0.08}
    found = response("slosh", at, **values) + 0.5 * point_wrench(at, POINT)
    pull = at.to_world(specific_at(at, POINT)) / 0.08
    spin = at.to_world(at.angular_velocity)
    frequency = np.sqrt(STANDARD_GRAVITY / 0.08)
    u, du = _swung(at.seconds, pull, spin, 2 * 0.08 * frequency)
    bob = np.einsum("nji,nj->ni", at.rotation_world_sensor, 0.08 * u)
    exact = point_mass_wrench(at, 0.5, POINT + bob)
    agree(found[:, :3], exact[:, :3], share=0.01)
    np.testing.assert_array_less(0.5, np.abs(found[:, :3]).max(axis=0))
    # About the pivot the vessel feels the damper alone: c l^2 u x (u' - omega x u).
    twist = found[:, 3:] - np.cross(POINT, found[:, :3])
    damper = 0.5 * 2 * 0.08 * frequency * 0.08**2 * np.cross(u, du - np.cross(spin, u))
    agree(in_world(at, twist), damper, share=0.02)
    # What the bob needs about the pivot is what the damper gives: rod and weight alone would leave none.
    lever = in_world(at, exact[:, 3:] - np.cross(POINT, exact[:, :3]))
    np.testing.assert_allclose(lever[25:-25], damper[25:-25], atol=0.02 * np.abs(lever).max())


def _swung(seconds, pull, spin, damping):
    """(N, 3) direction of the pendulum and its rate, by an independent integration."""
    drive, turn = (make_interp_spline(seconds, part, k=3) for part in (pull, spin))

    def slope(t, y):
        b = drive(t) - damping * (y[3:] - np.cross(turn(t), y[:3]))
        return np.concatenate([y[3:], b - (y[:3] @ b + y[3:] @ y[3:]) * y[:3]])

    u, du, _ = hanging(seconds, pull, spin, np.sqrt(np.linalg.norm(pull[0])), damping)
    begin = np.concatenate([u[0], du[0]])
    solved = solve_ivp(slope, seconds[[0, -1]], begin, t_eval=seconds, rtol=1e-10, atol=1e-11).y.T
    return solved[:, :3], solved[:, 3:]


def test_liquid_at_rest_weighs_what_the_rigid_payload_does():
    at = at_rest()
    np.testing.assert_allclose(response("slosh", at, **TYPICAL["slosh"]), 0.0, atol=1e-6)


def test_a_mass_on_a_spring_moves_by_newtons_law():
    at = fine()
    effect = effect_named("flexible_mode")
    values = filled(effect, at, TYPICAL["flexible_mode"])
    found = effect.simulate(at, values) + 0.6 * point_wrench(at, POINT)
    z = _swing(at, 2 * np.pi * 4.5, 0.05)
    agree(found, point_mass_wrench(at, 0.6, POINT + z[:, None] * AXIS), share=5e-3)


def _swing(at, omega, ratio):
    """(N,) the exact motion along the axis, by an independent integration of the equation in the turning tool."""
    pull = make_interp_spline(at.seconds, specific_at(at, POINT) @ AXIS, k=3)
    spin = make_interp_spline(
        at.seconds, np.sum(at.angular_velocity**2, axis=1) - (at.angular_velocity @ AXIS) ** 2, k=3
    )

    def slope(t, y):
        return [y[1], pull(t) + (spin(t) - omega**2) * y[0] - 2 * ratio * omega * y[1]]

    begin = [float(pull(0.0) / (omega**2 - spin(0.0))), 0.0]
    return solve_ivp(slope, at.seconds[[0, -1]], begin, t_eval=at.seconds, rtol=1e-9, atol=1e-11).y[0]


def test_gravity_along_a_mode_makes_it_sag_by_g_over_omega_squared():
    at = at_rest()
    effect = effect_named("flexible_mode")
    found = effect.simulate(at, filled(effect, at, TYPICAL["flexible_mode"]))
    sag = at.gravity[0] @ AXIS / (2 * np.pi * 4.5) ** 2
    np.testing.assert_allclose(found[:, :3], 0.0, atol=1e-9)
    np.testing.assert_allclose(found[:, 3:], np.cross(sag * AXIS, 0.6 * at.gravity), atol=1e-6)


def test_a_loose_part_is_held_at_a_stop_or_flies_by_newtons_law():
    at = recorded("poses", jitter=0.0, period=0.002)
    effect = effect_named("loose_part")
    values = filled(effect, at, TYPICAL["loose_part"] | {"friction": 0.05})
    felt = specific_at(at, POINT)
    drag = 0.05 * np.linalg.norm(np.cross(AXIS, felt), axis=1)
    z, dz, second = between_stops(at.seconds, felt @ AXIS, values["gap"], values["settling"], drag)
    found = effect.simulate(at, values)
    # Held, it is the same mass beside the middle of its gap.
    half = values["gap"] / 2
    for side in (-1, 1):
        rows = (side * z > half) & (np.abs(second) < 0.03)
        assert rows.sum() > 100
        deep = side * float(np.median(np.abs(z[rows])))
        aside = point_wrench(at, POINT + deep * AXIS) - point_wrench(at, POINT)
        np.testing.assert_allclose(found[rows], 0.35 * aside[rows], atol=0.02)
    # In flight, dry friction alone holds it along the axis: the part takes the tool with it.
    flies = np.flatnonzero((np.abs(z) < 0.6 * half) & (np.abs(dz) > 0.02))
    assert len(flies) > 10
    total = (found + 0.35 * point_wrench(at, POINT))[flies, :3] @ AXIS
    np.testing.assert_allclose(total, 0.35 * (drag * np.sign(dz))[flies], atol=0.01 * 0.35 * STANDARD_GRAVITY)


@pytest.mark.parametrize("name", ["slosh", "hanging_chain"])
def test_what_swings_may_be_missing_in_the_nominal_model_or_be_modelled_where_it_rests(name):
    """A generator that adds a chain to the payload had a false `payload_parameters` beside it (99.5 %)."""
    at, values = at_rest(duration=1.0), TYPICAL[name] | {"damping_ratio": 0.05}
    pivot, nowhere, below = (response(name, at, **values, nominal=place) for place in (0.0, 1.0, 2.0))
    mass = (
        effect_named(name).derived(at, filled(effect_named(name), at, values)).get("total_mass", (values["mass"],))[0]
    )
    # At rest it hangs below its pivot: static poses show it there.
    np.testing.assert_allclose(pivot, 0.0, atol=1e-6)
    np.testing.assert_allclose(nowhere, mass * point_wrench(at, POINT), atol=1e-6)
    shift = below[:, 3:] + np.cross(POINT, below[:, :3])
    np.testing.assert_allclose(below[:, :3], 0.0, atol=1e-6)
    assert np.linalg.norm(shift, axis=1).max() < mass * STANDARD_GRAVITY * values["length"] * 1.2


def test_a_rope_that_the_payload_lacks_is_one_cause():
    at, rope = recorded("poses"), effect_named("hanging_chain")
    values = filled(rope, at, TYPICAL["hanging_chain"] | {"nominal": 1.0})
    noise = np.random.default_rng(8).normal(size=at.wrench.shape) * NOISE
    problem = wrench_problem(
        replace(at, wrench=at.prediction + rope.simulate(at, values) + noise), NominalModel(phi=at.phi)
    )
    _, best = search(problem, [rope, effect_named("slosh"), effect_named("payload_parameters")])
    assert names(best) == ("hanging_chain",)
    assert "lacks them" in rope.sentence(at, best.parts[0].values)


def test_a_payload_where_the_model_has_none_reports_its_own_centre_of_mass() -> None:
    at, effect = replace(fine(), phi=np.zeros(10)), effect_named("payload_parameters")
    assert effect is not None
    names_of = [parameter.name for parameter in effect.parameters(at)]
    found = effect.derived(at, dict(zip(names_of, PAYLOAD.phi.tolist(), strict=True)))
    assert [found[f"com_{axis}"][0] for axis in "xyz"] == pytest.approx(PAYLOAD.com)
    assert [found[f"inertia_{axes}"][0] for axes in ("xx", "xy", "xz", "yy", "yz", "zz")] == pytest.approx(
        PAYLOAD.inertia_vector
    )


@pytest.mark.parametrize("length", [0.01, 0.03, 0.1])
def test_only_a_wide_vessel_holds_much_that_sloshes(length: float) -> None:
    """118 g that swing as 8 mm were named with 83 % for a payload that was a tenth heavier, on a SCARA."""
    at, liquid = recorded("poses"), effect_named("slosh")
    root = 1.8412  # first zero of the derivative of the Bessel function J1: l = R / root
    radius, depth = root * length, 5.0 * root * length
    water = 1000.0 * np.pi * radius**2 * depth
    first = water * 2.0 * radius * np.tanh(root * depth / radius) / (root * depth * (root**2 - 1.0))
    values = filled(liquid, at, TYPICAL["slosh"] | {"length": length, "mass": min(first, 0.3 * at.phi[0])})
    assert liquid.implausible(at, values) == ""
    assert "do not swing as fast" in liquid.implausible(at, values | {"length": 0.008, "mass": 0.118})
