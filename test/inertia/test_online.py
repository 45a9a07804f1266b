"""OnlineEstimator: live and offline are one answer, and what goes wrong in a stream is counted, never swallowed."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_motion import BIAS, LOAD, Scene, record, steps, swing

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia.model.problem import NoiseLevels
from poise.inertia.pipeline.identification import Kinematics, identify_wrenches
from poise.inertia.pipeline.online import OnlineEstimator
from poise.robot.sources import FrameSource, JointSource

SECOND = 10**9


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(31)


@pytest.fixture(scope="module")
def swinging() -> Scene:
    return record(swing, 4.0, rng=np.random.default_rng(1))


@pytest.fixture(scope="module")
def stopping() -> Scene:
    return record(steps, 9.0, rng=np.random.default_rng(2))


def estimator(scene: Scene, **options) -> OnlineEstimator:
    return OnlineEstimator(JointSource(scene.model), frame_id="ft_sensor", **options)


def add_joints(online: OnlineEstimator, scene: Scene, part: slice, shift: int = 0) -> None:
    joints = scene.joints
    online.source.extend(joints.stamps[part] + shift, joints.names, joints.position[part], joints.velocity[part])


def play(online: OnlineEstimator, scene: Scene, ends=(1.0,), shift: int = 0, wrench_late: int = 0) -> None:
    """Stream a scene in pieces that end at these shares of it; wrenches arrive `wrench_late` ns after the joints."""
    start = int(scene.joints.stamps[0])
    length = int(scene.wrench.stamps[-1]) - start + 1
    before = (0, 0)
    for share in ends:
        until = start + round(share * length)
        now = (
            int(np.searchsorted(scene.joints.stamps, until, "right")),
            int(np.searchsorted(scene.wrench.stamps, until - wrench_late, "right")),
        )
        if now[0] > before[0]:
            add_joints(online, scene, slice(before[0], now[0]), shift)
        part = slice(before[1], now[1])
        if now[1] > before[1]:
            online.add_wrench(scene.wrench.stamps[part] + shift, scene.wrench.wrench_in_sensor[part])
        online.update()
        before = now


def offline(scene: Scene, method: str):
    joints, source = scene.joints, JointSource(scene.model)

    def add(part: slice) -> None:
        source.extend(joints.stamps[part], joints.names, joints.position[part], joints.velocity[part])

    online = OnlineEstimator(source, frame_id="ft_sensor", method=method)
    return identify_wrenches(scene.wrench, Kinematics(source, [(joints.stamps, add)]), online).estimate


def agree(a, b, tolerance=1e-9):
    assert a.n_samples == b.n_samples
    np.testing.assert_allclose(a.phi, b.phi, rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(a.bias, b.bias, rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-6, atol=1e-15)
    assert a.rejected == b.rejected


@pytest.mark.parametrize(("scene", "method"), [("stopping", "static"), ("swinging", "ols")])
def test_in_whatever_pieces_the_messages_come_the_answer_is_that_of_the_recording(scene, method, request, rng):
    scene = request.getfixturevalue(scene)
    expected = offline(scene, method)
    for pieces, wrench_late in ((7, 0), (150, 0), (60, SECOND // 10)):
        online = estimator(scene, method=method)
        ends = np.append(np.sort(rng.uniform(0, 1, pieces)), [1.0, 1.0 + 2 * wrench_late / (4 * SECOND)])
        play(online, scene, ends, wrench_late=wrench_late)
        online.finish()
        agree(online.estimate(), expected)


def test_messages_one_by_one_and_out_of_order_are_the_same_answer(stopping, rng):
    """Single messages, neighbours swapped as a network may do."""
    online = estimator(stopping, method="static")
    expected = offline(stopping, "static")
    joints, wrench = stopping.joints, stopping.wrench
    stamps = np.concatenate([joints.stamps, wrench.stamps])
    is_wrench = np.arange(len(stamps)) >= len(joints)
    arrival = np.argsort(stamps + rng.integers(0, 15_000_000, len(stamps)))
    for count, index in enumerate(arrival):
        if is_wrench[index]:
            k = index - len(joints)
            online.add_wrench(wrench.stamps[k], wrench.wrench_in_sensor[k])
        else:
            add_joints(online, stopping, slice(index, index + 1))
        if count % 50 == 49:
            online.update()
    online.finish()
    estimate = online.estimate()
    assert estimate.n_samples == pytest.approx(expected.n_samples, abs=3)
    assert np.all(np.abs(estimate.phi - expected.phi)[:4] < 0.05 * np.sqrt(np.diag(expected.covariance))[:4])


def test_auto_answers_with_what_suits_the_motion(stopping, swinging):
    for scene, method in ((stopping, "static"), (swinging, "ols")):
        online = estimator(scene, method="auto")
        play(online, scene, np.linspace(0.1, 1.0, 10))
        assert online.estimate().method == method


def test_the_estimate_does_not_wait_longer_than_its_neighbourhood_asks_for(swinging):
    online = estimator(swinging, method="ols")
    play(online, swinging, np.linspace(0.05, 1.0, 20))
    behind = int(swinging.wrench.stamps[-1]) - online.estimate().stamp
    assert behind < 1.05 * SECOND  # a block and its margin
    online.update(flush=True)
    assert int(swinging.wrench.stamps[-1]) - online.estimate().stamp < 0.15 * SECOND  # the uncertain edge


def test_memory_stays_the_same_however_long_it_runs(swinging):
    online = estimator(swinging, method="ols")
    sizes = []
    for turn in range(6):
        play(online, swinging, np.linspace(0.1, 1.0, 10), shift=turn * 4 * SECOND)
        source = online.source
        sizes.append(len(source.stamps(-(2**62), 2**62)))
    assert sizes[-1] == sizes[2]
    assert sizes[-1] <= 4 * 100  # three seconds and a neighbourhood at 100 Hz
    assert online.n_samples > 5 * 3 * 500


def test_a_reset_forgets_the_payload_and_a_new_one_is_weighed(swinging):
    online = estimator(swinging, method="ols")
    play(online, swinging)
    before = online.estimate().phi
    online.reset()
    assert online.n_samples == 0
    with pytest.raises(NoAnswerError):
        online.estimate()
    double = Scene(
        swinging.model,
        swinging.joints,
        swinging.poses,
        type(swinging.wrench)(swinging.wrench.stamps + 10 * SECOND, 2 * swinging.wrench.wrench_in_sensor, "ft_sensor"),
    )
    add_joints(online, double, slice(None), 10 * SECOND)
    online.add_wrench(double.wrench.stamps, double.wrench.wrench_in_sensor)
    online.finish()
    np.testing.assert_allclose(online.estimate().phi, 2 * before, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("first", ["joints", "wrench"])
def test_when_the_clock_is_set_back_what_was_learnt_stays_and_the_jump_is_counted(swinging, first):
    online = estimator(swinging, method="ols")
    play(online, swinging, [0.25, 0.5, 0.75, 1.0])
    learnt = online.n_samples
    back = -100 * SECOND
    if first == "joints":
        add_joints(online, swinging, slice(0, 3), back)
    else:
        online.add_wrench(swinging.wrench.stamps[:3] + back, swinging.wrench.wrench_in_sensor[:3])
    online.update()
    assert online.clock_jumps == 1
    assert online.rejected["out_of_order"] > 0
    play(online, swinging, [0.25, 0.5, 0.75, 1.0], shift=back)
    online.finish()
    assert online.n_samples > 1.8 * learnt
    estimate = online.estimate()
    assert np.all(np.abs(estimate.phi - LOAD.phi) < 5 * np.sqrt(np.diag(estimate.covariance)))


def test_wrenches_without_kinematics_are_given_up_after_a_while_and_counted(swinging):
    online = estimator(swinging, method="static", patience=0.5)
    online.add_wrench(swinging.wrench.stamps, swinging.wrench.wrench_in_sensor)
    online.update()
    waiting_for = int(np.sum(swinging.wrench.stamps < swinging.wrench.stamps[-1] - SECOND // 2))
    assert online.rejected == {"no_kinematics": waiting_for}
    assert online.n_samples == 0


def test_a_wrench_older_than_what_is_remembered_is_stale(swinging):
    online = estimator(swinging, method="ols")
    shift = 20 * SECOND
    play(online, swinging, np.linspace(0.1, 1.0, 10))
    add_joints(online, swinging, slice(None), shift)
    online.update()
    online.update()
    online._newest = None  # a second sensor driver, say, whose clock is behind
    online.add_wrench(swinging.wrench.stamps[:5], swinging.wrench.wrench_in_sensor[:5])
    online.update()
    assert online.rejected["stale"] == 5


def test_joint_states_of_others_and_positions_that_are_no_numbers_are_counted_not_used(swinging):
    source = JointSource(swinging.model)
    stamps = np.array([1, 2])
    source.extend(stamps, ("finger",), np.zeros((2, 1)))
    source.extend(stamps, swinging.model.joint_names[:-1], np.zeros((2, 6)))
    source.extend(stamps, swinging.model.joint_names, np.zeros((2, 5)))
    assert source.foreign == 6
    position = np.zeros((2, 7))
    position[1, 3] = np.nan
    source.extend(stamps, swinging.model.joint_names, position)
    assert source.not_finite == 1
    assert list(source.stamps(0, 10)) == [1]


def test_more_joints_than_the_robots_in_another_order_are_the_same(swinging):
    plain, mixed = JointSource(swinging.model), JointSource(swinging.model)
    joints = swinging.joints.select(slice(0, 50))
    plain.extend(joints.stamps, joints.names, joints.position)
    names = ("finger", *joints.names[::-1])
    mixed.extend(joints.stamps, names, np.hstack([np.full((50, 1), 9.0), joints.position[:, ::-1]]))
    for source in (plain, mixed):
        assert source.newest == joints.stamps[-1]
    a, b = plain.poses(0, 2**62), mixed.poses(0, 2**62)
    np.testing.assert_array_equal(a.rotation, b.rotation)
    np.testing.assert_array_equal(a.translation, b.translation)


def test_transforms_that_are_no_rigid_motion_are_counted_not_used():
    source = FrameSource("sensor")
    turns = np.stack([np.eye(3), 2 * np.eye(3), np.full((3, 3), np.nan)])
    source.extend([1, 2, 3], "base", "sensor", turns, np.zeros((3, 3)))
    assert source.not_finite == 2
    assert list(source.stamps(0, 10)) == [1]


def test_a_frame_with_two_parents_is_refused_by_name():
    source = FrameSource("sensor")
    source.extend([1], "base", "sensor", np.eye(3)[None], np.zeros((1, 3)))
    with pytest.raises(InputError, match="base") as caught:
        source.extend([2], "table", "sensor", np.eye(3)[None], np.zeros((1, 3)))
    assert caught.value.code is ErrorCode.FRAME_UNKNOWN


def test_frames_that_do_not_reach_the_base_give_no_pose():
    source = FrameSource("sensor", base_frame="world")
    source.extend([1, 2], "base", "sensor", np.stack([np.eye(3)] * 2), np.zeros((2, 3)))
    assert source.newest is None
    assert len(source.poses(0, 10).stamps) == 0
    source.extend([1, 3], "world", "base", np.stack([np.eye(3)] * 2), np.zeros((2, 3)))
    assert source.newest == 2  # both are known up to there
    assert list(source.poses(0, 10).stamps) == [1, 2]


@pytest.mark.parametrize(
    "options", [{"method": "magic"}, {"gravity": 0.0}, {"gravity": np.inf}, {"saturation": (np.nan, 1.0)}]
)
def test_senseless_options_are_refused(swinging, options):
    with pytest.raises(InputError) as caught:
        estimator(swinging, **options)
    assert caught.value.code is ErrorCode.BAD_INPUT


@pytest.mark.parametrize("method", ["poise", "rtls"])
def test_every_method_takes_a_stream(swinging, method):
    online = estimator(swinging, method=method, noise=NoiseLevels(0.05, 0.002, 0.01, 0.05, 10.0, 0.5))
    play(online, swinging, np.linspace(0.05, 1.0, 20))
    online.finish()
    found = online.estimate()
    assert found.method == method
    assert found.parameters.mass == pytest.approx(LOAD.mass, rel=0.02)
    np.testing.assert_allclose(found.parameters.com, LOAD.com, atol=2e-3)


def test_a_window_is_weighed_by_itself_and_the_running_estimate_goes_on():
    scene = record(swing, 8.0, rng=np.random.default_rng(1))
    wrench, half = scene.wrench.wrench_in_sensor.copy(), len(scene.wrench) // 2
    wrench[half:] = 2 * wrench[half:] - BIAS
    scene = replace(scene, wrench=replace(scene.wrench, wrench_in_sensor=wrench))
    online = estimator(scene, method="ols", noise=NoiseLevels(force_bias=10.0, torque_bias=0.5))
    play(online, scene, np.linspace(0.1, 0.5, 10))
    with pytest.raises(NoAnswerError) as nothing:
        online.window_estimate()
    assert nothing.value.code == ErrorCode.EMPTY
    online.begin_window("poise")
    with pytest.raises(InputError) as busy:
        online.begin_window()
    assert busy.value.code == ErrorCode.BUSY
    joints, first = scene.joints, np.searchsorted(scene.joints.stamps, scene.wrench.stamps[half])
    add_joints(online, scene, slice(int(first), len(joints)))
    online.add_wrench(scene.wrench.stamps[half:], wrench[half:])
    online.update(flush=True)
    running, window = online.estimate(), online.window_estimate()
    assert (running.method, window.method) == ("ols", "poise")
    assert window.parameters.mass == pytest.approx(2 * LOAD.mass, rel=0.02)
    assert scene.wrench.stamps[half - 1] < window.since <= scene.wrench.stamps[half]
    assert online.window_samples < 0.6 * online.n_samples
    assert 1.1 < running.parameters.mass / LOAD.mass < 1.9
    online.end_window(keep=True)
    np.testing.assert_array_equal(online.estimate().phi, window.phi)
    online.begin_window()
    online.end_window()
    np.testing.assert_array_equal(online.estimate().phi, window.phi)


def test_no_wrench_at_all_changes_nothing(swinging):
    online = estimator(swinging)
    online.add_wrench(np.zeros(0, dtype=np.int64), np.zeros((0, 6)))
    assert online.update()["poise"].stamps.size == 0
    assert online.n_samples == 0


def test_a_clock_that_is_set_back_within_a_portion_is_noticed(swinging):
    """After the jump the default estimator goes on, too; its samples are not all out of order."""
    online = estimator(swinging)
    play(online, swinging, [0.5, 1.0])
    learnt = online.n_samples
    stamps, wrench = swinging.wrench.stamps, swinging.wrench.wrench_in_sensor
    back = -100 * SECOND
    online.add_wrench(np.concatenate([stamps[-2:] + 1, stamps[:3] + back]), np.vstack([wrench[-2:], wrench[:3]]))
    assert online.clock_jumps == 1
    play(online, swinging, [0.5, 1.0], shift=back)
    online.finish()
    assert online.n_samples > 1.8 * learnt
    assert online.estimate().parameters.mass == pytest.approx(LOAD.mass, rel=0.01)
