"""MuJoCo against pinocchio and against closed forms: the benchmark's engine says what physics says."""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("mujoco", reason="the benchmark's engine is an extra: pip install '.[sim]'")

from benchmarks.concealed.changes import WRENCH_EFFECTS
from benchmarks.concealed.changes.base import Change
from benchmarks.concealed.changes.chain import lagged
from benchmarks.concealed.changes.friction import Backlash
from benchmarks.concealed.changes.moving import Rotor, Slider
from benchmarks.concealed.engine import Engine, Log
from benchmarks.concealed.motions import HOME, Motion, drive, fourier, pick_and_place, still, through
from benchmarks.concealed.payload import Payload
from benchmarks.concealed.robot import description
from benchmarks.concealed.scene import Scene
from poise.inertia.model.parameters import InertialParameters
from poise.robot import BaseMotion, RobotModel
from poise.simulation import IdealRobot, JointMotion

SHORT = 6.0  # s
GRAVITY = 9.80665


def scene(seed: int = 5, arm: str = "fourier") -> Scene:
    rng = np.random.default_rng(seed)
    payload = Payload.random(rng)
    return Scene(payload, Motion(arm, fourier(rng) if arm == "fourier" else pick_and_place(rng), drive(rng)))


def at_rest() -> Scene:
    """A tilted tool that does not move."""
    pose = HOME + np.array([0.0, 0.0, 0.3, 0.5, 0.4, 0.3])
    arm = lambda t: (np.tile(pose, (len(t), 1)), *still(6)(t)[:2])  # noqa: E731
    return Scene(Payload.random(np.random.default_rng(4)), Motion("rest", arm, still(3)))


def gained(there: Scene, change: Change, duration: float = SHORT) -> tuple[Log, np.ndarray]:
    """The simulation with a change, and what it adds to the wrench of the rigid world (K, 6)."""
    engine = Engine(there.payload, there.motion, [change])
    log = engine.run(duration)
    return log, log.wrench - Engine(there.payload, there.motion, step=engine.step).run(duration).wrench


@pytest.mark.parametrize("arm", ["fourier", "pick and place"])
def test_without_an_effect_mujoco_and_pinocchio_agree_to_a_millionth(arm: str) -> None:
    there = scene(arm=arm)
    log = Engine(there.payload, there.motion, step=0.01).run()
    model = RobotModel.from_urdf(description(), base="floating")
    payload = there.payload
    recorded = IdealRobot(model, InertialParameters(payload.mass, payload.com, payload.inertia).phi)
    base = BaseMotion.planar(*there.motion.base(log.seconds))
    truth = recorded.simulate((log.seconds * 1e9).astype(np.int64), JointMotion(*log.arm), base)
    assert np.abs(truth.wrench_in_sensor).max() > 10.0
    np.testing.assert_allclose(log.wrench, truth.wrench_in_sensor, atol=1e-6)
    np.testing.assert_allclose(log.effort, truth.effort, atol=1e-6)
    np.testing.assert_allclose(log.rotation_world_sensor, truth.motion.rotation_world_sensor, atol=1e-12)


def test_motions_are_the_derivatives_of_themselves_and_start_at_rest() -> None:
    times = np.arange(0.0, 35.0, 1e-4)[: 2 * 10**5]
    for curve in (scene().motion.arm, scene(arm="p").motion.arm, scene().motion.base):
        position, velocity, acceleration = curve(times)
        assert np.abs(velocity[0]).max() == 0.0
        assert np.abs(np.gradient(position, times, axis=0) - velocity)[2:-2].max() < 1e-5
        assert np.abs(np.gradient(velocity, times, axis=0) - acceleration)[2:-2].max() < 1e-2


def test_the_imu_feels_gravity_upwards_and_the_drive() -> None:
    there = scene()
    log = Engine(there.payload, Motion("rest", there.motion.arm, still(3)), step=0.01).run(SHORT)
    np.testing.assert_allclose(log.imu, np.tile([0, 0, 0, 0, 0, GRAVITY], (len(log.imu), 1)), atol=1e-6)
    moving = Engine(there.payload, there.motion, step=0.01).run(SHORT)
    assert np.abs(moving.imu[:, 3:5]).max() > 0.2


def test_a_flywheel_adds_minus_omega_cross_its_angular_momentum() -> None:
    there = scene()
    change = WRENCH_EFFECTS["flywheel"](there, 1.0, np.random.default_rng(1))
    assert isinstance(change, Rotor)
    log, added = gained(there, change)
    turning = np.gradient(log.rotation_world_sensor, log.seconds, axis=0)
    skew = np.einsum("nji,njk->nik", log.rotation_world_sensor, turning)
    omega = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    momentum = np.array([change.parameters[f"momentum_{axis}"] for axis in "xyz"])
    expected = -np.cross(omega, momentum)
    assert np.abs(expected).max() > 0.02
    # The rotor keeps its own turning in space, its share of the rigid inertia: 2e-4 kg m2.
    np.testing.assert_allclose(added[5:-5, 3:], expected[5:-5], atol=2e-3)
    assert np.abs(added[:, :3]).max() < 1e-6


def test_a_pull_is_constant_in_the_world_and_acts_at_its_point() -> None:
    there = scene()
    change = WRENCH_EFFECTS["world_force"](there, 1.0, np.random.default_rng(1))
    log, added = gained(there, change)
    in_world = np.einsum("nij,nj->ni", log.rotation_world_sensor, added[:, :3])
    pull = [change.parameters[f"force_{axis}"] for axis in "xyz"]
    np.testing.assert_allclose(in_world, np.tile(pull, (len(in_world), 1)), atol=1e-6)
    place = [change.parameters[axis] for axis in "xyz"]
    np.testing.assert_allclose(added[:, 3:], np.cross(np.array(place), added[:, :3]), atol=1e-6)


def test_a_mass_comes_at_its_time_and_weighs_what_it_should() -> None:
    there = scene()
    rng = np.random.default_rng(3)
    change = next(c for c in (WRENCH_EFFECTS["mass_step"](there, 1.0, rng) for _ in range(20)) if _comes(c))
    change = dataclasses.replace(change, times=(2.0,))
    log, added = gained(there, change)
    before = log.seconds < 2.0
    assert np.abs(added[before]).max() < 1e-6
    weight = np.linalg.norm(added[~before, :3], axis=1)
    assert abs(weight.mean() - 0.3 * GRAVITY) < 0.3
    place = np.array([change.parameters[axis] for axis in "xyz"])
    np.testing.assert_allclose(added[:, 3:], np.cross(place, added[:, :3]), atol=1e-6)


def test_a_cable_pulls_along_itself_as_hard_as_it_is_stretched() -> None:
    there = scene()
    change = WRENCH_EFFECTS["cable"](there, 1.0, np.random.default_rng(8))
    log, added = gained(there, change)
    p = change.parameters
    place = np.array([p[axis] for axis in "xyz"])
    line = np.array([p[f"anchor_{axis}"] for axis in "xyz"]) - log.position_in_world
    line -= log.rotation_world_sensor @ place
    length = np.linalg.norm(line, axis=1)
    tension = p["stiffness"] * np.maximum(length - p["rest_length"], 0.0) + p["damping"] * np.gradient(
        length, log.seconds
    )
    in_world = np.einsum("nij,nj->ni", log.rotation_world_sensor, added[:, :3])
    np.testing.assert_allclose(in_world[5:-5], ((tension / length)[:, None] * line)[5:-5], atol=2e-3)


def test_a_spring_rings_at_its_frequency_and_dies_away_as_damped() -> None:
    payload = Payload.random(np.random.default_rng(2))
    poses = HOME + np.array([[0, 0, 0, 0, 0, 0], [0.3, 0.1, 0, 0, 0, 0]], dtype=float)
    motion = Motion("one move", through(poses, 1.5, 4.0, 0.06, np.array([0.2, 1.0])), still(3))
    part = Slider(
        name="flexible_mode",
        step=5e-4,
        place=payload.com,
        mass=0.3,
        axis=np.array([1.0, 0.0, 0.0]),
        frequency=5.0,
        damping_ratio=0.03,
    )
    log, added = gained(Scene(payload, motion), part)
    after = log.seconds > 2.0  # the arm stands
    ringing = added[after, 0] - added[-1, 0]
    rises = np.flatnonzero((ringing[:-1] < 0) & (ringing[1:] >= 0))[:8]
    period = np.diff(log.seconds[after][rises]).mean()
    assert abs(1 / period - 5.0 * np.sqrt(1 - 0.03**2)) < 0.02
    peaks = [np.abs(ringing[a:b]).max() for a, b in itertools.pairwise(rises)]
    decrement = np.log(np.array(peaks[:-1]) / peaks[1:]).mean()
    assert abs(decrement / (2 * np.pi) - 0.03) < 0.003


def test_at_rest_a_pendulum_weighs_as_if_it_were_at_its_pivot() -> None:
    there = at_rest()
    _, added = gained(there, WRENCH_EFFECTS["slosh"](there, 1.0, np.random.default_rng(1)), 0.5)
    assert np.abs(added).max() < 0.02


def test_drag_is_against_the_motion_and_grows_with_the_square_of_its_speed() -> None:
    there = scene()
    change = WRENCH_EFFECTS["air_drag"](there, 1.0, np.random.default_rng(1))
    log, added = gained(there, change)
    place = np.array([change.parameters[axis] for axis in "xyz"])
    points = log.position_in_world + log.rotation_world_sensor @ place
    velocity = np.gradient(points, log.seconds, axis=0)
    expected = -change.parameters["coefficient"] * np.linalg.norm(velocity, axis=1, keepdims=True) * velocity
    in_world = np.einsum("nij,nj->ni", log.rotation_world_sensor, added[:, :3])
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(in_world[2:-2], expected[2:-2], atol=2e-3)


def test_a_loose_part_at_rest_lies_at_one_of_its_stops() -> None:
    there = at_rest()
    turning = dataclasses.replace(scene(), payload=there.payload)
    change = WRENCH_EFFECTS["loose_part"](turning, 1.0, np.random.default_rng(1))
    log, added = gained(there, change, 0.5)
    p = change.parameters
    axis = np.array([p["axis_x"], p["axis_y"], p["axis_z"]])
    down = -log.rotation_world_sensor[-1, 2]
    moved = np.sign(axis @ down) * p["gap"] / 2 * axis
    expected = np.cross(moved, p["mass"] * GRAVITY * down)
    assert np.linalg.norm(expected) > 3e-3
    np.testing.assert_allclose(added[-1, 3:], expected, atol=0.1 * np.linalg.norm(expected))
    assert np.abs(added[-1, :3]).max() < 1e-3


def test_a_soft_grasp_sags_until_its_springs_hold_the_weight() -> None:
    there = at_rest()
    change = WRENCH_EFFECTS["grasp_compliance"](there, 1.0, np.random.default_rng(1))
    log, added = gained(there, change, 0.5)
    payload, stiffness = there.payload, change.parameters["stiffness"]
    pivot = np.array([0.0, 0.0, change.parameters["height"]])
    weight = payload.mass * GRAVITY * -log.rotation_world_sensor[-1, 2]
    turned = np.zeros(3)
    for _ in range(50):
        lever = Rotation.from_rotvec(turned).apply(payload.com - pivot)
        turned = np.cross(lever, weight) / stiffness
    expected = np.cross(lever - (payload.com - pivot), weight)
    assert np.linalg.norm(expected) > 0.01
    np.testing.assert_allclose(added[-1, 3:], expected, atol=0.02 * np.linalg.norm(expected))


def test_a_contact_presses_as_hard_as_planned_in_its_window_alone() -> None:
    there = scene(arm="pick and place")
    change = WRENCH_EFFECTS["contact"](there, 1.0, np.random.default_rng(2))
    log, added = gained(there, change, 35.0)
    ((start, end),) = change.windows
    inside = (log.seconds >= start) & (log.seconds <= end)
    assert 0.5 < end - start < 3.5
    assert np.abs(added[~inside]).max() < 1e-6
    assert abs(np.linalg.norm(added[:, :3], axis=1).max() - 9.0) < 0.5
    assert abs(change.parameters["peak_force"] - 9.0) < 0.5


def test_backlash_gives_no_effort_in_the_gap_and_the_same_work_in_the_mean() -> None:
    there = scene(arm="pick and place")
    engine = Engine(there.payload, there.motion)
    log = engine.run(SHORT)
    effort = log.effort + Backlash(joint=0, gap=0.02).effort(engine, log)
    assert (effort[:, 0] == 0.0).mean() > 0.02
    np.testing.assert_array_equal(effort[:, 1:], log.effort[:, 1:])
    # What is not pushed in the gap is made up for at its end: momentum is kept.
    assert abs(effort[:, 0].mean() - log.effort[:, 0].mean()) < 0.1 * np.abs(log.effort[:, 0]).mean()


def test_a_lag_follows_a_ramp_exactly() -> None:
    times = np.arange(0.0, 2.0, 0.01)
    ramp = np.outer(times, np.ones(6))
    expected = times - 0.3 * (1 - np.exp(-times / 0.3))
    np.testing.assert_allclose(lagged(ramp, 0.01, 0.3)[:, 0], expected, atol=1e-12)


def _comes(change: Change) -> bool:
    return change.parameters["mass"] > 0
