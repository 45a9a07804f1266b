"""The foreign benchmark: its physics against closed forms and pinocchio, the strength of effects, and the seals."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")
pytest.importorskip("rosbags")

import mujoco
import pinocchio as pin
import yaml
from scipy.interpolate import make_interp_spline

from benchmarks.foreign import case as cases
from benchmarks.foreign.drives import CoulombFriction, GearRipple, MotorInertia, ViscousFriction
from benchmarks.foreign.events import BaseMotion
from benchmarks.foreign.fault import Fault
from benchmarks.foreign.honest import TOLERANCE
from benchmarks.foreign.load import Load, changed, random_load
from benchmarks.foreign.loads import Flywheel, Slosh, WorldForce
from benchmarks.foreign.motions import MOTIONS, STEP, drive
from benchmarks.foreign.noise import NOISES
from benchmarks.foreign.plan import SEEDS, Plan, applicable, plans
from benchmarks.foreign.profiles import BY_NAME, PROFILES
from benchmarks.foreign.robots import ROBOTS, Array, urdf
from benchmarks.foreign.score import calibration_error, judge, wilson
from benchmarks.foreign.seals import PUBLIC, seal, truth_file, unseal
from benchmarks.foreign.strength import CLOSE, LEAST, MULTIPLE, Rig, Signals, by_wrench, share, tuned
from benchmarks.foreign.world import GRAVITY, Scene, Track, World, rigid
from poise.mismatch.effects import all_effects
from poise.recording import open_recording

SECONDS = 3.2


def scene(robot: str, motion: str = "multi_sine", mobile: bool = False, seconds: float = SECONDS) -> Scene:
    rng = np.random.default_rng(5)
    load = random_load(*ROBOTS[robot].payload, rng)
    arm = MOTIONS[motion](ROBOTS[robot], seconds, rng)
    return Scene(ROBOTS[robot], load, arm, drive(seconds, rng) if mobile else None)


def inverse_dynamics(what: Scene, track: Track) -> tuple[Array, Array, Array]:
    """Wrench on the sensor and efforts by pinocchio's recursive Newton-Euler, at every step but the ends."""
    mobile = what.base is not None
    bare = pin.buildModelFromXML(urdf(what.robot, "odom" if mobile else "base_link"))
    frame = bare.frames[bare.getFrameId(what.robot.frame)]
    whole = what.load.whole
    loaded = bare.copy()
    loaded.appendBodyToJoint(frame.parentJoint, pin.Inertia(whole.mass, whole.com, whole.inertia), frame.placement)
    for model in (bare, loaded):
        model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    q = np.hstack([track.base, track.position]) if mobile else track.position
    course = make_interp_spline(track.seconds, q, k=5)
    rows = np.arange(200, len(q) - 200, 20)
    data, wrench, effort = loaded.createData(), [], []
    for row in rows:
        at = [course(track.seconds[row], order) for order in range(3)]
        if mobile:  # the yaw joint is continuous: cosine and sine
            at[0] = np.concatenate([at[0][:2], [np.cos(at[0][2]), np.sin(at[0][2])], at[0][3:]])
        effort.append(pin.rnea(loaded, data, *at)[3 if mobile else 0 :])
        pin.forwardKinematics(loaded, data, *at)
        pin.updateFramePlacements(loaded, data)
        index = loaded.getFrameId(what.robot.frame)
        v = pin.getFrameVelocity(loaded, data, index, pin.LOCAL)
        a = pin.getFrameAcceleration(loaded, data, index, pin.LOCAL)
        a.linear -= data.oMf[index].rotation.T @ [0, 0, -GRAVITY]
        body = pin.Inertia(whole.mass, whole.com, whole.inertia)
        needed = body * a + v.cross(body * v)
        wrench.append(-needed.vector)
    return rows, np.array(wrench), np.array(effort)


@pytest.mark.parametrize(("robot", "mobile"), [("fr3", False), ("ur10", True), ("gantry", False), ("one_axis", False)])
def test_a_healthy_run_agrees_with_the_recursive_newton_euler_algorithm(robot: str, mobile: bool) -> None:
    what = scene(robot, mobile=mobile)
    track = World(what).run()
    rows, wrench, effort = inverse_dynamics(what, track)
    noise = np.repeat([0.1, 0.005], 3)
    assert np.all(np.sqrt(np.mean((track.wrench[rows] - wrench) ** 2, axis=0)) < 0.5 * noise)
    assert np.all(np.sqrt(np.mean((track.effort[rows] - effort) ** 2, axis=0)) < 0.5 * np.array(what.robot.effort))


@pytest.mark.parametrize("robot", ["xarm7", "gantry"])
def test_motors_do_the_work_that_the_energy_gains(robot: str) -> None:
    what = scene(robot)
    track = World(what).run()
    model = pin.buildModelFromXML(urdf(what.robot, "base_link"))
    frame = model.frames[model.getFrameId(what.robot.frame)]
    whole = what.load.whole
    model.appendBodyToJoint(frame.parentJoint, pin.Inertia(whole.mass, whole.com, whole.inertia), frame.placement)
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    data = model.createData()
    ends = [
        pin.computeMechanicalEnergy(model, data, track.position[row], track.velocity[row])
        for row in (500, len(track.position) - 500)
    ]
    power = np.sum(track.effort * track.velocity, axis=1)[500 : len(track.position) - 499]
    work = float(np.sum(power[1:] + power[:-1]) / 2 * STEP)
    assert work == pytest.approx(ends[1] - ends[0], abs=0.01 * np.abs(power).sum() * STEP)


def test_a_load_at_rest_weighs_what_it_should() -> None:
    what = scene("ur10", "pick_and_place")
    track = World(what).run()
    down = np.array([0.0, 0.0, -GRAVITY]) @ track.turn[100]
    whole = what.load.whole
    np.testing.assert_allclose(track.wrench[100, :3], whole.mass * down, atol=0.03)
    np.testing.assert_allclose(track.wrench[100, 3:], np.cross(whole.com, whole.mass * down), atol=0.003)


def test_the_velocity_of_a_point_is_the_rate_of_its_position() -> None:
    """Also on a link whose centre of mass is not in the sensor's frame."""
    world = World(scene("fr3"))
    world.model.body_ipos[world.frame] = [0.05, -0.03, 0.2]
    place, ahead, step = np.array([0.1, -0.05, 0.15]), [], 1e-6
    world.data.qvel[world.driven] = np.linspace(-1.0, 1.0, len(world.driven))
    for _ in range(2):
        mujoco.mj_forward(world.model, world.data)
        ahead.append(world.point(place))
        world.data.qpos[world.address] += step * world.data.qvel[world.driven]
    np.testing.assert_allclose((ahead[1][0] - ahead[0][0]) / step, ahead[0][1], atol=1e-4)


def change_of(what: Scene, fault: Fault) -> tuple[Track, Array, Array]:
    """A run with an effect, and what it changes of wrench and effort at every tenth step."""
    track = World(what, [fault]).run()
    rows = np.arange(1000, len(track.seconds) - 20, 10)
    wrench, effort = rigid(what, track.position, track.base, rows)
    return replace(track, active=rows), track.wrench[rows] - wrench, track.effort[rows] - effort


def test_friction_rotors_and_ripple_follow_their_equations() -> None:
    what = scene("fr3", seconds=4.0)
    scale = {"scale": [1.0] * 7, "joint": 2}
    noise = 0.1
    track, _, effort = change_of(what, ViscousFriction(2.0, scale))
    v = track.velocity[track.active]
    np.testing.assert_allclose(effort, 2.0 * v, atol=noise)
    track, _, effort = change_of(what, CoulombFriction(3.0, scale))
    v = track.velocity[track.active]
    fast = np.abs(v) > 0.2
    np.testing.assert_allclose(effort[fast], 3.0 * np.sign(v[fast]), atol=3 * noise)
    track, _, effort = change_of(what, MotorInertia(0.5, scale))
    np.testing.assert_allclose(effort, 0.5 * np.gradient(track.velocity, STEP, axis=0)[track.active], atol=noise)
    track, _, effort = change_of(what, GearRipple(1.5, scale | {"order": 12.0, "phase": 0.4}))
    np.testing.assert_allclose(effort[:, 2], 1.5 * np.sin(12.0 * track.position[track.active, 2] + 0.4), atol=noise)


def test_rotors_forces_and_moving_bases_follow_their_equations() -> None:
    what = scene("fr3", seconds=4.0)
    part = {"mass": what.load.part, "place": list(what.load.place)}
    along = np.array([0.6, 0.0, 0.8])
    track, wrench, _ = change_of(what, Flywheel(0.2, part | {"axis": list(along)}))
    turn = track.turn
    rate = np.einsum("nij,nik->njk", turn, np.gradient(turn, STEP, axis=0))[track.active]
    omega = np.stack([rate[:, 2, 1], rate[:, 0, 2], rate[:, 1, 0]], axis=1)
    # The inertia of the ring itself is well inside the tolerance.
    np.testing.assert_allclose(wrench[:, 3:], -np.cross(omega, 0.2 * along), atol=0.02)
    track, wrench, _ = change_of(what, WorldForce(3.0, {"along": list(along), "place": [0.0, 0.0, 0.1]}))
    force = 3.0 * along @ turn_at(track)
    np.testing.assert_allclose(wrench[:, :3], force, atol=0.05)
    np.testing.assert_allclose(wrench[:, 3:], np.cross([0.0, 0.0, 0.1], force), atol=0.005)
    shaken = BaseMotion(0.8, {"along": [1.0, 0.0, 0.0], "window": (1.5, 3.0)})
    track, wrench, _ = change_of(what, shaken)
    pushed = np.einsum("nij,nj->ni", track.turn[track.active], wrench[:, :3])
    assert np.abs(pushed[:, 0]).max() == pytest.approx(0.8 * what.load.whole.mass, rel=0.03)
    assert abs(pushed[:, 0].sum() * 10 * STEP) < 0.02 * what.load.whole.mass


def turn_at(track: Track) -> Array:
    return track.turn[track.active.astype(int)]


def test_a_liquid_swings_at_the_frequency_of_a_pendulum() -> None:
    still = scene("ur10", "pick_and_place", seconds=4.0)
    home = np.broadcast_to(still.arm[0][0], still.arm[0].shape)
    still = replace(still, arm=(home, np.zeros_like(home), np.zeros_like(home)))
    fault = Slosh(0.5 * still.load.part, {"length": 0.08, "ratio": 0.01, "place": list(still.load.place)})
    world = World(still, [fault])

    class Nudge(Slosh):
        def settle(self, inside: World) -> None:
            super().settle(inside)
            inside.data.qvel[inside.model.joint("swing").dofadr[0]] = 1.0

    world.faults = [Nudge(fault.size, fault.truth)]
    track = world.run()
    loudest = int(np.argmax(track.wrench[:, :3].std(axis=0)))
    swing = track.wrench[:, loudest] - track.wrench[:, loudest].mean()
    spectrum = np.abs(np.fft.rfft(swing * np.hanning(len(swing)), 1 << 16))
    # The bob has 2 % more inertia than a point, which slows it by a hundredth.
    expected = np.sqrt(GRAVITY / 0.08 / 1.02) / (2 * np.pi)
    assert np.fft.rfftfreq(1 << 16, STEP)[np.argmax(spectrum)] == pytest.approx(expected, rel=0.03)


def test_a_changed_load_differs_by_the_tolerance_alone() -> None:
    load: Load = random_load(1.0, 2.0, np.random.default_rng(3))
    shift = np.array([0.0, 0.002, 0.0])
    true = changed(load, 1.01, shift, 1.1)
    assert true.whole.mass == pytest.approx(1.01 * load.whole.mass)
    np.testing.assert_allclose(true.whole.com, load.whole.com + shift)
    np.testing.assert_allclose(true.whole.inertia, 1.1 * load.whole.inertia)


@pytest.fixture(scope="module")
def rigs() -> dict[str, tuple[Rig, Track, Signals]]:
    """A short healthy run of three profiles."""
    found = {}
    for name in ("fr3_fast", "gantry_sensor", "one_axis_efforts"):
        rig, _ = cases.draw_rig(BY_NAME[name], np.random.default_rng(1), np.random.default_rng(2), SECONDS)
        track = rig.run(())
        found[name] = (rig, track, rig.signals(track, ()))
    return found


@pytest.mark.parametrize("name", sorted(cases.FAULTS))
def test_an_effect_changes_the_signal_by_its_stated_share(
    name: str, rigs: dict[str, tuple[Rig, Track, Signals]]
) -> None:
    fault = cases.FAULTS[name]
    shown = 0
    for profile, (rig, track, healthy) in rigs.items():
        if not applicable(BY_NAME[profile], ROBOTS[BY_NAME[profile].robot], fault):
            continue
        found = tuned(rig, fault.draw(rig.true, track, np.random.default_rng(4)), 1.0, (track, healthy))
        if found is None:
            continue
        changed_by, stated = found.fault, found.share
        again = rig.signals(rig.run([changed_by]), [changed_by])
        assert share(rig, changed_by, healthy, again) == pytest.approx(stated, rel=1e-6)
        kind = "wrench" if by_wrench(rig.profile, changed_by) else "effort"
        assert np.abs(getattr(again, kind) - getattr(healthy, kind)).max() > 0
        edge = changed_by.size >= 0.99 * changed_by.limit(rig.true)
        least = changed_by.size <= 5.01 * changed_by.outside_tolerance
        assert edge or least or abs(np.log(stated / MULTIPLE)) < 4 * CLOSE, (changed_by.size, stated)
        assert stated >= LEAST * MULTIPLE
        shown += 1
        break
    if name not in (
        "slosh",
        "flexible_mode",
        "loose_part",
        "hanging_rope",
        "backlash",
    ):  # they need longer or livelier motions
        assert shown, f"{name} shows in none of the short runs"


def plan_of(profile: str, name: str = "", seconds: int = 0) -> Plan:
    candidates = (name,) if name else ()
    return Plan((99, seconds), "single" if name else "healthy", profile, candidates, 1.0 if name else 0.0)


def test_one_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    plan = plan_of("gantry_sensor", "sensor_gain")
    for name in ("a", "b"):
        cases.make_case(plan, SECONDS).write(tmp_path / name)
    for name in ("recording.mcap", "model.yaml"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


@pytest.fixture(scope="module")
def healthy_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A healthy case of the gantry."""
    folder = tmp_path_factory.mktemp("foreign") / "healthy"
    cases.make_case(plan_of("gantry_sensor"), SECONDS).write(folder)
    return folder


@pytest.mark.parametrize("name", ["clock_skew", "viscous_friction", "cable_chain"])
def test_the_tool_sees_no_label(name: str, healthy_folder: Path, tmp_path: Path) -> None:
    cases.make_case(plan_of("gantry_sensor", name), SECONDS).write(tmp_path / "case")
    assert sorted(p.name for p in (tmp_path / "case").iterdir()) == ["model.yaml", "recording.mcap"]
    for file in ("model.yaml", "recording.mcap"):
        content = (tmp_path / "case" / file).read_bytes()
        found = {fault for fault in cases.FAULTS if fault.encode() in content}
        assert found <= TOLERANCE.keys(), "the names of tolerances are in every model.yaml"
    assert (healthy_folder / "model.yaml").read_bytes() == (tmp_path / "case" / "model.yaml").read_bytes()
    assert b"robot_description" in (tmp_path / "case" / "recording.mcap").read_bytes()


def test_the_recording_is_read_as_it_was_made(tmp_path: Path) -> None:
    case = cases.make_case(plan_of("ur10_rolling_coarse"), SECONDS)
    case.write(tmp_path / "case")
    recording = open_recording(tmp_path / "case" / "recording.mcap")
    wrench = case.streams.wrench
    assert wrench is not None
    np.testing.assert_array_equal(recording.wrench().stamps, wrench.stamps)
    np.testing.assert_allclose(recording.wrench().wrench_in_sensor, wrench.values)
    assert len(recording.odometry()) == pytest.approx(50 * SECONDS, abs=2)
    model = yaml.safe_load((tmp_path / "case" / "model.yaml").read_text(encoding="utf-8"))
    assert model["tolerance"] == TOLERANCE


def test_errors_of_a_healthy_machine_lie_at_the_edges() -> None:
    rig, _ = cases.draw_rig(BY_NAME["fr3_fast"], np.random.default_rng(1), np.random.default_rng(2), SECONDS)
    honest = rig.honest
    assert rig.true.load.whole.mass / rig.declared.load.whole.mass == pytest.approx(1 + honest.mass)
    assert abs(honest.mass) == TOLERANCE["payload"]["mass"]  # type: ignore[index]
    assert np.linalg.norm(honest.com) == pytest.approx(0.002)
    np.testing.assert_allclose(np.abs(honest.gain[:3, :3]), 0.01)
    assert np.all(np.abs(honest.gain[3:, :3]) > 0)
    assert np.linalg.norm(honest.rotation) == pytest.approx(0.004)
    assert abs(honest.late) <= 0.004


def test_the_clock_stays_inside_its_tolerance_in_every_profile() -> None:
    for profile in PROFILES:
        rig, _ = cases.draw_rig(profile, np.random.default_rng(1), np.random.default_rng(2))
        delay = cases.DRIVER_DELAY if profile.filtering == "driver" else 0.0
        skew = profile.skew * 1e-6 * rig.declared.steps * STEP
        assert max(abs(rig.honest.late + delay), abs(rig.honest.late + delay - skew)) <= 0.004


def test_every_effect_of_the_library_has_its_case() -> None:
    names = {effect.name for effect in all_effects()}
    assert names <= cases.FAULTS.keys(), "a new effect needs physics of this world too"
    assert {name for name, fault in cases.FAULTS.items() if fault.library} <= names


def test_noise_families_have_one_standard_deviation() -> None:
    for family in NOISES.values():
        noise = family(60_000, 6, np.random.default_rng(1))
        np.testing.assert_allclose(noise.std(axis=0), 1.0, rtol=0.15)


def test_seed_sets_share_no_case_and_longer_sets_begin_with_the_shorter() -> None:
    development, final = (list(plans(name, 60)) for name in ("dev", "final"))
    assert not {plan.seed for plan in development} & {plan.seed for plan in final}
    assert list(plans("dev", 20)) == development[:20]
    assert len(set(SEEDS.values())) == len(SEEDS)
    kinds = [plan.kind for plan in development]
    assert kinds.count("healthy") == 18
    assert {plan.profile for plan in development} == {profile.name for profile in PROFILES}
    for plan in development:
        for name in plan.candidates:
            assert applicable(BY_NAME[plan.profile], ROBOTS[BY_NAME[plan.profile].robot], cases.FAULTS[name])


def test_a_label_that_was_changed_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "cases"
    folder.mkdir()
    seal(folder, {"case_0001": {"kind": "healthy"}})
    assert "healthy" not in (folder / PUBLIC).read_text(encoding="utf-8")
    assert unseal(folder) == {"case_0001": {"kind": "healthy"}}
    entries = json.loads(truth_file(folder).read_text(encoding="utf-8"))
    entries["case_0001"]["label"]["kind"] = "single"
    truth_file(folder).write_text(json.dumps(entries), encoding="utf-8")
    with pytest.raises(ValueError, match="case_0001"):
        unseal(folder)


def label(kind: str, *names: str, accept: tuple[str, ...] = ()) -> dict[str, object]:
    effects = [{"name": name, "accept": list(accept)} for name in names]
    return {"kind": kind, "profile": "fr3_fast", "strength": 1.0, "effects": effects}


def said(verdict: str, *names: str, holdout: tuple[float, float] = (2.0, 1.0)) -> dict[str, object]:
    effects = [{"name": name, "probability": 0.9} for name in names]
    fit = {"holdout": {"nominal": 9.0, "calibrated": holdout[0], "augmented": holdout[1]}}
    return {"status": 0, "cpu": 1.0, "answer": {"verdict": verdict, "effects": effects, "fit": fit}}


def test_the_scorer_counts_what_it_says() -> None:
    assert judge("a", label("healthy"), said("none")).right
    assert not judge("a", label("healthy"), said("named", "slosh")).right
    assert judge("a", label("healthy"), said("named", "slosh")).extra
    assert not judge("a", label("healthy"), {"status": 2, "answer": None}).right
    assert judge("a", label("single", "slosh"), said("mixed", "slosh", "cable")).right
    assert judge("a", label("single", "slosh"), said("mixed", "slosh", "cable")).extra
    assert not judge("a", label("single", "slosh"), said("mixed", "cable", "slosh")).right
    assert judge("a", label("pair", "slosh", "cable"), said("named", "cable", "slosh")).right
    assert judge("a", label("outside", "gusts"), said("unknown")).right
    assert not judge("a", label("outside", "gusts"), said("none")).right
    assert judge("a", label("outside", "motor_gain", accept=("effort_gain",)), said("named", "effort_gain")).right
    assert judge("a", label("healthy"), said("unknown", holdout=(1.0, 1.1))).worse
    assert not judge("a", label("healthy"), said("unknown", holdout=(1.1, 1.0))).worse


def test_intervals_and_calibration_error() -> None:
    assert wilson(0, 40) == pytest.approx((0.0, 0.0876), abs=1e-3)
    assert wilson(8, 10) == pytest.approx((0.490, 0.943), abs=2e-3)
    assert calibration_error([(0.9, True)] * 9 + [(0.9, False)]) == pytest.approx(0.0, abs=1e-12)
    assert calibration_error([(0.95, False)] * 4) == pytest.approx(0.95)
