"""Scenes on a base that moves: a box that slides by Coulomb's law, in closed form, and scenes that MuJoCo moves."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from benchmarks.carried.make import Body, Case, Seen, _first, as_declared, draw, scene_of, simulate, write
from poise.assembly import Assembly, Box, FrictionPair, RigidObject, write_scene
from poise.cli import run
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.mismatch.carried import CarriedAnswer, examine_carried, read_carried
from poise.mismatch.carried.events import CarriedMotion
from poise.mismatch.carried.evidence import Part, of_course, probability
from poise.mismatch.carried.onset import onset
from poise.mismatch.carried.prediction import SceneLimits
from poise.recording import PoseStream, RecordingWriter, encode_stream, open_recording

FRICTION, GRAVITY, STEP = 0.3, 9.81, 1e-3
START = 10**18


def scene(friction: float = FRICTION, height: float = 0.06) -> Assembly:
    """A box on a tray whose top is the plane z = 0."""
    tray = RigidObject("tray", Box((1.0, 1.0, 0.02)), Pose(np.eye(3), np.array([0.0, 0.0, -0.01])), fixed=True)
    box = RigidObject("box", Box((0.1, 0.08, height)), Pose(np.eye(3), np.array([0.1, 0.0, height / 2])), mass=0.7)
    return Assembly((tray, box), np.array([0, 0, -GRAVITY]), friction)


def drive(strongest: float) -> tuple[np.ndarray, np.ndarray]:
    """(T,) s, (T,) m/s2 along x: three starts and stops, the last one the strongest."""
    times = np.arange(0.0, 8.0, STEP)
    acceleration = np.zeros_like(times)
    for begin, share in ((1.0, 0.4), (3.0, -0.7), (5.0, 1.0)):
        for at, sign in ((begin, 1), (begin + 0.9, -1)):
            ramp = np.clip((times - at) / 0.3, 0, 1) * np.clip((at + 0.8 - times) / 0.3, 0, 1)
            acceleration += sign * share * strongest * ramp
    return times, acceleration


def slid(acceleration: np.ndarray, friction: float) -> np.ndarray:
    """(T,) m that a box slides on the base, by Coulomb's law."""
    place = speed = 0.0
    found = np.zeros_like(acceleration)
    for row, pulled in enumerate(acceleration):
        if speed == 0.0 and abs(pulled) <= friction * GRAVITY:
            relative = 0.0
        else:
            way = np.sign(speed) if speed else -np.sign(pulled)
            relative = -pulled - way * friction * GRAVITY
        after = speed + relative * STEP
        speed = 0.0 if speed * after < 0 else after
        place += speed * STEP
        found[row] = place
    return found


def record(
    path: Path,
    acceleration: np.ndarray,
    moved: np.ndarray,
    *,
    lean: float = 0.0,
    odom: bool = False,
    still: tuple[str, ...] = (),
) -> Path:
    """A bag: the tray at 50 Hz, and the box at 30 Hz with 0.5 mm of noise; the base leans by `lean` about y, rad.

    Objects that are `still` stand 0.4 m behind the box.
    """
    rng = np.random.default_rng(7)
    times = np.arange(len(acceleration)) * STEP
    turn = Rotation.from_euler("y", lean).as_matrix()
    base = np.cumsum(np.cumsum(acceleration)) * STEP**2
    rows, shots = slice(0, None, 20), slice(0, None, 33)
    stamps = START + np.round(times * 1e9).astype(np.int64)
    at = np.column_stack([base, 0 * base, 0 * base])[rows] @ turn.T
    carried = PoseStream(stamps[rows], np.tile(turn, (len(at), 1, 1)), at, "odom", "tray")
    seen = np.column_stack([0.1 + moved, 0 * moved, 0.04 + 0 * moved])[shots]
    seen = seen + rng.normal(scale=5e-4, size=seen.shape)
    box = PoseStream(stamps[shots], np.tile(np.eye(3), (len(seen), 1, 1)), seen, "tray", "box")
    seen = np.tile([-0.3, 0.0, 0.04], (len(seen), 1)) + rng.normal(scale=5e-4, size=seen.shape)
    objects = [box, *(PoseStream(box.stamps, box.rotation_parent_child, seen, "tray", name) for name in still)]
    topics = {"odom" if odom else "tf": [carried], "tf": objects if odom else [carried, *objects]}
    return write_bag(path, topics)


def write_bag(path: Path, topics: dict[str, list[PoseStream]]) -> Path:
    """A bag of poses as tf and odom."""
    with RecordingWriter(path) as writer:
        for name, streams in topics.items():
            writer.add_topic(name, "nav_msgs/msg/Odometry" if name == "odom" else "tf2_msgs/msg/TFMessage")
            messages = [each for stream in streams for each in encode_stream(name, stream)]
            for stamp, content in sorted(messages, key=lambda one: one[0]):
                writer.write(name, stamp, content)
    return path


def examined(path: Path, declared: Assembly) -> CarriedAnswer:
    return examine_carried(read_carried(open_recording(path), declared), declared)


@pytest.mark.parametrize("odom", [False, True])
def test_a_scene_as_declared_needs_no_cause(tmp_path: Path, odom: bool) -> None:
    times, acceleration = drive(4.0)
    moved = slid(acceleration, FRICTION)
    found = examined(record(tmp_path / "run.mcap", acceleration, moved, odom=odom), scene())
    assert found.verdict == "none"
    assert not found.effects
    begins, visible = (times[np.argmax(np.abs(moved) > least)] for least in (0.0, 3e-4))
    assert found.seen[0].object == "box"
    assert found.seen[0].mode == "slip"
    assert found.seen[0].released == pytest.approx(begins, abs=0.03)
    assert found.seen[0].time == pytest.approx(visible, abs=0.03)
    assert found.predicted is not None
    assert found.predicted.time == pytest.approx(begins, abs=0.03)


def test_the_load_is_the_acceleration_over_its_limit(tmp_path: Path) -> None:
    _, acceleration = drive(2.0)
    found = examined(record(tmp_path / "run.mcap", acceleration, 0 * acceleration), scene())
    assert found.verdict == "none"
    assert found.predicted is None
    assert found.most == pytest.approx(2.0 / (FRICTION * GRAVITY), rel=0.03)


def test_a_lower_friction_is_named_with_its_value(tmp_path: Path) -> None:
    _, acceleration = drive(2.0)
    found = examined(record(tmp_path / "run.mcap", acceleration, slid(acceleration, 0.17)), scene())
    assert found.effects[0].name == "friction"
    assert set(found.effects[0].objects) == {"box", "tray"}
    assert found.effects[0].value == pytest.approx(0.17, rel=0.1)
    assert abs(found.effects[0].value - 0.17) < 3 * found.effects[0].deviation
    # one box that moved once, where the base accelerates most: nothing excludes a tilt, and the answer says what would
    assert "tray_tilt" in found.effects[0].indistinguishable
    assert "opposite direction" in found.effects[0].sentence


def test_what_does_not_slip_has_a_lowest_friction(tmp_path: Path) -> None:
    _, acceleration = drive(4.5)
    found = examined(record(tmp_path / "run.mcap", acceleration, 0 * acceleration), scene())
    assert found.verdict == "named"
    assert found.effects[0].name == "friction"
    assert found.effects[0].bound == "at least"
    assert 0.3 < found.effects[0].value <= 0.55


def test_an_object_that_stands_beside_one_that_slips_has_a_bound(tmp_path: Path) -> None:
    """The box slips as declared. What should have slipped before it did not: how much more it holds is not seen."""
    _, acceleration = drive(4.0)
    declared = scene()
    other = replace(declared.objects[1], id="other", pose=Pose(np.eye(3), np.array([-0.3, 0.0, 0.03])))
    declared = declared.with_object(other, pairs=[FrictionPair(("tray", "other"), 0.15)])
    bag = record(tmp_path / "run.mcap", acceleration, slid(acceleration, FRICTION), still=("other",))
    found = examined(bag, declared)
    assert found.seen[0].object == "box"
    assert set(found.effects[0].objects) == {"tray", "other"}
    assert (found.effects[0].name, found.effects[0].bound) == ("friction", "at least")
    assert "at least" in found.effects[0].sentence


def test_outliers_are_no_motion(tmp_path: Path) -> None:
    """Single poses that are 2 cm off, as from a marker that was mistaken."""
    _, acceleration = drive(2.0)
    moved = 0 * acceleration
    moved[33 * np.array([50, 90, 91, 140, 200])] = 0.02
    found = examined(record(tmp_path / "run.mcap", acceleration, moved), scene())
    assert found.verdict == "none"
    assert not found.seen


def test_a_tilt_follows_from_what_all_objects_did(tmp_path: Path) -> None:
    """The two objects of seed 36 that move earlier in one direction share a tilt; each alone could be a friction."""
    answer, _ = answered(draw(36), tmp_path)
    assert answer["effects"][0]["name"] == "tray_tilt"
    assert answer["effects"][0]["value"] == pytest.approx(draw(36).value, rel=0.35)


def test_a_push_is_no_friction(tmp_path: Path) -> None:
    """The box moves while the base stands still, after it withstood an acceleration."""
    times, acceleration = drive(2.4)
    moved = 0.5 * 0.6 * np.clip(times - 7.4, 0, 0.15) ** 2 + 0.09 * np.clip(times - 7.55, 0, 0.3)
    found = examined(record(tmp_path / "run.mcap", acceleration, moved), scene())
    assert found.verdict == "named"
    assert found.effects[0].name == "push"


def test_direction_and_course_tell_a_push_from_a_slip() -> None:
    """The base accelerates along x; a slip goes along -x, and grows slowly."""
    seconds = np.arange(0.0, 8.0, 0.02)
    acceleration = np.zeros((len(seconds), 3))
    acceleration[:, 0] = np.clip((seconds - 5.0) / 0.3, 0, 1) * 3.5

    def part(*way: float, sudden: float = 0.0) -> Part:
        moved = CarriedMotion("box", "slip", 5.28, 0.02, 0.01, 0.0, 5.26, way, sudden)
        return Part(scene(), ("box",), moved, 8.0)

    limits = SceneLimits.of(scene())
    along, across = (
        probability(limits, acceleration, 0.03, part(*w), seconds, 0.05) for w in ((-1.0, 0.0), (0.0, 1.0))
    )
    assert along > 20 * across > 0.0
    slow, fast = part(-1.0, 0.0, sudden=-9.0), part(-1.0, 0.0, sudden=40.0)
    assert of_course(slow, pushed=False) > 20 * of_course(slow, pushed=True)
    assert of_course(fast, pushed=True) > 20 * of_course(fast, pushed=False)


@pytest.mark.parametrize(("friction", "share"), [(0.49, 1.0), (0.51, 1.0), (0.6, 0.1)])
def test_both_modes_are_likely_where_their_limits_are_nearly_equal(friction: float, share: float) -> None:
    """A box that is twice as high as it is wide tips at a friction of 0.5; a slip is seen."""
    seconds = np.arange(0.0, 8.0, 0.02)
    acceleration = np.zeros((len(seconds), 3))
    acceleration[:, 0] = np.clip((seconds - 5.0) / 0.3, 0, 1) * 5.2
    seen = Part(scene(friction, 0.2), ("box",), CarriedMotion("box", "slip", 5.28, 0.02, 0.01, 0.0, 5.26), 8.0)
    chances = [
        probability(SceneLimits.of(scene(each, 0.2)), acceleration, 0.08, seen, seconds, 0.05)
        for each in (0.49, friction)
    ]
    assert chances[1] == pytest.approx(share * chances[0], rel=0.5)


def test_an_object_that_was_barely_lifted_falls_back_and_tips_the_other_way() -> None:
    """The first pulse is hardly over the limit, the opposite one half a second later is under it."""
    seconds = np.arange(0.0, 8.0, 0.02)
    acceleration = np.zeros((len(seconds), 3))
    tips = 0.5 * GRAVITY
    acceleration[:, 0] = tips * (1.02 * (np.abs(seconds - 5.0) < 0.1) - 0.7 * (np.abs(seconds - 5.5) < 0.1))
    limits = SceneLimits.of(scene(0.9, 0.2))

    def chance(time: float, way: float) -> float:
        moved = CarriedMotion("box", "tip", time, 0.02, 0.1, 0.5, time - 0.02, (way, 0.0))
        return probability(limits, acceleration, 0.08, Part(scene(0.9, 0.2), ("box",), moved, 8.0), seconds, 0.05)

    assert chance(4.92, -1.0) > chance(5.45, 1.0) > 0.05
    assert chance(5.45, -1.0) < 0.1 * chance(5.45, 1.0)
    assert chance(7.0, 1.0) < 1e-3


def test_a_slip_that_is_slower_than_its_release_says_is_no_push() -> None:
    """Small errors of the limit and of the acceleration change the small difference of the two by a half."""
    seconds, fine = np.arange(0.0, 3.0, 1 / 30), np.arange(0.0, 3.0, 1e-3)
    pull = np.clip((fine - 1.0) / 0.2, 0.0, 1.0) * 3.4
    path = np.cumsum(np.cumsum(np.where(pull >= 2.95, 0.5 * (pull - 2.95), 0.0))) * 1e-6
    for seed in range(5):
        signal = np.interp(seconds, fine, path) + np.random.default_rng(seed).normal(scale=1e-3, size=len(seconds))
        seen = int(np.argmax(np.interp(seconds, fine, path) > 6e-3))
        _, moved, _, sudden = onset(seconds, signal, 1e-3, seen, (fine, pull), 0.0, 1.0, 3e-4, 4 / 30)
        assert moved == pytest.approx(fine[np.argmax(path > 3e-4)], abs=0.03)
        assert sudden < 5.0


def test_an_object_elsewhere_is_found_and_allowed_for(tmp_path: Path) -> None:
    _, acceleration = drive(2.0)
    found = examined(record(tmp_path / "run.mcap", acceleration, 0.03 + 0 * acceleration), scene())
    assert found.verdict == "named"
    assert [effect.name for effect in found.effects] == ["object_pose"]
    assert found.effects[0].value == pytest.approx(0.03, abs=2e-3)


def test_a_base_that_leans_in_tf_is_part_of_the_prediction(tmp_path: Path) -> None:
    """At rest on a slope of 10 degrees the load is tan(10 deg) / 0.3."""
    found = examined(record(tmp_path / "run.mcap", np.zeros(3000), np.zeros(3000), lean=np.deg2rad(10)), scene())
    assert found.most == pytest.approx(np.tan(np.deg2rad(10)) / FRICTION, rel=0.02)


def answered(case: Case, folder: Path) -> tuple[dict[str, Any], Seen]:
    """What the command says of a case that MuJoCo moves, and what happened."""
    seen, poses = simulate(case)
    bag, declared, target = folder / "run.mcap", folder / "scene.yaml", folder / "answer.json"
    write(case, bag, poses)
    declared.write_text(yaml.safe_dump(scene_of(case)))
    assert run(["mismatch", str(bag), "--scene", str(declared), "--json", str(target)]) == 0
    return json.loads(target.read_text()), seen


def test_a_higher_centre_of_mass_has_a_rounded_edge_as_rival(tmp_path: Path) -> None:
    """The tall can of seed 25 tips earlier than its scene file says."""
    case = draw(25)
    answer, seen = answered(case, tmp_path)
    assert answer["verdict"] == "named"
    assert answer["effects"][0]["name"] == "com_height"
    assert answer["effects"][0]["value"] == pytest.approx(case.value, rel=0.35)
    assert "rounded edge" in answer["effects"][0]["sentence"]
    assert (answer["seen"][0]["object"], answer["seen"][0]["mode"]) == (seen.name, seen.mode) == ("can_0", "tip")


def test_mujoco_agrees_with_the_engine(tmp_path: Path) -> None:
    """What is as declared has no cause."""
    for seed in (1, 10, 21):
        assert answered(as_declared(draw(seed)), tmp_path)[0]["verdict"] == "none"


def test_bad_recordings_and_options_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, acceleration = drive(2.0)
    bag = record(tmp_path / "run.mcap", acceleration, 0 * acceleration)
    other = replace(scene(), objects=tuple(replace(item, id=f"other_{item.id}") for item in scene().objects))
    with pytest.raises(InputError, match="child frame") as caught:
        read_carried(open_recording(bag), other)
    assert caught.value.code is ErrorCode.FRAME_UNKNOWN
    short = record(tmp_path / "short.mcap", acceleration[:500], 0 * acceleration[:500])
    with pytest.raises(InputError, match="less than 1 s"):
        read_carried(open_recording(short), scene())
    write_scene(scene(), tmp_path / "scene.yaml")
    assert run(["mismatch", str(bag), str(bag), "--scene", str(tmp_path / "scene.yaml")]) == 2
    assert "--scene takes one recording" in capsys.readouterr().err


def test_objects_without_poses_are_listed(tmp_path: Path) -> None:
    _, acceleration = drive(2.0)
    bag = record(tmp_path / "run.mcap", acceleration, 0 * acceleration)
    cup = RigidObject("cup", Box((0.05, 0.05, 0.1)), Pose(np.eye(3), np.array([-0.2, 0.0, 0.05])), mass=0.2)
    more = scene().with_object(cup, pairs=[FrictionPair(("cup", "tray"), 0.4)])
    found = examine_carried(read_carried(open_recording(bag), more), more)
    assert any("cup" in note for note in found.notes)


def test_a_gap_in_the_motion_of_the_base_is_no_acceleration(tmp_path: Path) -> None:
    """The longest stretch is used: the first 5 of 8 s."""
    _, acceleration = drive(2.0)
    bag = record(tmp_path / "run.mcap", acceleration, 0 * acceleration)
    recording = open_recording(bag)
    tray, box = recording.poses("tray"), recording.poses("box")
    gone = (tray.stamps < START + 5 * 10**9) | (tray.stamps > START + 6 * 10**9)
    holed = PoseStream(
        tray.stamps[gone], tray.rotation_parent_child[gone], tray.translation_parent_child[gone], "odom", "tray"
    )
    found = examined(write_bag(tmp_path / "holed.mcap", {"tf": [holed, box]}), scene())
    assert any("gaps" in note for note in found.notes)
    assert found.seconds[-1] == pytest.approx(5.0, abs=0.1)
    assert found.most < 0.6
    assert found.verdict == "none"


def test_a_deadline_leaves_causes_out_and_says_so(tmp_path: Path) -> None:
    _, acceleration = drive(2.0)
    bag = record(tmp_path / "run.mcap", acceleration, slid(acceleration, 0.17))
    found = examine_carried(read_carried(open_recording(bag), scene()), scene(), deadline=0.0)
    assert any("deadline" in note for note in found.notes)
    assert found.verdict == "unknown"
    assert not found.effects


def test_a_box_that_settles_straight_down_has_no_direction(tmp_path: Path) -> None:
    """Exact poses, as a simulator gives them: no direction, and no probability that is not a number."""
    times, _ = drive(1.0)
    frames = [np.arange(len(times))[::20], np.arange(len(times))[::33]]
    stamps = START + np.round(times * 1e9).astype(np.int64)
    down = np.where(times > 5.2, -2.5e-3, 0.0)
    base, place = (np.zeros((len(rows), 3)) for rows in frames)
    place += np.array([0.1, 0.0, 0.03]) + down[frames[1], None] * [0.0, 0.0, 1.0]
    turns = [np.tile(np.eye(3), (len(rows), 1, 1)) for rows in frames]
    streams = [
        PoseStream(stamps[frames[0]], turns[0], base, "odom", "tray"),
        PoseStream(stamps[frames[1]], turns[1], place, "tray", "box"),
    ]
    found = examined(write_bag(tmp_path / "run.mcap", {"tf": streams}), scene())
    assert all(one.way == () for one in found.seen)
    assert np.isfinite(found.declared)


def test_the_benchmark_takes_what_begins_first_as_first() -> None:
    """A slow tip that begins before a fast slip passes its threshold later."""
    body = Body("slow", "box", (0.04, 0.04, 0.1), (0.0, 0.0, 0.1), 1.0, 0.5)
    bodies = body, replace(body, name="fast", place=(0.3, 0.0, 0.1))
    case = Case(0, "none", "", 0.0, bodies, bodies)
    poses = []
    for time in np.arange(0.0, 3.0, 0.01):
        lean = np.deg2rad(2.0) * np.clip((time - 1.0) / 0.8, 0, 1)  # 0.2 degrees at 1.08 s, 1.5 degrees at 1.6 s
        turn = Rotation.from_euler("y", lean).as_matrix()
        slid = np.array([0.3 + 0.02 * max(time - 1.2, 0.0), 0.0, 0.1])  # 0.3 mm at 1.215 s, 2 mm at 1.3 s
        poses.append((float(time), np.array([0.1 * turn[:, 2], slid]), np.array([turn, np.eye(3)])))
    first = _first(case, poses)
    assert (first.name, first.mode) == ("slow", "tip")
    assert first.time == pytest.approx(1.08, abs=0.025)
