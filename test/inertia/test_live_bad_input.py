"""What goes wrong on a robot, through the live estimator: reported by a code, or left out and counted."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_motion import BIAS, LOAD, Scene, record, steps, swing

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia import InertialEstimate
from poise.inertia.model import regressor
from poise.inertia.model.parts import Parts, box_moments
from poise.inertia.model.problem import NoiseLevels
from poise.inertia.pipeline.live import LiveEstimator
from poise.inertia.pipeline.live_options import FLUSH_AFTER, LiveOptions
from poise.inertia.pipeline.status import Level, status_of
from poise.robot.model import find_urdf

URDF = find_urdf("fr3").read_text()
NOISE = NoiseLevels(0.05, 0.002, 0.02, 0.05)
OPTIONS = LiveOptions(method="poise", noise=NOISE, continuous=True)


@pytest.fixture(scope="module")
def scene() -> Scene:
    measured = record(swing, 5.0, rng=np.random.default_rng(8), wrench_rate=200.0)
    return with_wrench(measured, measured.wrench.wrench_in_sensor - BIAS)


def with_wrench(scene: Scene, wrench) -> Scene:
    return replace(scene, wrench=replace(scene.wrench, wrench_in_sensor=wrench))


def live(options: LiveOptions = OPTIONS) -> LiveEstimator:
    estimator = LiveEstimator(options)
    estimator.set_robot_description(URDF, 0.0)
    return estimator


def play(estimator: LiveEstimator, scene: Scene, joints: bool = True) -> LiveEstimator:
    """Everything in the order of its stamps, with an update every 50 ms, and silence at the end."""
    start, updated = int(scene.joints.stamps[0]), 0.0
    messages = [(int(stamp), 0, k) for k, stamp in enumerate(scene.wrench.stamps)]
    if joints:
        messages += [(int(stamp), 1, k) for k, stamp in enumerate(scene.joints.stamps)]
    for stamp, kind, k in sorted(messages):
        now = (stamp - start) * 1e-9
        if kind == 0:
            estimator.add_wrench(stamp, "ft_sensor", scene.wrench.wrench_in_sensor[k], now)
        else:
            estimator.add_joint_state(stamp, scene.joints.names, scene.joints.position[k], [], now)
        if now - updated > 0.05:
            estimator.update(now)
            updated = now
    estimator.update(now + 2 * FLUSH_AFTER)
    return estimator


def codes(estimate: InertialEstimate) -> set[ErrorCode]:
    return {finding.code for finding in estimate.findings}


def left_out(estimate: InertialEstimate) -> dict[str, int]:
    counts: dict[str, int] = {}
    for span in estimate.rejected:
        counts[span.reason] = counts.get(span.reason, 0) + span.n_samples
    counts.pop("no_kinematics", None)  # the uncertain edges of the recording
    return counts


def is_right(estimate: InertialEstimate) -> None:
    assert estimate.parameters.mass == pytest.approx(LOAD.mass, rel=0.01)
    np.testing.assert_allclose(estimate.parameters.com, LOAD.com, atol=2e-3)


def test_nothing_wrong_is_nothing_said(scene):
    estimate = play(live(), scene).estimate()
    is_right(estimate)
    assert estimate.consistent
    assert not codes(estimate)
    assert not left_out(estimate)


def test_fewer_samples_than_unknowns_are_an_error_with_a_number(scene):
    wrench = scene.wrench
    few = replace(scene, wrench=type(wrench)(wrench.stamps[200:202], wrench.wrench_in_sensor[200:202], "ft_sensor"))
    with pytest.raises(NoAnswerError) as caught:
        play(live(), few).estimate()
    assert caught.value.code == ErrorCode.TOO_FEW_SAMPLES


def test_what_resting_poses_do_not_show_is_named_and_the_rest_is_given():
    held = record(steps, 8.0, rng=np.random.default_rng(3), wrench_rate=200.0)
    slow = record(lambda t: tuple(part * 0 + part[:1] for part in steps(t)), 4.0, rng=np.random.default_rng(3))
    estimate = play(live(), with_wrench(held, held.wrench.wrench_in_sensor - BIAS)).estimate()
    is_right(estimate)
    alone = play(live(), with_wrench(slow, slow.wrench.wrench_in_sensor - BIAS)).estimate()
    assert {"ixx", "iyy", "izz"} <= set(alone.unidentified)
    assert alone.parameters.mass == pytest.approx(LOAD.mass, abs=4 * alone.mass_std)


@pytest.mark.parametrize("reason", ["not_finite", "saturated", "stale"])
def test_wrenches_that_say_nothing_are_left_out_with_the_reason(scene, reason):
    wrench = scene.wrench.wrench_in_sensor.copy()
    wrench[300:360] = {"not_finite": np.nan, "saturated": 250.0, "stale": wrench[300]}[reason]
    estimate = play(live(replace(OPTIONS, saturation=(200.0, 100.0))), with_wrench(scene, wrench)).estimate()
    is_right(estimate)
    assert left_out(estimate) == {reason: pytest.approx(60, abs=4)}


def test_another_robots_joint_states_are_neither_this_ones_nor_zeros(scene):
    estimator = live()
    for k, stamp in enumerate(scene.joints.stamps):
        estimator.add_joint_state(int(stamp), ("left", "right"), [0.1, 0.2], [], k * 0.01)
        estimator.add_joint_state(int(stamp), scene.joints.names[:5], scene.joints.position[k][:5], [], k * 0.01)
    play(estimator, scene, joints=False)
    with pytest.raises(NoAnswerError):
        estimator.estimate()
    status = status_of(estimator, 5.0)
    assert status.level == Level.ERROR
    assert "fr3_joint7" in status.message
    play(estimator, scene)
    assert estimator.joints is not None
    assert estimator.joints.foreign == 2 * len(scene.joints.stamps)
    is_right(estimator.estimate())


def test_a_sensor_zeroed_while_it_holds_the_object_is_found_out(scene):
    first = regressor([0.0, 0.0, -9.80665], np.zeros(3), np.zeros(3)) @ LOAD.phi
    estimate = play(live(), with_wrench(scene, scene.wrench.wrench_in_sensor - first)).estimate()
    assert ErrorCode.ZEROED_UNDER_LOAD in codes(estimate)
    is_right(estimate)


def test_a_shape_that_does_not_fit_the_wrench_is_told(scene):
    boxes = np.array([[-0.1, 0.1, 0.2], [-0.1, 0.1, 0.3]])
    wrong = Parts.from_moments(box_moments(boxes, np.full((2, 3), 0.05)), [0, 1], boxes)
    estimator = live()
    estimator.hold(wrong)
    estimate = play(estimator, scene).estimate()
    assert ErrorCode.SHAPE_MISMATCH in codes(estimate)
    is_right(estimate)
