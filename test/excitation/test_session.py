"""Identification sessions on a simulated arm: the payload within its covariance, slow enough, and no way to hang."""

from collections.abc import Callable

import numpy as np
import pytest
from rehearsal import Rehearsal, ready

from poise.errors import ErrorCode, PoiseError
from poise.excitation import (
    ExcitationOptions,
    ExcitationPlan,
    Guard,
    MotionLimits,
    SearchEffort,
    certify,
    plan_excitation,
    plan_stop_and_go,
    tool_centre,
)
from poise.excitation.execution import ReadyStops, SessionPhase, brake
from poise.excitation.execution import stops as brake_module
from poise.inertia import InertialParameters
from poise.robot import RobotModel
from poise.simulation import FourierTrajectory, home

LIMITS = MotionLimits()
RADIUS = 0.12
PAYLOADS = {
    "drill": InertialParameters(1.6, np.array([0.0, 0.02, 0.19]), np.diag([0.009, 0.006, 0.005])),
    "bottle": InertialParameters(0.5, np.array([0.0, 0.0, 0.2]), np.diag([0.0012, 0.0012, 0.0004])),
    "block": InertialParameters(2.5, np.array([-0.02, 0.01, 0.17]), np.diag([0.008, 0.010, 0.012])),
}


@pytest.fixture(scope="module")
def model() -> RobotModel:
    return RobotModel.from_file("fr3")


@pytest.fixture(scope="module")
def guard(model: RobotModel) -> Guard:
    return Guard.ball(tool_centre(model, "tcp"), RADIUS)


@pytest.fixture(scope="module")
def swing(model: RobotModel, guard: Guard) -> ExcitationPlan:
    return plan_excitation(model, home(model), guard, options=ExcitationOptions(effort=SearchEffort(2, 10, 30)))


@pytest.fixture(scope="module")
def round_trip(model: RobotModel, guard: Guard) -> ExcitationPlan:
    return plan_stop_and_go(model, home(model), guard)


def surface(guard: Guard) -> np.ndarray:
    """The tool centre point, and points all over the ball that the object lies in."""
    directions = np.random.default_rng(0).normal(size=(200, 3))
    return np.vstack([guard.tcp, guard.tcp + guard.radius * directions / np.linalg.norm(directions, axis=1)[:, None]])


def nees(estimate, truth: InertialParameters) -> float:
    error = estimate.phi - truth.phi
    deviation = np.sqrt(np.diag(estimate.covariance))
    correlation = estimate.covariance / np.outer(deviation, deviation)
    return float((error / deviation) @ np.linalg.pinv(correlation, rcond=1e-9, hermitian=True) @ (error / deviation))


@pytest.mark.parametrize(("motion", "name"), [("swing", "bottle"), ("swing", "block"), ("round_trip", "drill")])
def test_the_payload_is_found_within_its_covariance_and_slowly_enough(motion, name, guard, request) -> None:
    truth = PAYLOADS[name]
    stage = Rehearsal(truth.phi, seed=len(name))
    session = stage.run(ready(request.getfixturevalue(motion)), guard, LIMITS)
    assert session.error is None
    assert nees(session.answer, truth) < 29.6  # 99.9 % of chi2 with 10 degrees of freedom
    assert session.answer.parameters.mass == pytest.approx(truth.mass, rel=0.02)
    np.testing.assert_allclose(session.answer.parameters.com, truth.com, atol=0.003)
    assert session.answer.consistent
    if motion == "swing":  # at rest most of the time, poses show no delay
        assert abs(session.answer.delay) < max(4 * session.answer.delay_std, 1e-4)
    assert stage.fastest(surface(guard)) <= LIMITS.speed * (1 + 2e-3)  # encoder noise of 1e-5 rad is in it
    assert [phase for _, phase in stage.phases] == [
        SessionPhase.WAITING,
        SessionPhase.PLANNING,
        SessionPhase.MOVING,
        SessionPhase.SETTLING,
        SessionPhase.DONE,
    ]


def err(stage: Rehearsal, truth: InertialParameters, seed: int) -> None:
    """Let the sensor err by 0.8 % of the load, with a time constant of 1 s, as on recordings of a KUKA arm."""
    rng, add_wrench = np.random.default_rng(seed), stage.live.add_wrench
    size = 0.008 * 9.81 * truth.mass * np.repeat([1.0, float(np.linalg.norm(truth.com))], 3)
    error, last = rng.normal(size=6) * size, None

    def read(stamp, frame, wrench, now) -> None:
        nonlocal error, last
        kept = 1.0 if last is None else np.exp(-(stamp - last) * 1e-9)
        error, last = kept * error + np.sqrt(1 - kept**2) * size * rng.normal(size=6), stamp
        add_wrench(stamp, frame, wrench + error, now)

    stage.live.add_wrench = read


def test_errors_of_a_real_sensor_that_last_for_a_second_are_in_the_covariance(guard, swing) -> None:
    """An ideal sensor errs less than the covariance says, because it contains them."""
    values = []
    for seed, truth in enumerate([*PAYLOADS.values(), *PAYLOADS.values()]):
        stage = Rehearsal(truth.phi, seed=seed)
        err(stage, truth, seed)
        values.append(nees(stage.run(ready(swing), guard, LIMITS).answer, truth))
    assert 3.0 < np.mean(values) < 20.0  # 10 on average where the covariance is honest
    assert np.max(values) < 29.6


def test_listening_weighs_without_moving_the_arm(guard: Guard, model: RobotModel) -> None:
    motion = FourierTrajectory.random(model, np.random.default_rng(2), duration=20.0, speed=0.3)
    stage = Rehearsal(PAYLOADS["drill"].phi, moving=motion)
    session = stage.run(None, guard, LIMITS, duration=4.0)
    assert session.error is None
    assert not stage.commands
    assert session.answer.parameters.mass == pytest.approx(1.6, rel=0.02)


# -- stopping ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("at", [0.3, 0.75, 1.2])
def test_a_brake_takes_over_without_a_jump_and_keeps_the_limits(model, guard, swing, at) -> None:
    ready = brake(model, swing.motion, at, guard, LIMITS)
    stop = ready.motion
    assert not ready.excess
    before, after = swing.motion.at(np.array([at])), stop.at(np.zeros(1))
    for one, other in zip(before, after, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)
    end = stop.at(np.array([stop.duration]))
    np.testing.assert_allclose([end.velocity, end.acceleration], 0.0, atol=1e-9)
    found = certify(model, stop, guard)
    assert found.speed <= LIMITS.speed * (1 + 1e-6)
    assert found.acceleration <= 1.25 * LIMITS.acceleration
    assert stop.duration <= 0.6


@pytest.mark.parametrize("at", [0.5, 0.7, 1.6, 2.3])
def test_cancelling_in_any_phase_brings_the_arm_to_rest_within_the_limits(guard, swing, at) -> None:
    stage = Rehearsal(PAYLOADS["drill"].phi, weighs=False)
    session = stage.run(ready(swing), guard, LIMITS, events=[(at, lambda session, now: session.cancel(now))])
    assert session.error.code == ErrorCode.CANCELLED
    assert stage.phases[-1][0] - at < 0.8
    moved = np.abs(np.diff(np.array(stage.positions[-8:]), axis=0)).max()
    assert moved < 1e-4
    assert stage.fastest(surface(guard)) <= LIMITS.speed * (1 + 2e-3)


def test_a_stop_is_looked_up_and_not_computed_when_it_is_needed(model, swing, monkeypatch) -> None:
    many = Guard.outline(tool_centre(model, "tcp"), surface(Guard.ball(tool_centre(model, "tcp"), RADIUS)))
    certified: list[int] = []

    def counting(*arguments):
        certified.append(len(arguments[2].points))
        return certify(*arguments)

    monkeypatch.setattr(brake_module, "certify", counting)
    at_need: list[int] = []

    def cancel(session, now) -> None:
        before = len(certified)
        session.cancel(now)
        at_need.append(len(certified) - before)

    stage = Rehearsal(PAYLOADS["drill"].phi, weighs=False)
    session = stage.run(ready(swing), many, LIMITS, events=[(1.6, cancel)])
    assert session.error.code == ErrorCode.CANCELLED
    assert len(stage.commands) == 2
    assert at_need == [0]
    assert set(certified) == {len(many.points)}
    assert len(certified) >= swing.motion.duration / brake_module.STOP_SPACING


def test_from_every_instant_of_a_motion_a_stop_within_the_limits_is_ready_soon(model, guard, swing) -> None:
    stops = ReadyStops.prepare(model, swing.motion, guard, LIMITS)
    assert not any(stop.excess for stop in stops.stops)
    for at in np.random.default_rng(3).uniform(0.0, swing.motion.duration, 50):
        stop = stops.after(at)
        assert at <= stop.begin <= at + brake_module.STOP_SPACING
        np.testing.assert_allclose(stop.motion.position[0], swing.motion.at(np.array([stop.begin])).position[0])
    for at in (-0.1, swing.motion.duration + 0.1):
        held = stops.after(at)
        assert held.begin == at
        assert np.ptp(held.motion.position, axis=0).max() == 0


def test_a_stop_that_exceeds_the_limits_is_sent_and_named_in_the_result(guard, swing) -> None:
    strict = MotionLimits(speed=0.1)  # the motion was planned for more
    stage = Rehearsal(PAYLOADS["drill"].phi, weighs=False)
    session = stage.run(ready(swing), guard, strict, events=[(1.6, lambda session, now: session.cancel(now))])
    assert session.error.code == ErrorCode.CANCELLED
    assert "no stop kept the limits: speed 0.1" in session.error.message
    assert "of 0.1 m/s" in session.error.message
    assert len(stage.commands) == 2


def test_a_stop_that_cannot_be_sent_is_sent_again(guard, swing) -> None:
    stage = Rehearsal(PAYLOADS["drill"].phi, weighs=False)
    send, failures = stage.send, [RuntimeError("the publisher is busy"), RuntimeError("still")]

    def failing(command) -> None:
        if stage.commands and failures:
            raise failures.pop()
        send(command)

    stage.send = failing
    session = stage.run(ready(swing), guard, LIMITS, events=[(1.6, lambda session, now: session.cancel(now))])
    assert not failures
    assert session.error.code == ErrorCode.CANCELLED
    assert len(stage.commands) == 2
    assert np.abs(np.diff(np.array(stage.positions[-8:]), axis=0)).max() < 1e-4


def test_an_error_while_stops_are_computed_leaves_the_arm_at_rest(guard, swing, monkeypatch) -> None:
    def broken(*_):
        raise ZeroDivisionError("broken")

    monkeypatch.setattr(brake_module, "certify", broken)
    stage = Rehearsal(PAYLOADS["drill"].phi, weighs=False)
    session = stage.run(ready(swing), guard, LIMITS)
    assert session.error.code == ErrorCode.INTERNAL
    assert "broken" in session.error.message
    assert not stage.commands


# -- what goes wrong -------------------------------------------------------------------------------------------------


def after(begin: float, *topics: str) -> Callable[[str, float], bool]:
    return lambda topic, seconds: topic in topics and seconds > begin


@pytest.mark.parametrize(
    ("begin", "topic", "code"),
    [
        (-1.0, "wrench", ErrorCode.TOPIC_MISSING),
        (-1.0, "joint_states", ErrorCode.TOPIC_MISSING),
        (0.4, "wrench", ErrorCode.SENSOR_STALE),
        (0.55, "joint_states", ErrorCode.SENSOR_STALE),
        (1.5, "wrench", ErrorCode.SENSOR_STALE),
        (1.5, "joint_states", ErrorCode.SENSOR_STALE),
    ],
)
def test_a_stream_that_stops_ends_it_with_a_code_and_the_arm_at_rest(model, guard, swing, begin, topic, code) -> None:
    stage = Rehearsal(PAYLOADS["drill"].phi, lost=after(begin, topic), weighs=False)
    session = stage.run(ready(swing), guard, LIMITS)
    assert session.error.code == code
    if begin == 1.5:
        assert len(stage.commands) == 2
        stop = stage.commands[1].motion
        np.testing.assert_allclose(stop.at(np.array([stop.duration])).velocity, 0.0, atol=1e-9)


def test_an_arm_that_does_not_follow_is_noticed(guard: Guard, swing: ExcitationPlan) -> None:
    session = Rehearsal(PAYLOADS["drill"].phi, deaf=True, weighs=False).run(ready(swing), guard, LIMITS)
    assert session.error.code == ErrorCode.NOT_FOLLOWING


def test_an_arm_that_moves_already_is_left_alone(guard: Guard, model: RobotModel, swing: ExcitationPlan) -> None:
    motion = FourierTrajectory.random(model, np.random.default_rng(2), duration=20.0, speed=0.3)
    stage = Rehearsal(PAYLOADS["drill"].phi, moving=motion, weighs=False)
    session = stage.run(ready(swing), guard, LIMITS)
    assert session.error.code == ErrorCode.BUSY
    assert not stage.commands


def test_another_robots_joint_states_are_no_joint_states(guard: Guard, swing: ExcitationPlan) -> None:
    stage = Rehearsal(PAYLOADS["drill"].phi, weighs=False)
    hand_over = stage._hand_over

    def of_another(message, session, now) -> None:
        if message.topic == "joint_states" and session is not None:
            session.add_joint_state(message.time, ["a", "b"], [0.0, 1.0], now)
        elif message.topic != "joint_states":
            hand_over(message, session, now)

    stage._hand_over = of_another
    session = stage.run(ready(swing), guard, LIMITS)
    assert session.error.code == ErrorCode.JOINT_MISSING
    assert "a, b" in session.error.message


def test_an_error_while_planning_is_the_answer_and_the_arm_stays(guard: Guard) -> None:
    def plan(start):
        def fail(progress, cancelled):
            raise PoiseError(ErrorCode.UNREACHABLE, "nowhere to go")

        return fail

    stage = Rehearsal(PAYLOADS["drill"].phi, weighs=False)
    session = stage.run(plan, guard, LIMITS)
    assert session.error.code == ErrorCode.UNREACHABLE
    assert not stage.commands
