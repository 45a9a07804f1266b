"""Identification motions: exact derivatives, bounds that hold everywhere, more information than chance finds."""

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.excitation import (
    ExcitationOptions,
    Guard,
    Information,
    MotionLimits,
    PayloadBelief,
    SearchEffort,
    certify,
    plan_excitation,
    plan_stop_and_go,
    slowed,
    tool_centre,
)
from poise.excitation.certificate import _polynomial_bounds
from poise.excitation.clamped_spline import ClampedSpline
from poise.excitation.hand import hand_motion
from poise.excitation.information import SENSOR
from poise.excitation.limits import moving_joints
from poise.excitation.search import ExcitationObjective
from poise.inertia.model.parts import Parts
from poise.inertia.model.signals import motion_signals, residual_covariance
from poise.inertia.model.wrench_regressor import regressor
from poise.robot import RobotModel, frame_poses, sensor_motion
from poise.simulation import FourierTrajectory, SplineTrajectory, WaypointTrajectory, check_limits, home

HOME = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])
QUICK = ExcitationOptions(effort=SearchEffort(starts=2, first=8, steps=15))
RADIUS = 0.12


@pytest.fixture(scope="module")
def fr3() -> RobotModel:
    return RobotModel.from_file("fr3")


@pytest.fixture(scope="module")
def guard(fr3: RobotModel) -> Guard:
    return Guard.ball(tool_centre(fr3, "tcp"), RADIUS)


def wander(rng: np.random.Generator, model: RobotModel, stops: int = 5) -> WaypointTrajectory:
    """Random waypoints with random velocities and accelerations."""
    size = (stops, len(model.joint_names))
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.2, 0.6, stops - 1))])
    position = home(model) + rng.uniform(-0.3, 0.3, size)
    return WaypointTrajectory(times, position, rng.normal(0, 0.4, size), rng.normal(0, 2.0, size))


def test_all_guarded_points_at_once_give_what_each_gives_alone(fr3: RobotModel) -> None:
    motion = FourierTrajectory.random(fr3, np.random.default_rng(4), duration=2.0, speed=0.5)
    times = np.linspace(0.0, 2.0, 41)
    motion = WaypointTrajectory(times, *motion.at(times))
    points = np.random.default_rng(5).normal(scale=0.2, size=(7, 3))
    each = [certify(fr3, motion, Guard(point[None])).speed for point in points]
    reach = [certify(fr3, motion, Guard(np.vstack([point, points]))).speed for point in points]
    np.testing.assert_allclose(reach, reach[0], rtol=1e-12)
    assert reach[0] == pytest.approx(max(each), rel=1e-3)  # the bound of the jerk grows with the farthest point
    assert reach[0] >= max(each) * (1 - 1e-12)


def fastest(model: RobotModel, motion, points: np.ndarray, count: int = 4000) -> float:
    """m/s of points (P, 3) in the sensor frame, from their places alone: chords between neighbouring instants."""
    seconds = np.linspace(0.0, motion.duration, count)
    rotation, where = frame_poses(model, motion.at(seconds).position)
    places = np.einsum("nij,pj->npi", rotation, points) + where[:, None]
    return float(np.linalg.norm(np.diff(places, axis=0), axis=2).max() / (seconds[1] - seconds[0]))


def on_ball(guard: Guard, rng: np.random.Generator, count: int = 300) -> np.ndarray:
    directions = rng.normal(size=(count, 3))
    return guard.tcp + guard.radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)


# -- what is optimised --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("robot", ["fr3", "xarm7", "ridgeback_ur10"])
def test_the_gradient_is_that_of_finite_differences(robot: str) -> None:
    model = RobotModel.from_file(robot)
    corners = np.random.default_rng(3).uniform(-0.1, 0.1, (20, 3)) + np.array([0, 0, 0.2])
    guard = Guard.outline(tool_centre(model, "tcp"), corners, margin=0.01)
    spline = ClampedSpline.make(1.5, 30)
    information = Information(PayloadBelief.ball(guard.tcp, 0.1, 1.0))
    start, active = home(model), moving_joints(model)
    objective = ExcitationObjective(model, start, active, spline, guard, MotionLimits(), information)
    rng = np.random.default_rng(1)
    unknowns = rng.normal(size=objective.shape).ravel() * 0.01
    _, gradient = objective(unknowns, 0.1)
    for index in rng.integers(0, len(unknowns), 8):
        step = np.zeros_like(unknowns)
        step[index] = 1e-6
        ends = [objective(unknowns + sign * step, 0.1)[0] for sign in (1, -1)]
        assert gradient[index] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-3, abs=1e-3)


def test_the_hand_moves_as_the_kinematics_say(fr3: RobotModel) -> None:
    motion = wander(np.random.default_rng(0), fr3)
    seconds = np.linspace(0.0, motion.duration, 9)
    hand = hand_motion(fr3, *motion.at(seconds))
    known = sensor_motion(fr3, np.zeros(9, dtype=np.int64), *motion.at(seconds))
    np.testing.assert_allclose(hand.acceleration, known.linear_acceleration_in_sensor, atol=1e-12)
    np.testing.assert_allclose(
        hand.specific, known.gravity_in_sensor() - known.linear_acceleration_in_sensor, atol=1e-12
    )


def test_the_information_is_that_of_the_regressor_with_the_bias_eliminated() -> None:
    rng = np.random.default_rng(2)
    belief = PayloadBelief.ball(np.array([0, 0, 0.15]), 0.1, 1.5)
    u, omega, alpha = rng.normal(size=(3, 40, 3)) * np.array([9.8, 1.0, 8.0])[:, None, None]
    rows = np.concatenate([regressor(u, omega, alpha), np.tile(np.eye(6), (40, 1, 1))], axis=2)
    weight = np.linalg.inv(residual_covariance(belief.phi, SENSOR))
    total = np.einsum("nip,ij,njr->pr", rows, weight, rows) * 2.0  # each stands for two samples
    total[:10, :10] += np.linalg.inv(belief.covariance)
    total[10:, 10:] += np.diag(np.repeat([SENSOR.force_bias, SENSOR.torque_bias], 3) ** -2.0)
    left = total[:10, :10] - total[:10, 10:] @ np.linalg.solve(total[10:, 10:], total[10:, :10])
    nats = np.linalg.slogdet(left)[1] + np.linalg.slogdet(belief.covariance)[1]
    information = Information(belief, rate=100.0)
    signals = motion_signals(u, omega, alpha)
    assert information.value(signals, 0.02) == pytest.approx(nats, rel=1e-9)
    np.testing.assert_allclose(information.covariance(signals, 0.02), np.linalg.inv(left), rtol=1e-6, atol=1e-14)


def test_waypoints_at_the_knots_are_the_spline_itself_at_rest_at_both_ends() -> None:
    spline = ClampedSpline.make(1.5, 200)
    coefficients = np.random.default_rng(4).normal(size=(spline.size, 3))
    motion = spline.trajectory(np.array([0.1, 0.2, 0.3]), coefficients)
    seconds = (np.arange(200) + 0.5) * 1.5 / 200
    for basis, said, offset in zip(spline.values, motion.at(seconds), ([0.1, 0.2, 0.3], 0, 0), strict=True):
        np.testing.assert_allclose(said, basis @ coefficients + offset, atol=1e-9)
    ends = motion.at(np.array([0.0, 1.5]))
    np.testing.assert_allclose(ends.position, [[0.1, 0.2, 0.3]] * 2, atol=1e-12)
    np.testing.assert_allclose([ends.velocity, ends.acceleration], 0.0, atol=1e-9)
    for basis, polygon in zip(spline.values, spline.polygons, strict=True):
        curve, points = basis @ coefficients, polygon @ coefficients
        assert (curve <= points.max(axis=0) + 1e-9).all()
        assert (curve >= points.min(axis=0) - 1e-9).all()


# -- proof --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_no_sample_however_dense_exceeds_the_certificate_and_few_stay_far_below(fr3: RobotModel, guard, seed) -> None:
    rng = np.random.default_rng(seed)
    motion = wander(rng, fr3)
    found = certify(fr3, motion, guard)
    dense = motion.at(np.linspace(0.0, motion.duration, 20_001))
    assert np.abs(dense.acceleration).max() <= found.acceleration <= np.abs(dense.acceleration).max() * 1.1
    assert (np.abs(dense.velocity) / fr3.velocity_limit).max() <= found.joint_speed + 1e-12
    measured = fastest(fr3, motion, on_ball(guard, rng))
    assert measured <= found.speed + 1e-9
    # A ball's fastest point is at most |v| + r |omega|, less when the one is along the other.
    assert fastest(fr3, motion, guard.points) <= certify(fr3, motion, Guard.ball(guard.tcp, 0.0)).speed
    assert found.speed <= 1.25 * measured


def test_the_polynomial_bounds_hold_and_are_tight() -> None:
    rng = np.random.default_rng(5)
    motion = WaypointTrajectory(np.array([0, 0.5, 0.8]), *rng.normal(size=(3, 3, 2)))
    dense = motion.at(np.linspace(0.0, 0.8, 50_001))
    for (low, high), curve in zip(_polynomial_bounds(motion), dense, strict=False):
        assert (low <= curve.min(axis=0) + 1e-12).all()
        assert (high >= curve.max(axis=0) - 1e-12).all()
        assert ((high - low) <= 1.15 * np.ptp(curve, axis=0)).all()


def test_stretching_time_slows_everything_as_it_should(fr3: RobotModel, guard: Guard) -> None:
    motion = wander(np.random.default_rng(7), fr3)
    before, after = certify(fr3, motion, guard), certify(fr3, slowed(motion, 2.0), guard)
    assert after.speed == pytest.approx(before.speed / 2, rel=0.01)
    assert after.acceleration == pytest.approx(before.acceleration / 4)
    assert after.duration == 2 * before.duration


@pytest.mark.parametrize("robot", ["fr3", "xarm7", "ridgeback_ur10"])
@pytest.mark.parametrize("plan", [plan_excitation, plan_stop_and_go])
def test_plans_keep_to_their_limits_and_come_back(robot: str, plan) -> None:
    model, limits = RobotModel.from_file(robot), MotionLimits()
    guard = Guard.ball(tool_centre(model, "tcp"), 0.15)
    start = HOME if robot == "fr3" else home(model)
    found = plan(model, start, guard, limits, QUICK)
    check_limits(model, found.motion)
    assert found.certificate.holds(limits)
    assert fastest(model, found.motion, np.vstack([guard.tcp, on_ball(guard, np.random.default_rng(0), 50)])) <= 0.25
    ends = found.motion.at(np.array([0.0, found.motion.duration]))
    np.testing.assert_allclose(ends.position, [start, start], atol=1e-12)
    np.testing.assert_allclose([ends.velocity, ends.acceleration], 0.0, atol=1e-9)
    moved = np.ptp(found.motion.position, axis=0) > 0
    assert not any(moved[i] for i, name in enumerate(model.joint_names) if name.startswith("base_"))
    if plan is plan_excitation:
        assert found.motion.duration == pytest.approx(1.5, rel=0.05)


# -- worth --------------------------------------------------------------------------------------------------------


def as_large_as_allowed(model: RobotModel, series, guard: Guard, limits: MotionLimits) -> WaypointTrajectory:
    """The series about its centre, as large as the limits allow."""
    knots = np.linspace(0.0, series.duration, 61)
    rows = SplineTrajectory(knots, series.at(knots).position).at(knots)
    low, high = 0.0, 1.0
    for _ in range(8):
        scale = (low + high) / 2
        motion = WaypointTrajectory(
            knots,
            series.centre + scale * (rows.position - series.centre),
            scale * rows.velocity,
            scale * rows.acceleration,
        )
        if certify(model, motion, guard).holds(limits):
            low, kept = scale, motion
        else:
            high = scale
    return kept


def test_the_plan_tells_far_more_than_random_series_at_the_same_limits(fr3: RobotModel, guard: Guard) -> None:
    limits = MotionLimits()
    planned = plan_excitation(fr3, HOME, guard, limits)
    information = Information(planned.belief)
    seconds = (np.arange(150) + 0.5) * 0.01
    best = -np.inf
    for seed in range(10):
        rng = np.random.default_rng(seed)
        series = FourierTrajectory.random(fr3, rng, duration=1.5, speed=0.9, frequency=2 / 3, centre=HOME)
        kept = as_large_as_allowed(fr3, series, guard, limits)
        hand = hand_motion(fr3, *kept.at(seconds))
        best = max(best, information.value(motion_signals(hand.specific, hand.omega, hand.alpha), 0.01))
    assert planned.information > best + 10


def test_the_same_seed_gives_the_same_motion(fr3: RobotModel, guard: Guard) -> None:
    first, second = (plan_excitation(fr3, HOME, guard, options=QUICK) for _ in range(2))
    np.testing.assert_array_equal(first.motion.position, second.motion.position)


def test_stop_and_go_rests_where_gravity_comes_from_many_sides(fr3: RobotModel, guard: Guard) -> None:
    found = plan_stop_and_go(fr3, HOME, guard)
    seconds = np.linspace(0, found.motion.duration, 4000)
    motion = found.motion.at(seconds)
    rests = np.abs(motion.velocity).max(axis=1) < 1e-9
    down = hand_motion(fr3, *motion).specific[rests] / 9.80665
    assert np.linalg.eigvalsh(np.cov(down.T))[0] > 0.01  # they span space, not a plane
    assert found.mass_std < 0.01


def test_a_known_shape_is_guarded_by_its_corners_and_needs_less(fr3: RobotModel) -> None:
    tcp = tool_centre(fr3, "tcp")
    corners = tcp + np.array([[x, y, z] for x in (-0.02, 0.02) for y in (-0.02, 0.02) for z in (0.0, 0.2)])
    tetrahedra = np.array([[0, 1, 2, 4], [1, 2, 3, 7], [1, 4, 5, 7], [2, 4, 6, 7], [1, 2, 4, 7]])
    parts = Parts.from_tetrahedra(corners, tetrahedra)
    guard = Guard.outline(tcp, parts.points)
    found = plan_excitation(fr3, HOME, guard, options=QUICK, parts=parts)
    assert fastest(fr3, found.motion, guard.points) <= 0.25
    assert np.linalg.eigvalsh(found.covariance)[0] > 0


# -- what cannot be ------------------------------------------------------------------------------------------------


def refused(kind: type[PoiseError], call) -> ErrorCode:
    with pytest.raises(kind) as caught:
        call()
    return caught.value.code


def test_what_makes_no_sense_is_refused_with_its_code(fr3: RobotModel, guard: Guard) -> None:
    start = HOME.copy()
    start[3] = 1.0
    assert refused(InputError, lambda: plan_excitation(fr3, start, guard)) == ErrorCode.JOINT_LIMIT
    assert refused(InputError, lambda: plan_excitation(fr3, HOME[:3], guard)) == ErrorCode.TYPE_MISMATCH
    assert refused(InputError, lambda: plan_excitation(fr3, HOME * np.nan, guard)) == ErrorCode.NOT_FINITE
    assert refused(InputError, lambda: tool_centre(fr3, "fr3_link3")) == ErrorCode.FRAME_UNKNOWN
    assert refused(InputError, lambda: MotionLimits(speed=0.0)) == ErrorCode.BAD_INPUT
    assert refused(InputError, lambda: Guard.ball(np.zeros(3), -1.0)) == ErrorCode.BAD_INPUT
    assert refused(InputError, lambda: ExcitationOptions(duration=np.nan)) == ErrorCode.BAD_INPUT
    assert refused(InputError, lambda: moving_joints(fr3, ("elbow",))) == ErrorCode.JOINT_MISSING


@pytest.mark.parametrize(("radius", "speed"), [(1000.0, 0.25), (0.3, 0.0005)])
def test_an_object_too_large_to_be_moved_under_the_speed_limit_is_refused(fr3: RobotModel, radius, speed) -> None:
    guard, limits = Guard.ball(tool_centre(fr3, "tcp"), radius), MotionLimits(speed=speed)
    code = refused(NoAnswerError, lambda: plan_excitation(fr3, HOME, guard, limits, QUICK))
    assert code in (ErrorCode.NOT_IDENTIFIABLE, ErrorCode.UNREACHABLE)
    assert refused(NoAnswerError, lambda: plan_stop_and_go(fr3, HOME, guard, limits)) == ErrorCode.UNREACHABLE


def test_where_the_best_poses_have_no_way_within_the_room_others_are_chosen(fr3: RobotModel) -> None:
    start = HOME + np.random.default_rng(0).uniform(-0.5, 0.5, 7)
    guard, limits = Guard.ball(tool_centre(fr3, "tcp"), 0.1), MotionLimits(room=0.02)
    found = plan_stop_and_go(fr3, start, guard, limits)
    assert found.certificate.room <= 0.02
    assert len(np.unique(np.round(found.motion.position, 9), axis=0)) >= 3
    assert found.mass_std < 0.01


def test_the_answer_for_an_object_that_is_too_large_depends_on_no_encoder_noise(fr3: RobotModel) -> None:
    """Seeds 0 and 1 had SOLVER_FAILED: the bound of the tool's way grew with the object."""
    guard = Guard.ball(tool_centre(fr3, "tcp"), 100.0)
    for seed in (0, 1):
        start = home(fr3) + np.random.default_rng(seed).normal(0, 1e-5 if seed % 2 else 0.05, 7)
        assert refused(NoAnswerError, lambda start=start: plan_stop_and_go(fr3, start, guard)) == ErrorCode.UNREACHABLE


def test_the_way_of_the_tool_is_bounded_alike_for_every_object(fr3: RobotModel) -> None:
    motion = slowed(wander(np.random.default_rng(3), fr3), 200.0)
    small, large = (certify(fr3, motion, Guard.ball(tool_centre(fr3, "tcp"), radius)).room for radius in (0.0, 100.0))
    assert large == pytest.approx(small, rel=1e-12)


@pytest.mark.parametrize("plan", [plan_excitation, plan_stop_and_go])
def test_planning_says_how_far_it_is_and_stops_when_told(fr3: RobotModel, guard: Guard, plan) -> None:
    shares: list[float] = []
    plan(fr3, HOME, guard, options=QUICK, progress=shares.append)
    assert shares == sorted(shares)
    assert 0.5 < shares[-1] <= 1.0
    asked = 0

    def cancelled() -> bool:
        nonlocal asked
        asked += 1
        return asked > 3

    assert (
        refused(PoiseError, lambda: plan(fr3, HOME, guard, options=QUICK, cancelled=cancelled)) == ErrorCode.CANCELLED
    )
    assert asked == 4
