"""The diagnosis of robots as they are: joint efforts without a wrist sensor, from one joint upwards."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import make_case
from field_robots import ARM, Recorded, read, streams, urdf

from poise.cli import run
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.mismatch.answer import diagnose, effects_called
from poise.mismatch.effects import Effect, all_effects
from poise.mismatch.reading import NominalModel, acting_on_efforts, joined, on_efforts, parse_model, read_streams
from poise.mismatch.recorded import RecordedMotion
from poise.recording import JointStream, PoseStream, write_recording
from poise.robot import RobotModel
from poise.simulation import FourierTrajectory, IdealRobot
from poise.types import Array

TURN = urdf(("turn", "revolute", "0 1 0"))
SLIDE = urdf(("slide", "prismatic", "1 0 0"))
GANTRY = urdf(("x", "prismatic", "1 0 0"), ("y", "prismatic", "0 1 0"), ("z", "prismatic", "0 0 1"))


@pytest.mark.parametrize("text", [TURN, SLIDE, GANTRY, ARM])
def test_friction_is_named_from_joint_efforts_alone(text: str) -> None:
    case = Recorded(text, damping=3.0)
    reading = read(case.joints(), text)
    assert reading.model.sensor_frame == f"link_{text.count('<joint')}"
    assert not reading.recorded.has("wrench")
    assert reading.recorded.joints is not None
    found = diagnose(reading.recorded, reading.model, library=effects_called(["viscous_friction"]))
    (named,) = found.findings
    assert list(named.values.values()) == pytest.approx([3.0] * text.count("<joint"), rel=0.05)
    unit = "N s/m" if "prismatic" in text else "N m s/rad"
    assert {each.unit for each in named.parameters.values()} == {unit}
    assert f" {unit}; " in named.sentence
    assert found.main.proof.augmented < 0.5 * found.main.proof.nominal
    healthy = read(Recorded(text).joints(), text)
    assert not diagnose(healthy.recorded, healthy.model, library=effects_called(["viscous_friction"])).findings


def loaded_axis(seed: int, load: Array, seconds: float = 16.0) -> JointStream:
    """One axis with a load (10,), as its driver reports it."""
    robot, rng = RobotModel.from_urdf(TURN, "link_1"), np.random.default_rng(seed)
    at = np.arange(round(125.0 * seconds)) / 125.0
    moved = FourierTrajectory.random(robot, rng, duration=seconds, speed=1.0, frequency=0.3).at(at)
    effort = IdealRobot(robot, load).effort(moved) + 0.05 * rng.normal(size=(len(at), 1))
    position = moved.position + 1e-5 * rng.normal(size=effort.shape)
    stamps = np.round((at + 100.0) * 1e9).astype(np.int64)
    return JointStream(stamps, robot.joint_names, position, moved.velocity, effort)


def on_one_axis(name: str) -> tuple[RecordedMotion, Effect]:
    """The efforts of one axis with a load of 1.7 kg, and an effect of the load as they show it."""
    load = np.array([1.7, 0.05, 0.0, 0.17, 0.023, 0.0, -0.005, 0.022, 0.0, 0.006])
    recorded = read(loaded_axis(1, load), TURN, NominalModel(phi=load)).recorded
    (effect,) = (acting_on_efforts(each) for each in effects_called([name]))
    assert effect is not None
    return recorded, effect


@pytest.mark.parametrize("seed", [0, 2])
def test_a_load_on_one_axis_is_not_a_gain_and_a_rotor(seed: int) -> None:
    """A gain and a rotor have the response of a load here, with fewer parameters each: one cause is simpler."""
    load = np.array([0.5, 0.025, 0.0, 0.0, 0.01, 0.0, 0.0, 0.01125, 0.0, 0.01])
    reading = read(loaded_axis(seed, load), TURN)
    tried = ["motor_gain", "motor_inertia", "payload_parameters", "viscous_friction", "coulomb_friction"]
    (named,) = diagnose(reading.recorded, reading.model, library=effects_called(tried)).findings
    assert named.effect.name == "payload_parameters"


def test_a_soft_grasp_on_one_axis_is_searched_in_what_its_efforts_show() -> None:
    """One effort shows one of six channels of a wrench; the others would outweigh it in the choice of a start."""
    recorded, grasp = on_one_axis("grasp_compliance")
    for stiffness in (12.0, 40.0, 150.0):
        residual = grasp.simulate(recorded, {"stiffness": stiffness, "damping_ratio": 0.25, "height": 0.03})
        rest = []
        for start in grasp.starts(recorded, residual):
            response = grasp.simulate(recorded, start)
            scale = np.vdot(response, residual) / np.vdot(response, response)
            rest.append(float(np.sum((residual - scale * response) ** 2) / np.sum(residual**2)))
            assert start["stiffness"] == pytest.approx(stiffness, rel=0.7)
        assert min(rest) < 0.6


def test_a_load_that_changes_on_one_axis_is_searched_in_what_its_efforts_show() -> None:
    """With five channels that were not recorded, the best time was a third of a second late, beside a false contact."""
    recorded, step = on_one_axis("mass_step")
    for time in (5.0, 7.3, 11.2):
        changed = {"mass": 0.2, "moment_x": 0.02, "moment_y": 0.0, "moment_z": 0.01}
        residual = step.simulate(recorded, {"time": time, "returns": 0.0, "length": 0.5, **changed})
        assert next(iter(step.starts(recorded, residual)))["time"] == pytest.approx(time, abs=0.01)


def test_every_effect_of_the_load_is_searched_on_one_axis() -> None:
    load = np.array([1.0, 0.1, 0.0, 0.05, 0.02, 0.0, 0.0, 0.02, 0.0, 0.01])
    recorded = read(loaded_axis(3, load), TURN, NominalModel(phi=load)).recorded
    assert recorded.effort is not None
    residual = recorded.effort.measured - recorded.effort.prediction
    for effect in (on_efforts(each, recorded) for each in all_effects()):
        if effect.signal == "effort" and not effect.untestable(recorded):
            for start in effect.starts(recorded, residual):
                linear = {p.name: 0.1 for p in effect.parameters(recorded) if p.linear}
                assert effect.simulate(recorded, {**start, **linear}).shape == residual.shape, effect.name


def test_effects_on_signals_that_were_not_recorded_are_listed_with_the_reason() -> None:
    reading, names = read(Recorded(TURN).joints(), TURN), ["viscous_friction", "sensor_bias"]
    found = diagnose(reading.recorded, reading.model, library=effects_called(names))
    assert found.untestable["sensor_bias"] == "there is no wrench to examine"
    # Efforts alone can show a pull on the load.
    names.append("world_force")
    assert "world_force" not in diagnose(reading.recorded, reading.model, library=effects_called(names)).untestable
    found = diagnose(make_case(3, duration=8.0).recorded(), reading.model, library=effects_called(names))
    assert found.untestable["viscous_friction"] == "there are no usable joint efforts"


@pytest.mark.parametrize("rate", [1000.0, 5000.0])
def test_fast_efforts_are_averaged_to_what_the_motion_can_follow(rate: float) -> None:
    case = Recorded(TURN, seconds=6.0, rate=rate)
    reading = read(case.joints(), TURN)
    effort = reading.recorded.effort
    assert effort is not None
    assert np.median(np.diff(effort.seconds)) == pytest.approx(0.004, rel=0.01)
    # The noise of a mean of k samples is smaller by the root of k, and the mean is where the motion is.
    error = effort.measured - effort.prediction
    assert error.std() == pytest.approx(case.effort_noise / np.sqrt(rate / 250.0), rel=0.1)
    assert any("were averaged" in note for note in reading.notes)


def test_without_wrench_and_efforts_it_says_what_to_record() -> None:
    joints = Recorded(TURN, effort_noise=np.nan).joints()
    with pytest.raises(InputError, match="no wrench") as caught:
        read(joints, TURN)
    assert caught.value.code is ErrorCode.TOPIC_MISSING


def test_a_payload_of_the_model_hangs_on_the_last_link() -> None:
    joints = Recorded(ARM).joints()
    model = NominalModel(phi=np.array([1.0, 0.1, 0.0, 0.0, *[0.0] * 6]))
    empty, loaded = (read_streams(streams(joints), each).recorded.effort for each in (NominalModel(), model))
    assert empty is not None
    assert loaded is not None
    # Slow at first: the weight of 1 kg, 0.3 m along the first link and 0.4 m along the second.
    upper, both = empty.position[0, 0], empty.position[0, :2].sum()
    lever = 0.3 * np.cos(upper) + 0.4 * np.cos(both)
    assert abs((loaded.rigid - empty.rigid)[0, 0]) == pytest.approx(9.81 * lever, rel=0.1)


def with_effort(joints: JointStream, effort: Array) -> JointStream:
    return replace(joints, effort=effort)


def of(kind: str, joints: JointStream, text: str = ARM) -> tuple[tuple[str, ...], tuple[float, ...], Array | None]:
    """The joints and numbers of a finding, and the efforts that are left."""
    reading = read(joints, text)
    (finding,) = (each for each in reading.findings if each.kind == kind)
    assert finding.sentence in reading.notes
    effort = reading.recorded.effort
    return finding.joints, finding.values, None if effort is None else effort.measured


def test_honest_efforts_have_no_findings() -> None:
    for case in (Recorded(damping=5.0, coulomb=4.0), Recorded(TURN, coulomb=1.0), Recorded(GANTRY, damping=20.0)):
        assert read(case.joints(), case.text).findings == ()


@pytest.mark.parametrize("text", [ARM, SLIDE])
def test_efforts_without_a_sign_are_left_out(text: str) -> None:
    joints = Recorded(text, damping=2.0, coulomb=2.0).joints()
    assert of("effort_unsigned", with_effort(joints, np.abs(joints.effort)), text)[2] is None


def test_efforts_that_are_not_measured_are_left_out_joint_by_joint() -> None:
    joints = Recorded().joints()
    names, _, left = of("effort_zero", with_effort(joints, joints.effort * [1.0, 0.0, 1.0]))
    assert names == ("elbow",)
    assert left is not None
    assert left.shape[1] == 2
    assert of("effort_constant", with_effort(joints, np.full_like(joints.effort, 3.0)))[2] is None


def test_newton_millimetres_are_converted_and_other_units_left_out_with_their_factors() -> None:
    joints = Recorded(damping=2.0, coulomb=2.0).joints()
    _, _, left = of("effort_unit", with_effort(joints, joints.effort * 1000.0))
    honest = read(joints).recorded.effort
    assert left is not None
    assert honest is not None
    np.testing.assert_allclose(left, honest.measured)
    factors = np.array([0.05, 0.09, 0.2])
    names, values, left = of("effort_unit", with_effort(joints, joints.effort * factors))
    assert left is None
    assert values == pytest.approx([factors[joints.names.index(name)] for name in names], rel=0.15)


def test_one_large_factor_of_all_axes_of_a_gantry_is_a_unit_and_no_rotor() -> None:
    joints = Recorded(GANTRY, damping=2.0, effort_noise=0.02).joints()
    _, values, left = of("effort_unit", with_effort(joints, 37.0 * joints.effort), GANTRY)
    assert left is None
    assert values == pytest.approx([37.0] * len(values), rel=0.05)


def test_the_opposite_sign_of_one_joint_is_turned() -> None:
    joints = Recorded(coulomb=1.0).joints()
    names, _, left = of("effort_sign", with_effort(joints, joints.effort * [1.0, -1.0, 1.0]))
    assert names == ("elbow",)
    honest = read(joints).recorded.effort
    assert honest is not None
    np.testing.assert_allclose(left, honest.measured)


def test_a_level_slide_shows_volts_and_the_opposite_sign_by_its_inertia() -> None:
    """Gain and rotor cannot be distinguished there, but a rotor only adds."""
    joints = Recorded(SLIDE, damping=3.0, effort_noise=0.02).joints()
    _, values, left = of("effort_unit", with_effort(joints, joints.effort / 35.0), SLIDE)
    assert values == pytest.approx([1 / 35.0], rel=0.1)
    assert left is None
    assert of("effort_sign", with_effort(joints, -joints.effort), SLIDE)[0] == ("slide",)
    # A rotor of five times the mass of the slide is no other unit.
    heavy = with_effort(joints, joints.effort + 10.0 * np.gradient(joints.velocity, joints.seconds, axis=0))
    assert read(heavy, SLIDE).findings == ()


def test_efforts_without_gravity_are_left_out() -> None:
    case = Recorded(damping=6.0, coulomb=3.0)
    joints = case.joints()
    friction = case.friction(joints.velocity) + np.random.default_rng(0).normal(size=joints.effort.shape) * 0.1
    assert of("effort_unrelated", with_effort(joints, friction))[2] is None


def test_joints_at_rest_are_named_and_a_robot_at_rest_has_no_answer() -> None:
    names, _, left = of("joints_at_rest", Recorded(moving=(0.0, 1.0, 0.0)).joints())
    assert names == ("shoulder", "wrist")
    assert left is not None
    with pytest.raises(NoAnswerError, match="nothing moves"):
        read(Recorded(moving=(0.0, 0.0, 0.0)).joints())


def test_joints_without_states_stand_where_the_model_says_or_are_named() -> None:
    joints = Recorded().joints()
    seen = JointStream(
        joints.stamps, joints.names[1:], *(v[:, 1:] for v in (joints.position, joints.velocity, joints.effort))
    )
    with pytest.raises(InputError, match=r"joint_positions.*shoulder") as caught:
        read(seen)
    assert caught.value.code is ErrorCode.JOINT_MISSING
    # With the shoulder at a quarter turn, the links hang: the elbow holds them without effort.
    level, hanging = (
        read(seen, model=parse_model({"joint_positions": {"shoulder": angle}})).recorded.effort
        for angle in (0.0, np.pi / 2)
    )
    assert level is not None
    assert hanging is not None
    assert level.names == hanging.names == ("elbow", "wrist")
    (held,) = read(seen, model=parse_model({"joint_positions": {"shoulder": 0.1}})).findings
    assert (held.kind, held.joints, held.values) == ("joints_held", ("shoulder",), (0.1,))
    # A joint behind the last one with states is held at zero.
    parts = (values[:, :2] for values in (joints.position, joints.velocity, joints.effort))
    reading = read(JointStream(joints.stamps, joints.names[:2], *parts))
    assert reading.model.sensor_frame == "link_2"
    assert [(each.kind, each.joints) for each in reading.findings] == [("joints_held", ("wrist",))]
    # Without the joint between two with states, nothing is held: it may have moved.
    parts = (values[:, ::2] for values in (joints.position, joints.velocity, joints.effort))
    with pytest.raises(InputError, match=r"states of wrist.*record elbow") as caught:
        read(JointStream(joints.stamps, joints.names[::2], *parts))
    assert caught.value.code is ErrorCode.JOINT_MISSING
    assert np.abs(hanging.rigid[:10, 0]).max() < 0.2 * np.abs(level.rigid[:10, 0]).min()


def test_the_delay_behind_the_commands_is_found_joint_by_joint() -> None:
    joints = Recorded().joints()
    ahead = np.array([0.03, 0.08, 0.15])
    seconds = joints.seconds
    sent = np.stack([np.interp(seconds + t, seconds, q) for t, q in zip(ahead, joints.position.T, strict=True)], axis=1)
    commands = JointStream(joints.stamps, joints.names, sent, np.full_like(sent, np.nan), np.full_like(sent, np.nan))
    reading = read_streams(streams(joints, commands=commands), NominalModel())
    (finding,) = reading.findings
    assert finding.kind == "command_tracking"
    assert finding.values == pytest.approx(ahead, abs=2e-3)
    track = reading.recorded.commands
    assert track is not None
    effort = reading.recorded.effort
    assert effort is not None
    late = track.position_at(effort.seconds - ahead[1])[:, 1] - effort.position[:, 1]
    assert np.abs(late[200:]).max() < 2e-3


def written(folder: Path, text: str, **streams: JointStream) -> str:
    write_recording(folder / "run.mcap", streams, robot_description=text)
    return str(folder / "run.mcap")


def test_commands_without_states_and_states_of_another_robot_have_no_answer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    joints = Recorded(seconds=6.0).joints()
    assert run(["mismatch", written(tmp_path, ARM, joint_commands=joints)]) == 3
    assert "no joint_states" in capsys.readouterr().err
    assert run(["mismatch", written(tmp_path, TURN, joint_states=joints)]) == 3
    assert "another robot" in capsys.readouterr().err


def test_without_a_usable_effort_the_findings_are_the_answer(tmp_path: Path) -> None:
    joints = Recorded(seconds=6.0).joints()
    bag = written(tmp_path, ARM, joint_states=with_effort(joints, np.abs(joints.effort)), joint_commands=joints)
    assert run(["mismatch", bag, "--json", str(tmp_path / "answer.json")]) == 0
    said = json.loads((tmp_path / "answer.json").read_text())
    assert said["verdict"] == "unknown"
    assert said["effects"] == []
    assert [finding["kind"] for finding in said["input_findings"]] == ["effort_unsigned", "command_tracking"]


def test_recordings_are_joined_over_the_efforts_that_all_of_them_have() -> None:
    first, second = (Recorded(seconds=6.0, seed=seed).joints() for seed in (1, 2))
    silent = with_effort(second, second.effort * [1.0, 1.0, 0.0])
    whole, last = joined([read(joints).recorded for joints in (first, silent)])
    assert whole.effort is not None
    assert whole.effort.names == ("shoulder", "elbow")
    assert whole.effort.links is not None
    assert len(whole.effort.seconds) == len(whole.effort.links.efforts) == len(whole)
    assert last.sum() == len(read(silent).recorded)
    with pytest.raises(InputError, match="only some"):
        joined([whole, replace(whole, wrench=whole.prediction)])


def test_a_driving_base_counts_in_joint_efforts_alone() -> None:
    """The base accelerates along x: a level slide along x needs its mass times that acceleration."""
    joints = Recorded(SLIDE, seconds=8.0).joints()
    seconds = joints.seconds
    place = np.stack([0.5 * np.sin(1.5 * seconds), 0.0 * seconds, 0.0 * seconds], axis=1)
    turn = np.broadcast_to(np.eye(3), (len(seconds), 3, 3))
    odometry = PoseStream(joints.stamps, turn, place, "odom", "link_0")
    standing = read(joints, SLIDE).recorded.effort
    driving = read_streams(replace(streams(joints, SLIDE), odometry=odometry), NominalModel()).recorded.effort
    assert standing is not None
    assert driving is not None
    rows = np.isin(standing.seconds, driving.seconds)
    felt = -2.0 * 0.5 * 1.5**2 * np.sin(1.5 * driving.seconds)
    np.testing.assert_allclose((driving.rigid - standing.rigid[rows])[:, 0], felt, atol=0.05)


def test_joint_states_that_cannot_be_used_are_counted_with_the_reason() -> None:
    joints = Recorded(TURN).joints()
    unread = replace(joints, position=np.full_like(joints.position, np.nan))
    with pytest.raises(InputError, match=rf"0 of {len(joints)} .*: {len(joints)} are not finite, 0 repeat"):
        read(unread, TURN)
    stopped = replace(joints, stamps=np.full_like(joints.stamps, joints.stamps[0]))
    with pytest.raises(InputError, match=rf"1 of {len(joints)} .*: 0 are not finite, {len(joints) - 1} repeat"):
        read(stopped, TURN)


@pytest.mark.parametrize(("factor", "said"), [(1e-3, "stamps are not in ns"), (1e3, "unit of the stamps")])
def test_stamps_in_another_unit_are_said(factor: float, said: str) -> None:
    joints = Recorded(TURN).joints()
    stamps = joints.stamps[0] + np.round((joints.stamps - joints.stamps[0]) * factor).astype(np.int64)
    with pytest.raises(InputError, match=said):
        read(replace(joints, stamps=stamps), TURN)


def test_positions_of_a_slide_in_millimetres_are_said() -> None:
    joints = Recorded(SLIDE).joints()
    with pytest.raises(InputError, match=r"m: are the positions in mm"):
        read(replace(joints, position=1e4 * joints.position), SLIDE)


def test_the_play_of_a_lift_is_in_mm_and_that_of_the_arm_on_it_in_degrees() -> None:
    text = urdf(("lift", "prismatic", "0 0 1"), ("elbow", "revolute", "0 1 0"))
    recorded = read(Recorded(text).joints(), text).recorded
    (effect,) = effects_called(["backlash"])
    values = {"turned": 0.0, "settling": 0.01, "own": 1.0, "others": 1.0, "own_knock": 0.0, "others_knock": 0.0}
    lift, elbow = {**values, "joint": 1.0, "gap": 1e-4}, {**values, "joint": 2.0, "gap": 1e-2}
    assert "lift has 0.1 mm of backlash: its force" in effect.sentence(recorded, lift)
    assert "elbow has 0.57 degrees of backlash: its torque" in effect.sentence(recorded, elbow)
    assert effect.implausible(recorded, lift) == effect.implausible(recorded, elbow) == ""
    assert effect.implausible(recorded, lift | {"gap": 1e-2}) == "gap would be 0.01 m"
    assert effect.implausible(recorded, elbow | {"gap": 3e-5}) == "gap would be 3e-05 rad"
    (ripple,) = effects_called(["gear_ripple"])
    waves = {"order": 50.0 * np.pi, "sine": 3.0, "cosine": 4.0}
    assert "force of lift oscillates 25.0 times per metre by 5.00 N:" in ripple.sentence(
        recorded, waves | {"joint": 1.0}
    )
    assert "torque of elbow oscillates 157.1 times per revol" in ripple.sentence(recorded, waves | {"joint": 2.0})


def test_links_that_differ_much_ask_for_the_description() -> None:
    (effect,) = effects_called(["link_parameters"])
    recorded = read(Recorded(ARM).joints()).recorded
    first = effect.parameters(recorded)[0].name
    still = {each.name: 0.0 for each in effect.parameters(recorded)}
    assert "is it of this robot" in effect.sentence(recorded, still | {first: 100.0})
    assert "is it of this robot" not in effect.sentence(recorded, still | {first: 1e-3})
