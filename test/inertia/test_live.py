"""LiveEstimator: which source it takes its motion from, what it keeps until it knows, and what it says of itself."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulated_motion import LOAD, Scene, record, steps

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia.pipeline.identification import Kinematics, identify_wrenches
from poise.inertia.pipeline.live import GRACE, LiveEstimator
from poise.inertia.pipeline.live_options import FLUSH_AFTER, LiveOptions
from poise.inertia.pipeline.online import OnlineEstimator
from poise.inertia.pipeline.status import Level, status_of
from poise.robot.model import find_urdf
from poise.robot.sources import JointSource

URDF = find_urdf("fr3").read_text()
ALL = ("wrench", "joints", "tf")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return record(steps, 6.0, rng=np.random.default_rng(4), wrench_rate=200.0)


def play(live: LiveEstimator, scene: Scene, topics=ALL, *, until: float = np.inf, begin: float = 0.0) -> float:
    """Stream messages at the pace of their stamps, with an update every 50 ms; return the time at the end."""
    start = int(scene.joints.stamps[0])
    messages = []
    for topic, stream in (("wrench", scene.wrench), ("joints", scene.joints), ("tf", scene.poses)):
        if topic in topics:
            messages += [(int(stamp), topic, k) for k, stamp in enumerate(stream.stamps)]
    now, updated = begin, begin
    for stamp, topic, k in sorted(messages):
        if not begin <= (stamp - start) * 1e-9 < until:
            continue
        now = (stamp - start) * 1e-9
        if topic == "wrench":
            live.add_wrench(stamp, "ft_sensor", scene.wrench.wrench_in_sensor[k], now)
        elif topic == "joints":
            live.add_joint_state(stamp, scene.joints.names, scene.joints.position[k], [], now)
        else:
            rotation, translation = scene.poses.rotation_parent_child[k], scene.poses.translation_parent_child[k]
            live.add_transform(stamp, "base_link", "ft_sensor", rotation, translation, False, now)
        if now - updated > 0.05:
            live.update(now)
            updated = now
    return now


def words(live: LiveEstimator) -> str:
    return live.estimator.source.words if live.estimator else ""


def test_joint_states_with_a_description_are_taken_at_once(scene):
    live = LiveEstimator(LiveOptions())
    live.set_robot_description(URDF, 0.0)
    play(live, scene, until=0.1)
    assert words(live).startswith("joint_states")


def test_tf_is_taken_when_nothing_better_came_in_a_second_and_no_wrench_is_lost_meanwhile(scene):
    live = LiveEstimator(LiveOptions(method="static"))
    play(live, scene, ("wrench", "tf"), until=0.9 * GRACE)
    assert live.estimator is None
    now = play(live, scene, ("wrench", "tf"), begin=0.9 * GRACE)
    assert words(live).startswith("tf")
    live.update(now + FLUSH_AFTER + 0.1)
    at_once = LiveEstimator(LiveOptions(method="static", motion_source="tf"))
    at_once.update(play(at_once, scene, ("wrench", "tf")) + FLUSH_AFTER + 0.1)
    assert live.n_samples == at_once.n_samples > 0
    np.testing.assert_allclose(live.estimate().phi, at_once.estimate().phi, rtol=1e-12)


def test_a_description_that_comes_late_takes_over_and_what_was_learnt_stays(scene):
    live = LiveEstimator(LiveOptions(method="static"))
    now = play(live, scene, until=3.0)
    learnt = live.n_samples
    assert words(live).startswith("tf")
    live.set_robot_description(URDF, now)
    play(live, scene, begin=3.0)
    assert words(live).startswith("joint_states")
    assert live.n_samples > learnt > 0
    estimate = live.estimate()
    assert np.all(np.abs(estimate.phi - LOAD.phi)[:4] < 5 * np.sqrt(np.diag(estimate.covariance))[:4])


def test_joint_states_from_before_the_description_are_used_and_the_answer_is_the_recordings(scene):
    live = LiveEstimator(LiveOptions(method="static"))
    play(live, scene, ("wrench", "joints"), until=0.5)
    assert live.estimator is None
    live.set_robot_description(URDF, 0.5)
    live.update(play(live, scene, ("wrench", "joints"), begin=0.5) + FLUSH_AFTER + 0.1)
    source = JointSource(scene.model)

    def add(part: slice) -> None:
        source.extend(scene.joints.stamps[part], scene.joints.names, scene.joints.position[part])

    kinematics = Kinematics(source, [(scene.joints.stamps, add)])
    online = OnlineEstimator(source, frame_id="ft_sensor", method="static")
    expected = identify_wrenches(scene.wrench, kinematics, online).estimate
    estimate = live.estimate()
    assert estimate.n_samples == expected.n_samples
    np.testing.assert_allclose(estimate.phi, expected.phi, rtol=1e-9)


def test_another_robot_description_starts_afresh_and_the_same_one_again_changes_nothing(scene):
    live = LiveEstimator(LiveOptions(method="static"))
    live.set_robot_description(URDF, 0.0)
    now = play(live, scene, ("wrench", "joints"), until=3.0)
    learnt = live.n_samples
    live.set_robot_description(URDF, now)
    assert live.n_samples == learnt > 0
    live.set_robot_description(URDF.replace('name="fr3"', 'name="another"'), now)
    assert live.n_samples == 0


def test_a_sensor_frame_given_by_name_holds_whatever_the_messages_call_it(scene):
    live = LiveEstimator(LiveOptions(sensor_frame="ft_sensor", method="static"))
    live.set_robot_description(URDF, 0.0)
    for k in range(20):
        live.add_wrench(int(scene.wrench.stamps[k]), "some_driver", scene.wrench.wrench_in_sensor[k], 0.0)
        live.add_wrench(int(scene.wrench.stamps[k]), "second_driver", scene.wrench.wrench_in_sensor[k], 0.0)
    assert live.sensor_frame == "ft_sensor"
    assert live.foreign_wrenches == {"second_driver": 20}


@pytest.mark.parametrize("quiet", [FLUSH_AFTER, 20.0])
def test_when_all_falls_quiet_what_is_there_is_used(scene, quiet):
    live = LiveEstimator(LiveOptions(method="static", flush_after=quiet))
    live.set_robot_description(URDF, 0.0)
    now = play(live, scene, ("wrench", "joints"), until=1.0)
    before = live.n_samples
    live.update(now + 0.9 * quiet)
    assert live.n_samples <= before + 20  # what the rest window had still held back
    held = live.n_samples
    live.update(now + 1.1 * quiet)
    assert live.n_samples > held


def test_without_a_wrench_memory_does_not_grow(scene):
    live = LiveEstimator(LiveOptions())
    for k in range(3000):
        live.add_transform(k * 10**8, "base", "ft_sensor", np.eye(3), np.zeros(3), False, 0.1 * k)
        if k % 10 == 0:
            live.update(0.1 * k)
    live.frames.sensor_frame = "ft_sensor"
    assert len(live.frames.stamps(0, 2**62)) <= 211


def test_before_it_knows_the_motion_there_is_no_answer(scene):
    with pytest.raises(NoAnswerError, match="how the sensor moves") as caught:
        LiveEstimator(LiveOptions()).estimate()
    assert caught.value.code is ErrorCode.TOO_FEW_SAMPLES


@pytest.mark.parametrize("options", [{"method": "magic"}, {"motion_source": "stars"}, {"gravity": -1.0}])
def test_senseless_options_are_refused(options):
    with pytest.raises(InputError) as caught:
        LiveEstimator(LiveOptions(**options))
    assert caught.value.code is ErrorCode.BAD_INPUT


# -- what it says of itself --------------------------------------------------------------------------------------


def test_the_status_names_what_is_missing_step_by_step(scene):
    live = LiveEstimator(LiveOptions())
    assert "no wrench yet" in status_of(live, 0.0).message
    live.add_wrench(1, "", np.zeros(6), 0.0)
    assert "name no frame" in status_of(live, 0.0).message
    live.add_wrench(1, "ft_sensor", np.zeros(6), 0.0)
    assert "nothing says how ft_sensor moves" in status_of(live, 0.0).message
    live.add_joint_state(1, ("finger",), [0.0], [], 0.0)
    assert "no robot_description" in status_of(live, 0.0).message
    live.set_robot_description(URDF, 0.0)
    assert "fr3_joint1" in status_of(live, 0.0).message
    live.add_joint_state(1, scene.joints.names, np.full(7, np.nan), [], 0.0)
    assert status_of(live, 0.0).values["kinematics_not_finite"] == "1"
    assert status_of(live, 0.0).level is Level.ERROR


def test_the_status_is_good_while_samples_come_and_tells_of_silence(scene):
    live = LiveEstimator(LiveOptions(method="static"))
    live.set_robot_description(URDF, 0.0)
    now = play(live, scene, ("wrench", "joints"))
    good = status_of(live, now)
    assert good.level is Level.OK
    assert good.values["samples_used"] == str(live.n_samples)
    assert int(good.values["rejected_moving"]) > 0
    live.add_joint_state(0, scene.joints.names, scene.joints.position[0], [], now + 3.0)
    assert "no wrench for 3.0 s" in status_of(live, now + 3.0).message
    live.add_wrench(0, "ft_sensor", np.zeros(6), now + 6.0)
    assert "no usable kinematics for 3.0 s" in status_of(live, now + 6.0).message


def test_clocks_that_are_apart_are_told_with_their_distance(scene):
    live = LiveEstimator(LiveOptions(method="static"))
    live.set_robot_description(URDF, 0.0)
    for k, stamp in enumerate(scene.joints.stamps[:500]):
        live.add_joint_state(int(stamp), scene.joints.names, scene.joints.position[k], [], 0.01 * k)
        live.add_wrench(int(stamp) + 37 * 10**9, "ft_sensor", scene.wrench.wrench_in_sensor[k], 0.01 * k)
        live.update(0.01 * k)
    status = status_of(live, 5.0)
    assert status.level is Level.WARN
    assert "37.0 s ahead of the kinematics" in status.message


def test_mostly_unusable_samples_are_a_warning_that_names_the_reason(scene):
    live = LiveEstimator(LiveOptions(method="static"))
    live.set_robot_description(URDF, 0.0)
    for k in range(100):
        stamp = int(scene.joints.stamps[k])
        live.add_joint_state(stamp, scene.joints.names, scene.joints.position[k], [], 0.01 * k)
        live.add_wrench(stamp, "ft_sensor", np.full(6, np.nan) if k % 3 else np.zeros(6), 0.01 * k)
        live.update(0.01 * k)
    status = status_of(live, 1.0)
    assert status.level is Level.WARN
    assert "not_finite" in status.message


# -- a stream full of rubbish ------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_rubbish_in_between_neither_stops_it_nor_moves_the_answer(scene, seed):
    """Messages with missing joints, no numbers, wild stamps and foreign frames, between good ones."""
    rng = np.random.default_rng(seed)
    live = LiveEstimator(LiveOptions(method="static", saturation=(1e3, 1e3)))
    live.set_robot_description(URDF, 0.0)
    joints, wrench = scene.joints, scene.wrench
    start = int(joints.stamps[0])
    stream = [(int(stamp), "j", k) for k, stamp in enumerate(joints.stamps)]
    stream += [(int(stamp), "w", k) for k, stamp in enumerate(wrench.stamps)]
    for stamp, kind, k in sorted(stream):
        now = (stamp - start) * 1e-9
        if kind == "j":
            live.add_joint_state(stamp, joints.names, joints.position[k], [], now)
        else:
            live.add_wrench(stamp, "ft_sensor", wrench.wrench_in_sensor[k], now)
        if rng.random() < 0.2 and live.sensor_frame:  # the first wrench says which sensor is meant
            _add_rubbish(live, rng, stamp, now)
        if rng.random() < 0.05:
            live.update(now)
        if rng.random() < 0.001:
            wild = int(rng.integers(-(2**31), 2**31)) * 10**9
            live.add_joint_state(wild, joints.names, rng.normal(size=7), [], now)
            live.add_wrench(wild, "ft_sensor", rng.normal(size=6), now)
    live.update(now + FLUSH_AFTER + 0.1)
    estimate = live.estimate()
    assert estimate.parameters.mass == pytest.approx(LOAD.mass, abs=0.005)
    np.testing.assert_allclose(estimate.parameters.com, LOAD.com, atol=0.001)
    assert live.n_samples > 100
    assert status_of(live, 6.0).values["wrenches_of_other_frames"] != "0"


def _add_rubbish(live: LiveEstimator, rng: np.random.Generator, stamp: int, now: float) -> None:
    names = live.joints.model.joint_names if live.joints else ("fr3_joint1",)
    kind = int(rng.integers(6))
    if kind == 0:
        live.add_wrench(stamp, "ft_sensor", np.where(rng.random(6) < 0.5, np.nan, 1.0) * np.inf, now)
    elif kind == 1:
        live.add_wrench(stamp, "elsewhere", rng.normal(size=6), now)
    elif kind == 2:
        live.add_joint_state(stamp, names[:-1], rng.normal(size=len(names) - 1), [], now)
    elif kind == 3:
        live.add_joint_state(stamp, names, np.full(len(names), rng.choice([np.nan, np.inf])), [], now)
    elif kind == 4:
        live.add_joint_state(stamp, names, [], [], now)
    else:
        live.add_wrench(stamp, "ft_sensor", rng.normal(size=6) * 1e6, now)


def test_all_of_tf_may_come_before_the_first_wrench():
    live = LiveEstimator(LiveOptions(method="static", motion_source="tf"))
    attitudes = Rotation.from_rotvec(np.eye(3)[np.arange(6) % 2] * 0.7 * np.arange(6)[:, None]).as_matrix()
    stamps = [(number, number * 10**9 + k * 10**7) for number in range(6) for k in range(100)]
    for number, stamp in stamps:
        live.add_transform(stamp, "base", "ft_sensor", attitudes[number], [0.5, 0.0, 0.0], False, 0.0)
    for number, stamp in stamps:
        force = attitudes[number].T @ [0.0, 0.0, -9.80665]
        live.add_wrench(stamp, "ft_sensor", [*force, *np.cross([0.0, 0.0, 0.05], force)], 0.1)
    live.update(0.2)
    live.update(2.0)
    assert live.estimate().parameters.mass == pytest.approx(1.0, abs=1e-6)


def test_a_shape_is_placed_in_the_hand_only_by_a_frame_that_moves_with_it():
    live = LiveEstimator(LiveOptions(sensor_frame="ft_sensor", motion_source="joint_states"))
    level = np.eye(3)
    for parent, child, fixed in [("base", "wrist", False), ("wrist", "ft_sensor", True), ("wrist", "tcp", True)]:
        live.add_transform(0, parent, child, level, (0.0, 0.0, 0.1), fixed, 0.0)
    live.add_transform(0, "base", "cup", level, (0.5, 0.0, 0.0), True, 0.0)  # where it was scanned
    with pytest.raises(InputError, match="does not move with ft_sensor") as caught:
        live.pose_in_sensor("cup")
    assert caught.value.code is ErrorCode.FRAME_UNKNOWN
    live.add_transform(1, "tcp", "cup", level, (0.0, 0.0, 0.05), False, 0.0)  # held, as world_model says
    np.testing.assert_allclose(live.pose_in_sensor("cup").translation, [0.0, 0.0, 0.05])
    np.testing.assert_allclose(live.pose_in_sensor("ft_sensor").translation, 0.0)
