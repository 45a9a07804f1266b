"""The benchmark's objects, motions and scenarios are what they claim, and every method answers them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.identification.bounds import bounds, fisher_information
from benchmarks.identification.evaluation import Experiment, run, summarise
from benchmarks.identification.modular import (
    HOLE_RADIUS,
    HOLES,
    PATTERNS,
    PLATE,
    PLATE_DENSITY,
    PLATE_IN_SENSOR,
    WEIGHTS,
    modular_objects,
)
from benchmarks.identification.motions import (
    AMPLITUDE,
    FREQUENCIES,
    OFFSETS,
    SENSOR_ON_FLANGE,
    TURNS,
    WristMotion,
    wrist_motion,
)
from benchmarks.identification.objects import BenchmarkObject, load_tools
from benchmarks.identification.scenarios import (
    DEVELOPMENT_SEEDS,
    FINAL_SEEDS,
    FORCE_BIAS,
    NOISE,
    Scenario,
    make_trial,
)
from poise.errors import ErrorCode, InputError
from poise.inertia.estimators.registry import method, method_names
from poise.inertia.model.metrics import errors, expected_errors
from poise.inertia.model.parameters import InertialParameters
from poise.inertia.model.problem import IdentificationProblem

Array = np.ndarray
FAST = Scenario("fast", 1.5)
SECONDS = np.arange(150) / 100
TOOLS = {tool.name: tool for tool in load_tools()}


def tool(name: str = "hammer") -> BenchmarkObject:
    return TOOLS[name]


@pytest.mark.parametrize("subject", [*TOOLS.values(), *modular_objects()], ids=lambda subject: subject.name)
def test_every_object_can_exist_and_its_mass_centre_is_inside(subject: BenchmarkObject) -> None:
    assert subject.truth.is_consistent
    low, high = subject.hull.min(axis=0), subject.hull.max(axis=0)
    assert np.all((low < subject.truth.com) & (subject.truth.com < high))
    np.testing.assert_allclose(high - low, subject.bounding_box)
    np.testing.assert_allclose(subject.unit_parts[0], 1)
    for part in subject.unit_parts.T:
        assert InertialParameters.from_phi(part).is_consistent
    assert np.all((low - 1e-6 <= subject.points) & (subject.points <= high + 1e-6))


@pytest.mark.parametrize("name", ["box_wrench", "measuring_tape", "ruler", "bent_jaw_pliers", "adjustable_wrench"])
def test_tools_of_one_material_weigh_as_their_shape_says(name: str) -> None:
    """The mesh, its scale and both frames are right: centroid and inertia agree with the CAD's."""
    subject = tool(name)
    shares = subject.part_volumes / subject.volume
    found = errors(
        InertialParameters.from_phi(subject.truth.mass * subject.unit_parts @ shares),
        subject.truth,
        subject.bounding_box,
    )
    assert found.com < 0.3
    assert found.inertia < 0.3


def test_parts_explain_tools_of_several_materials_better_than_one_body() -> None:
    for name in ("screwdriver", "nut_screwdriver", "file", "hammer", "clamp"):
        subject = tool(name)
        scale = np.linalg.norm(subject.bounding_box)
        weight = 1 / (subject.truth.mass * np.array([1, *[scale] * 3, *[scale**2] * 6]))
        masses = np.linalg.lstsq(weight[:, None] * subject.unit_parts, weight * subject.truth.phi, rcond=None)[0]
        shares = subject.part_volumes / subject.volume
        whole = InertialParameters.from_phi(subject.truth.mass * subject.unit_parts @ shares)
        in_parts = InertialParameters.from_phi(subject.unit_parts @ masses)
        assert np.all(masses > 0)
        ours, theirs = (errors(body, subject.truth, subject.bounding_box).com for body in (in_parts, whole))
        assert ours < theirs / 10


def test_the_stop_and_go_motion_is_its_own_derivative() -> None:
    for subject in TOOLS.values():
        motion = subject.stop_and_go
        assert motion is not None
        rotation = motion.rotation_world_sensor
        turn = Rotation.from_matrix(rotation[:-2].swapaxes(1, 2) @ rotation[2:]).as_rotvec() / 0.02
        worst = np.abs(motion.angular_velocity_in_sensor).max()
        np.testing.assert_allclose(turn, motion.angular_velocity_in_sensor[1:-1], atol=0.01 * worst)


def test_the_modular_object_is_the_sum_of_its_grains() -> None:
    """Against a fine grid of point masses, for a pattern without symmetry."""
    subject = next(one for one in modular_objects() if one.name == "Corner")
    step = 0.001
    axes = [np.arange(-side / 2 + step / 2, side / 2, step) for side in PLATE]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    density = np.full(len(points), PLATE_DENSITY)
    for letter, (x, y) in zip("".join(PATTERNS["Corner"]), HOLES, strict=True):
        hole = (points[:, 0] - x) ** 2 + (points[:, 1] - y) ** 2 < HOLE_RADIUS**2
        filled = hole & (np.abs(points[:, 2]) < WEIGHTS[letter].length / 2)
        density[hole] = 0.0
        density[filled] = WEIGHTS[letter].mass / (filled.sum() * step**3)
    masses = density * step**3
    homogeneous = np.column_stack([points + PLATE_IN_SENSOR, np.ones(len(points))])
    found = InertialParameters.from_phi(subject.truth.phi)
    np.testing.assert_allclose((homogeneous.T * masses) @ homogeneous, found.pseudo_inertia, rtol=4e-3, atol=1e-6)


def test_a_steel_weight_weighs_101_grams_and_an_abs_weight_17() -> None:
    for subject in modular_objects():
        pattern = "".join(PATTERNS[subject.name])
        plate = PLATE_DENSITY * (np.prod(PLATE) - len(HOLES) * np.pi * HOLE_RADIUS**2 * PLATE[2])
        assert subject.truth.mass == pytest.approx(plate + 0.101 * pattern.count("S") + 0.017 * pattern.count("a"))


def position(motion: WristMotion, seconds: float) -> Array:
    """Where the sensor is, by multiplying the transforms of the links (no velocities)."""
    argument = 2 * np.pi * FREQUENCIES * motion.speed_up * seconds + motion.phase
    angles = motion.start + AMPLITUDE * np.sin(argument)
    place, rotation = np.zeros(3), Rotation.from_euler("x", 90, degrees=True).as_matrix()
    for angle, turn, offset in zip(angles, TURNS, OFFSETS, strict=True):
        rotation = rotation @ Rotation.from_euler("z", angle).as_matrix()
        place = place + rotation @ offset
        rotation = rotation @ turn
    return place + rotation @ SENSOR_ON_FLANGE


def test_wrist_motions_are_exact_derivatives_of_each_other() -> None:
    rng = np.random.default_rng(1)
    motion = WristMotion(rng.uniform(-3, 3, 3), rng.uniform(-3, 3, 3), 2.0)
    step = 1e-4
    times = rng.uniform(0, 1.5, 20)
    before, now, after = (motion.at(times + shift) for shift in (-step, 0.0, step))
    turn = Rotation.from_matrix(before.rotation_world_sensor.swapaxes(1, 2) @ after.rotation_world_sensor).as_rotvec()
    np.testing.assert_allclose(turn / (2 * step), now.angular_velocity_in_sensor, atol=1e-6)
    gain = (after.angular_velocity_in_sensor - before.angular_velocity_in_sensor) / (2 * step)
    np.testing.assert_allclose(gain, now.angular_acceleration_in_sensor, atol=1e-5)
    for index, time in enumerate(times):
        bend = position(motion, time + step) - 2 * position(motion, time) + position(motion, time - step)
        in_sensor = now.rotation_world_sensor[index].T @ bend / step**2
        np.testing.assert_allclose(in_sensor, now.linear_acceleration_in_sensor[index], atol=1e-5)


@pytest.mark.parametrize("speed", [1.0, 1.5, 2.0])
def test_a_wrist_motion_has_the_mean_speed_asked_for(speed: float) -> None:
    motion = wrist_motion(np.random.default_rng(2), speed, SECONDS)(SECONDS)
    assert np.linalg.norm(motion.angular_velocity_in_sensor, axis=1).mean() == pytest.approx(speed)


def test_the_same_seed_gives_the_same_numbers_and_another_seed_others() -> None:
    one, again, other = (make_trial(tool(), FAST, seed).problem for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.wrench, again.wrench)
    assert not np.allclose(one.wrench, other.wrench)


def test_nothing_is_tuned_on_the_final_seeds() -> None:
    assert not set(DEVELOPMENT_SEEDS) & set(FINAL_SEEDS)


@pytest.mark.parametrize("level", ["low", "moderate", "high"])
def test_noise_is_that_of_the_thesis_tables(level: str) -> None:
    trial = make_trial(tool(), Scenario("", noise=level), 1)
    noise = NOISE[level]
    for name, expected in (
        ("linear_acceleration", noise.linear_acceleration),
        ("angular_acceleration", noise.angular_acceleration),
    ):
        found = np.std(getattr(trial.problem, name) - getattr(trial.clean, name))
        assert found == pytest.approx(expected, rel=0.05)
    residual = trial.problem.wrench - trial.clean.wrench
    assert np.std(residual[:, :3]) == pytest.approx(noise.force, rel=0.05)
    assert np.std(residual[:, 3:]) == pytest.approx(noise.torque, rel=0.05)


@pytest.mark.parametrize("speed", [None, 1.5])
def test_a_late_wrench_shows_at_its_stamp_what_was_true_earlier(speed: float | None) -> None:
    trial = make_trial(tool(), Scenario("", speed, noise="no", delay=0.02), 1)
    late, clean = trial.problem.wrench, trial.clean.wrench
    np.testing.assert_allclose(late[2:], clean[:-2], atol=1e-6)
    assert np.abs(late - clean).max() > 0.01


def test_a_bias_is_constant_and_the_methods_are_told_that_there_may_be_one() -> None:
    trial = make_trial(tool(), Scenario("", noise="no", bias=True), 1)
    np.testing.assert_allclose(trial.problem.wrench - trial.clean.wrench, np.tile(trial.bias, (1000, 1)), atol=1e-12)
    assert trial.problem.noise.force_bias == FORCE_BIAS
    assert not make_trial(tool(), Scenario(""), 1).problem.noise.has_bias


def test_weighted_least_squares_attains_the_bound_when_accelerations_are_exact() -> None:
    trial = make_trial(modular_objects()[0], Scenario("", 2.0), 1)
    problem, truth = trial.clean, trial.subject.truth
    rows = (problem.regressor / problem.noise.wrench[:, None]).reshape(-1, 10)
    rng = np.random.default_rng(5)
    noise = rng.normal(size=(2000, len(rows)))
    found = truth.phi + noise @ np.linalg.pinv(rows).T
    covariance = np.linalg.inv(fisher_information(trial, exact_motion=True))
    np.testing.assert_allclose(np.std(found, axis=0), np.sqrt(np.diag(covariance)), rtol=0.1)
    measured = [errors(InertialParameters.from_phi(phi), truth, trial.subject.bounding_box) for phi in found[:500]]
    shares = [np.mean([getattr(one, name) for one in measured]) for name in ("mass", "com", "inertia")]
    np.testing.assert_allclose(expected_errors(covariance, truth, trial.subject.bounding_box)[0], shares, rtol=0.15)


def test_more_knowledge_lowers_the_bound() -> None:
    for bias in (False, True):
        least = bounds(make_trial(tool(), Scenario("", 1.5, bias=bias), 1))
        assert np.all(least["bound"] >= least["bound, smooth"] * (1 - 1e-9))
        assert np.all(least["bound, smooth"] > least["bound, parts"])


@pytest.mark.parametrize("name", method_names())
def test_every_method_answers_in_one_calling_form(name: str) -> None:
    problem = make_trial(tool("c_clamp"), Scenario("", noise="low"), 1).problem
    solution = method(name)(problem)
    assert solution.phi.shape == (10,)
    assert solution.phi[0] == pytest.approx(tool("c_clamp").truth.mass, rel=0.02)
    assert solution.covariance.shape == (10, 10)
    assert solution.bias.shape == (6,)
    assert solution.n_samples <= len(problem)
    assert solution.residual_force < 1


def test_an_unknown_method_is_answered_with_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"poise.*geo.*rtls"):
        method("magic")


def test_a_table_has_every_method_and_bound_and_counts_failures() -> None:
    experiment = Experiment(
        "",
        "",
        (tool("ruler"),),
        (Scenario("", 1.0),),
        {"ols": method("ols"), "hps": method("hps"), "geo": method("geo")},
    )
    trials = []
    summaries = summarise(run(experiment, [1], lambda: trials.append(1)))
    assert len(trials) == 1
    assert {who for _, who in summaries} >= {"ols", "hps", "geo", "bound"}
    assert summaries["", "geo"].consistent == 100
    assert summaries["", "ols"].answered == 100


def test_tools_that_are_not_there_are_told_so(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        load_tools(tmp_path / "nothing.npz")
    assert caught.value.code == ErrorCode.FILE_UNREADABLE


def broken(problem: IdentificationProblem, **changes: Array) -> IdentificationProblem:
    return replace(problem, **changes)


def test_problems_that_make_no_sense_are_refused_at_the_door() -> None:
    problem = make_trial(tool(), FAST, 1).problem
    spoilt = problem.wrench.copy()
    spoilt[7, 2] = np.nan
    cases = {
        ErrorCode.NOT_FINITE: {"wrench": spoilt},
        ErrorCode.TYPE_MISMATCH: {"angular_velocity": problem.angular_velocity[:-1]},
        ErrorCode.BAD_INPUT: {"stamps": problem.stamps[::-1]},
    }
    for code, changes in cases.items():
        with pytest.raises(InputError) as caught:
            broken(problem, **changes)
        assert caught.value.code == code
    with pytest.raises(InputError) as caught:
        broken(problem, part_volumes=-problem.part_volumes)
    assert caught.value.code == ErrorCode.BAD_INPUT


def test_selected_samples_keep_what_is_known_of_the_object() -> None:
    problem = make_trial(tool(), FAST, 1).problem
    half = problem.select(slice(None, None, 2))
    assert len(half) == 75
    assert half.unit_parts is problem.unit_parts or np.array_equal(half.unit_parts, problem.unit_parts)
    np.testing.assert_array_equal(half.regressor, problem.regressor[::2])
    assert half.seconds[1] == pytest.approx(0.02)
