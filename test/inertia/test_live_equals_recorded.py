"""Contract of the registry: message by message on a robot, every estimator answers as it does for the recording."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from simulated_motion import BIAS, Scene, record, steps, swing

from poise.errors import ErrorCode, PoiseError
from poise.inertia import InertialEstimate, InertialParameters, identify
from poise.inertia.estimators import method_choices
from poise.inertia.model import Parts
from poise.inertia.model.parts import box_moments
from poise.inertia.pipeline import FLUSH_AFTER, LiveEstimator, LiveOptions
from poise.recording import WrenchStream, open_recording, write_recording
from poise.robot import find_urdf
from poise.types import Array

URDF = find_urdf("fr3").read_text()
UPDATE_PERIOD = 0.05  # s, of the node
LIMITS = (60.0, 8.0)

CENTRES, SIDES = np.array([[0.0, 0.0, 0.05], [0.03, 0.0, 0.16]]), np.array([[0.03, 0.03, 0.2], [0.1, 0.03, 0.03]])
PARTS = Parts.from_moments(
    box_moments(CENTRES, SIDES), [0, 1], np.concatenate([CENTRES - SIDES / 2, CENTRES + SIDES / 2])
)
HAMMER = InertialParameters.from_phi(PARTS.unit_phi @ (PARTS.volumes * [700.0, 7800.0]))


@dataclass(frozen=True, eq=False)
class Messages:
    """Wrenches in the order of arrival: (N,) ns, (N, 6) and the frame of each; and the robot."""

    scene: Scene
    stamps: Array
    wrench: Array
    frames: list[str]
    with_joints: bool = True
    parts: Parts | None = PARTS


def rest_then_swing(seconds: Array) -> tuple[Array, Array, Array]:
    """Three poses that are held still, then every joint swings."""
    begin = 3.4
    held, moving = steps(np.minimum(seconds, begin), 0.6, 0.8), swing(np.maximum(seconds - begin, 0.0))
    ramp = np.clip((seconds - begin) / 1.0, 0.0, 1.0)[:, None]
    place = held[0] + (moving[0] - held[0]) * ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
    rate = np.gradient(place, seconds, axis=0)
    return place, rate, np.gradient(rate, seconds, axis=0)


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A zeroed sensor, whose wrenches end before the joint states do."""
    measured = record(rest_then_swing, 6.0, rng=np.random.default_rng(12), load=HAMMER, wrench_rate=100.0)
    wrench = measured.wrench.select(slice(0, -5))
    return replace(measured, wrench=replace(wrench, wrench_in_sensor=wrench.wrench_in_sensor - BIAS))


def healthy(scene: Scene) -> Messages:
    wrench = scene.wrench
    return Messages(scene, wrench.stamps, wrench.wrench_in_sensor, [wrench.frame_id] * len(wrench))


def scaled(factor: float) -> Callable[[Scene], Messages]:
    return lambda scene: replace(healthy(scene), wrench=factor * scene.wrench.wrench_in_sensor)


def clipped(scene: Scene) -> Messages:
    return replace(healthy(scene), wrench=np.clip(scene.wrench.wrench_in_sensor, *np.outer([-0.4, 0.4], [60] * 6)))


def saturated(scene: Scene) -> Messages:
    wrench = scene.wrench.wrench_in_sensor.copy()
    wrench[200:220, 2] = LIMITS[0]
    return replace(healthy(scene), wrench=wrench)


def not_finite(scene: Scene) -> Messages:
    wrench = scene.wrench.wrench_in_sensor.copy()
    wrench[150:160, 1], wrench[480:483] = np.nan, np.inf
    return replace(healthy(scene), wrench=wrench)


def repeated(scene: Scene) -> Messages:
    wrench = scene.wrench.wrench_in_sensor.copy()
    wrench[480:510] = wrench[480]
    return replace(healthy(scene), wrench=wrench)


def duplicate(scene: Scene) -> Messages:
    stamps = scene.wrench.stamps.copy()
    stamps[100:104] = stamps[100]
    stamps[250] = stamps[249]
    return replace(healthy(scene), stamps=stamps)


def late(scene: Scene) -> Messages:
    """A network swaps neighbours, and delays one message in fifty by 20 ms."""
    stamps = scene.wrench.stamps
    delays = np.random.default_rng(3).uniform(0, 15e6, len(stamps)) + 20e6 * (np.arange(len(stamps)) % 50 == 0)
    order = np.argsort(stamps + delays, kind="stable")
    return replace(healthy(scene), stamps=stamps[order], wrench=scene.wrench.wrench_in_sensor[order])


def foreign_frame(scene: Scene) -> Messages:
    messages = healthy(scene)
    wrench, frames = messages.wrench.copy(), list(messages.frames)
    for k in range(5, len(frames), 7):
        frames[k], wrench[k] = "gripper", 99.0
    return replace(messages, wrench=wrench, frames=frames)


def no_kinematics(scene: Scene) -> Messages:
    return replace(healthy(scene), with_joints=False)


def too_short(scene: Scene) -> Messages:
    messages, few = healthy(scene), slice(300, 302)
    return replace(messages, stamps=messages.stamps[few], wrench=messages.wrench[few], frames=messages.frames[few])


def wrong_shape(scene: Scene) -> Messages:
    return replace(healthy(scene), parts=PARTS.in_frame(np.diag([1.0, -1.0, -1.0]), np.zeros(3)))


def never_zeroed(scene: Scene) -> Messages:
    return replace(healthy(scene), wrench=scene.wrench.wrench_in_sensor + 3 * BIAS)


def late_clock(scene: Scene) -> Messages:
    return replace(healthy(scene), stamps=scene.wrench.stamps + 20_000_000)


INPUTS = {
    "healthy": healthy,
    "opposite sign": scaled(-1.0),
    "kgf": scaled(1 / 9.80665),
    "zero": scaled(0.0),
    "clipped": clipped,
    "saturated": saturated,
    "not finite": not_finite,
    "repeated": repeated,
    "duplicate stamps": duplicate,
    "late messages": late,
    "foreign frame": foreign_frame,
    "no kinematics": no_kinematics,
    "too short": too_short,
    "wrong shape": wrong_shape,
    "never zeroed": never_zeroed,
    "late clock": late_clock,
}


def live(messages: Messages, method: str) -> InertialEstimate:
    """Message by message in the order of arrival, with the node's updates, then silence."""
    estimator = LiveEstimator(LiveOptions(method=method, parts=messages.parts, saturation=LIMITS, continuous=True))
    joints, start, updated = messages.scene.joints, int(messages.scene.joints.stamps[0]), 0.0
    if messages.with_joints:
        estimator.set_robot_description(URDF, 0.0)
    arrivals = np.maximum.accumulate(messages.stamps)
    queue = [(int(arrival), 1, k) for k, arrival in enumerate(arrivals)]
    queue += [(int(stamp), 0, k) for k, stamp in enumerate(joints.stamps) if messages.with_joints]
    now = 0.0
    for arrival, is_wrench, k in sorted(queue):
        now = (arrival - start) * 1e-9
        if is_wrench:
            estimator.add_wrench(int(messages.stamps[k]), messages.frames[k], messages.wrench[k], now)
        else:
            estimator.add_joint_state(int(joints.stamps[k]), joints.names, joints.position[k], [], now)
        if now - updated > UPDATE_PERIOD:
            estimator.update(now)
            updated = now
    estimator.update(now + 2 * FLUSH_AFTER)
    return estimator.estimate()


def recorded(messages: Messages, method: str, folder) -> InertialEstimate:
    order = np.argsort(messages.stamps, kind="stable")
    own = [k for k in order if messages.frames[k] == messages.frames[0]]
    streams = {}
    streams["wrench"] = [WrenchStream(messages.stamps[own], messages.wrench[own], messages.frames[0])]
    others = [k for k in order if messages.frames[k] != messages.frames[0]]
    if others:
        streams["wrench"].append(WrenchStream(messages.stamps[others], messages.wrench[others], "gripper"))
    if messages.with_joints:
        streams["joint_states"] = messages.scene.joints
    write_recording(folder / "scene.mcap", streams, robot_description=URDF)
    return identify(
        open_recording(folder / "scene.mcap"), method=method, parts=messages.parts, saturation=LIMITS
    ).estimate


def outcome(answer: Callable[[], InertialEstimate]) -> InertialEstimate | ErrorCode:
    try:
        return answer()
    except PoiseError as error:
        return error.code


# What comes before the estimator is one pipeline: the others need a few of the inputs only.
FOR_ALL = ("healthy", "late messages", "wrong shape", "too short")
PAIRS = [(method, name) for method in method_choices() for name in INPUTS if method == "poise" or name in FOR_ALL]


@pytest.mark.parametrize(("method", "name"), PAIRS)
def test_live_and_recorded_give_the_same_answer(scene, tmp_path, method, name):
    messages = INPUTS[name](scene)
    on_robot = outcome(lambda: live(messages, method))
    from_file = outcome(lambda: recorded(messages, method, tmp_path))
    if name == "no kinematics":  # a robot may still publish them, a recording cannot
        assert (on_robot, from_file) == (ErrorCode.TOO_FEW_SAMPLES, ErrorCode.TOPIC_MISSING)
        return
    if isinstance(from_file, ErrorCode):
        assert on_robot == from_file
        return
    assert isinstance(on_robot, InertialEstimate), on_robot
    np.testing.assert_allclose(on_robot.phi, from_file.phi, atol=1e-9, rtol=0)
    np.testing.assert_allclose(on_robot.bias, from_file.bias, atol=1e-7, rtol=0)
    np.testing.assert_allclose(on_robot.delay, from_file.delay, atol=1e-9)
    np.testing.assert_allclose(on_robot.covariance, from_file.covariance, rtol=1e-4, atol=1e-12)
    assert [(each.code, each.message) for each in on_robot.findings] == [
        (each.code, each.message) for each in from_file.findings
    ]
    assert on_robot.rejected == from_file.rejected
    assert (on_robot.n_samples, on_robot.method) == (from_file.n_samples, from_file.method)
    assert on_robot.unidentified == from_file.unidentified


@pytest.mark.parametrize("method", ["poise", "auto", "geo"])
def test_a_wrench_of_the_opposite_sign_is_refused_live(scene, method):
    messages = replace(scaled(-1.0)(scene), parts=PARTS)
    assert outcome(lambda: live(messages, method)) is ErrorCode.NOT_CONSISTENT


def test_point_masses_fill_the_object_live_as_in_a_recording(scene):
    estimate = live(healthy(scene), "pmd")
    scale = np.trace(HAMMER.inertia) / 3
    np.testing.assert_allclose(estimate.parameters.inertia, HAMMER.inertia, atol=0.15 * scale)
