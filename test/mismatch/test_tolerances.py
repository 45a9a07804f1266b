"""A tolerance is a bound: errors up to the edges of all tolerances at once are no finding, larger ones are."""

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
import scipy
from cases import ROBOT, _payload, _trajectory
from field_robots import ARM
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from poise.geometry import STANDARD_GRAVITY
from poise.mismatch import diagnose
from poise.mismatch.effects import GAIN_LEVER, effect_named
from poise.mismatch.effects.part_motion import crept
from poise.mismatch.inference import FittedEffect, Problem, SignalNoise, fit, linearization_point, payload_steps, refine
from poise.mismatch.inference.box import box_minimum
from poise.mismatch.inference.calibration import CALIBRATION_BOUND, effort_calibration
from poise.mismatch.inference.evidence import WhitenedRegression
from poise.mismatch.inference.fitting import exceeds_tolerance
from poise.mismatch.inference.noise import NoiseColour
from poise.mismatch.reading import NominalModel, Tolerance, effort_track, recorded_from_motion
from poise.mismatch.recorded import RecordedMotion, at_times
from poise.robot import RobotModel
from poise.simulation import FourierTrajectory, JointMotion
from poise.types import Array

TOLERANCE = Tolerance()
WIDENING = (
    "payload_parameters",
    "sensor_bias",
    "bias_drift",
    "sensor_gain",
    "sensor_rotation",
    "base_tilt",
    "joint_offset",
    "clock_offset",
)
EFFORT_WIDENING = ("effort_offset", "motor_gain", "link_parameters")
SIGMA = np.repeat([0.1, 0.005], 3)


@cache
def motion() -> RecordedMotion:
    """20 s at 25 Hz, without noise."""
    rng = np.random.default_rng(3)
    seconds = np.arange(500) * 0.04
    made = _trajectory(rng, "fourier", 20.0).at(seconds)
    return recorded_from_motion(ROBOT, seconds, made, _payload(rng).phi)


def errors(rng: np.random.Generator, size: float = 1.0) -> dict[str, Array]:
    """One error of each kind at plus or minus its tolerance times `size`."""
    scale = np.repeat([1.0, GAIN_LEVER], 3)
    shapes = {"payload": 10, "bias": 6, "drift": 6, "gain": (6, 6), "rotation": 3, "tilt": 2, "joints": 6, "clock": ()}
    signs = {name: size * np.asarray(rng.choice([-1.0, 1.0], shape)) for name, shape in shapes.items()}
    return signs | {
        "payload": payload_steps(motion().phi, TOLERANCE) @ signs["payload"],
        "bias": signs["bias"] * np.repeat([TOLERANCE.bias_force, TOLERANCE.bias_torque], 3),
        "drift": signs["drift"] * np.repeat([TOLERANCE.drift_force, TOLERANCE.drift_torque], 3),
        "gain": signs["gain"] * TOLERANCE.sensor_gain * np.outer(scale, 1.0 / scale),
        "rotation": signs["rotation"] * TOLERANCE.sensor_rotation,
        "tilt": signs["tilt"] * TOLERANCE.base_tilt,
        "joints": signs["joints"] * TOLERANCE.joint_offset,
        "clock": signs["clock"] * TOLERANCE.clock_offset,
    }


def read(with_errors: dict[str, Array]) -> Array:
    """(N, 6) what the sensor reads: every error with its exact response."""
    recorded = motion()

    def felt(name: str, values: Array, about: RecordedMotion) -> Array:
        effect = effect_named(name)
        assert effect is not None
        keys = [p.name for p in effect.parameters(about) if not p.choice]
        return effect.simulate(about, dict(zip(keys, np.ravel(values).tolist(), strict=True)))

    wrench = recorded.prediction + felt("joint_offset", with_errors["joints"], recorded)
    wrench += felt("base_tilt", with_errors["tilt"], recorded)
    wrench += felt("payload_parameters", with_errors["payload"], recorded)
    turn = Rotation.from_rotvec(with_errors["rotation"]).as_matrix()
    wrench = np.hstack([wrench[:, :3] @ turn, wrench[:, 3:] @ turn])
    wrench = wrench + wrench @ with_errors["gain"].T
    wrench = at_times(recorded.seconds, wrench, recorded.seconds - float(with_errors["clock"]))
    return wrench + with_errors["bias"] + np.outer(recorded.seconds / recorded.duration - 0.5, with_errors["drift"])


def problem(wrench: Array, rng: np.random.Generator, colour: NoiseColour) -> Problem:
    """The wrench with noise, white or coloured, of a known model."""
    recorded = motion()
    count = len(recorded)
    state, keep = rng.normal(size=6), np.exp(-0.04 / colour.tau)
    noise = np.empty((count, 6))
    for row in noise:
        row[:] = state
        state = keep * state + np.sqrt(1.0 - keep**2) * rng.normal(size=6)
    noise = SIGMA * (rng.normal(size=(count, 6)) + colour.floor * noise)
    known = SignalNoise(SIGMA, (colour,) * 6, recorded.seconds, np.zeros(count), np.ones(6), np.ones(6))
    return Problem(replace(recorded, wrench=wrench + noise), NominalModel(phi=recorded.phi), known)


def named(about: Problem, names: tuple[str, ...]) -> dict[str, dict[str, float]]:
    """The effects that have evidence and lie outside their tolerances, with their values."""
    here, nominal = linearization_point(about, ()), fit(about, ())
    found = {}
    for name in names:
        effect = effect_named(name)
        assert effect is not None
        start = next(iter(effect.starts(here.recorded, here.residual)))
        each = refine(about, here.regression, here.recorded, effect, start)
        if each.gain < 0.0:
            continue
        fitted = fit(about, [FittedEffect(effect, each.values)], 4)
        if fitted.log_evidence - nominal.log_evidence > 1.3 and exceeds_tolerance(about, fitted.parts, effect):
            found[name] = dict(fitted.parts[0].values)
    return found


@pytest.mark.parametrize("colour", [NoiseColour(), NoiseColour(floor=1.0, tau=0.16)], ids=["white", "coloured"])
def test_all_errors_at_their_edges_at_once_are_no_finding(colour: NoiseColour) -> None:
    rng = np.random.default_rng(11)
    found = [named(problem(read(errors(rng)), rng, colour), WIDENING) for _ in range(20)]
    assert found == [{}] * 20


@pytest.mark.parametrize("shape", ["swing", "warm-up"])
def test_a_drift_inside_its_tolerance_may_be_curved(shape: str) -> None:
    """A swing was an effect outside the library that depends on the elapsed time."""
    rng, passed = np.random.default_rng(13), motion().seconds / motion().duration
    curve = np.sin(1.6 * np.pi * passed) / 2 if shape == "swing" else np.exp(-3.0 * passed)
    largest = np.repeat([TOLERANCE.drift_force, TOLERANCE.drift_torque], 3) * rng.choice([-1.0, 1.0], 6)
    wrench = read(errors(rng) | {"drift": np.zeros(6)}) + np.outer(curve, largest)
    recorded = replace(motion(), wrench=wrench + 0.2 * SIGMA * rng.normal(size=wrench.shape))
    assert diagnose(recorded, NominalModel(phi=recorded.phi)).verdict == "none"


@pytest.mark.parametrize("edge", [0.5, -0.5], ids=["start", "end"])
def test_a_drift_may_leave_the_largest_bias(edge: float) -> None:
    """A sensor that is off by its bias at the start, or at the end, and by more elsewhere, was `bias_drift`."""
    rng = np.random.default_rng(17)
    made = errors(rng)
    drift = np.sign(edge * made["bias"]) * np.abs(made["drift"])
    wrench = read(made | {"drift": drift, "bias": made["bias"] + edge * drift})
    recorded = replace(motion(), wrench=wrench + 0.2 * SIGMA * rng.normal(size=wrench.shape))
    assert diagnose(recorded, NominalModel(phi=recorded.phi)).verdict == "none"


@pytest.mark.parametrize("name", WIDENING)
def test_an_error_beyond_what_all_tolerances_can_explain_is_a_finding(name: str) -> None:
    """The other errors are zero. Crosstalk inside its tolerance can explain a part of several of them."""
    group = {"sensor_gain": "gain"}.get(name, effect_named(name).widens)  # type: ignore[union-attr]
    factor = {"gain": 6.0, "rotation": 8.0, "joints": 12.0, "tilt": 10.0, "payload": 4.0}.get(group, 2.0)
    rng = np.random.default_rng(5)
    made = errors(rng, 0.0)
    made[group] = errors(rng, factor)[group]
    about = problem(read(made), rng, NoiseColour())
    assert name in named(about, (name,))


def test_the_estimate_of_a_widened_error_has_no_bias() -> None:
    """A clock that is late by 1.5 tolerances; twelve noises."""
    rng = np.random.default_rng(6)
    late = 1.5 * TOLERANCE.clock_offset
    made = errors(rng, 0.0) | {"clock": np.asarray(late)}
    wrench = read(made)
    values = [
        named(problem(wrench, rng, NoiseColour()), ("clock_offset",))["clock_offset"]["offset"] for _ in range(12)
    ]
    error = np.mean(values) - late
    assert abs(error) < 3.0 * np.std(values) / np.sqrt(12) + 2e-5
    assert abs(error) < 0.02 * late


def test_a_fit_ends_at_the_bound_that_the_data_exceed() -> None:
    rng = np.random.default_rng(7)
    made = errors(rng, 0.0) | {"clock": np.asarray(2.0 * TOLERANCE.clock_offset)}
    about = problem(read(made), rng, NoiseColour())
    found = fit(about, ())
    assert np.abs(found.regression.coefficients()).max() <= CALIBRATION_BOUND
    assert (np.abs(found.regression.coefficients()) == CALIBRATION_BOUND).any()
    free = fit(about, [FittedEffect(effect_named("clock_offset"), {"offset": 0.005})])  # type: ignore[arg-type]
    assert free.parts[0].values["offset"] == pytest.approx(2.0 * TOLERANCE.clock_offset, rel=0.1)


@cache
def effort_motion() -> RecordedMotion:
    """The efforts of a chain of three joints, 20 s at 25 Hz."""
    robot = RobotModel.from_urdf(ARM, "link_3")
    rng = np.random.default_rng(2)
    seconds = np.arange(500) * 0.04
    made = FourierTrajectory.random(robot, rng, duration=20.0, speed=1.0, frequency=0.15).at(seconds)
    phi = _payload(rng).phi
    track = effort_track(robot, seconds, made, np.zeros((500, 3)), phi)
    track = replace(track, measured=track.rigid)
    return recorded_from_motion(robot, seconds, made, phi, effort=track)


@pytest.mark.parametrize(
    ("size", "expected"), [(1.0, set()), (20.0, {"effort_offset", "motor_gain", "link_parameters"})]
)
def test_efforts_with_all_errors_at_their_edges_are_no_finding_and_larger_ones_are(
    size: float, expected: set[str]
) -> None:
    recorded = effort_motion()
    track = recorded.effort
    assert track is not None
    # Smoothing has no edge.
    groups = [group for group in effort_calibration(recorded, TOLERANCE) if np.isfinite(group.bound)]
    assert {group.name for group in groups} == {"payload", "joints", "gain", "offset", "links", "tilt", "clock"}
    rng = np.random.default_rng(9)
    sigma = 0.005 * track.sizes
    noise = SignalNoise(sigma, (NoiseColour(),) * 3, track.seconds, np.zeros(500), np.ones(3), np.ones(3))
    wide = {"effort_offset": "offset", "motor_gain": "gain", "link_parameters": "links"}
    for _ in range(10):
        wrong = {group.name: group.columns @ rng.choice([-1.0, 1.0], group.columns.shape[2]) for group in groups}
        found = set()
        for name in EFFORT_WIDENING:
            # All at the edge; the error of this effect beyond.
            extra = sum(wrong.values()) + (size - 1.0) * wrong[wide[name]]
            measured = track.rigid + extra + sigma * rng.normal(size=track.rigid.shape)
            about = replace(recorded, effort=replace(track, measured=measured))
            found |= set(named(Problem(about, NominalModel(phi=recorded.phi), noise, "effort"), (name,)))
        assert found == expected


def test_links_and_tilt_are_derivatives_of_the_efforts() -> None:
    recorded = effort_motion()
    track, joints = recorded.effort, recorded.joints
    assert track is not None
    assert track.links is not None
    assert joints is not None
    robot = RobotModel.from_urdf(ARM, "link_3")
    motion_of = JointMotion(joints.position, joints.velocity, joints.acceleration)
    bare = effort_track(robot, track.seconds, motion_of, track.measured, np.zeros(10))
    assert track.links.efforts.sum(axis=2) == pytest.approx(bare.rigid, abs=1e-9)
    by_tilt = bare.by_tilt(STANDARD_GRAVITY)
    assert by_tilt is not None
    for axis in range(2):
        efforts = []
        for angle in (1e-3, -1e-3):
            model = robot.pinocchio.copy()
            model.gravity.linear = Rotation.from_rotvec(-angle * np.eye(3)[axis]).apply([0.0, 0.0, -STANDARD_GRAVITY])
            data = model.createData()
            efforts.append([pin.rnea(model, data, q, v, a).copy() for q, v, a in zip(*motion_of, strict=True)])
        slope = (np.array(efforts[0]) - np.array(efforts[1])) / 2e-3
        assert slope == pytest.approx(by_tilt[:, :, axis], abs=1e-4)


def test_least_squares_in_a_box_agree_with_the_method_of_active_sets() -> None:
    rng = np.random.default_rng(1)
    for trial in range(30):
        size = int(rng.integers(1, 60))
        matrix = rng.normal(size=(size + 20, size)) * 10.0 ** rng.uniform(-1, 2, size)
        upper = np.where(rng.random(size) < 0.7, 1.0, np.inf)
        lower = np.where(rng.random(size) < 0.5, -upper, -1.0 if trial % 2 else 0.0)
        target = matrix @ rng.choice([-1.5, 0.3, 1.0], size) + rng.normal(size=size + 20)
        normal, right = matrix.T @ matrix + 0.01 * np.eye(size), matrix.T @ target
        factor = np.linalg.cholesky(normal)
        exact = lsq_linear(factor.T, np.linalg.solve(factor, right), (lower, upper), method="bvls", tol=1e-13).x
        found = box_minimum(normal, right, lower, upper)
        assert ((found >= lower) & (found <= upper)).all()
        halves = [float(x @ (0.5 * normal @ x - right)) for x in (found, exact)]
        assert halves[0] - halves[1] < 1e-3


def test_inside_the_bounds_there_is_no_penalty() -> None:
    """The square is that of ordinary least squares up to the edge, and rises beyond it."""
    rng = np.random.default_rng(2)
    columns = rng.normal(size=(3, 400))
    squares = []
    for size in (0.0, 0.999, 1.5):
        target = size * columns.sum(axis=0)
        regression = WhitenedRegression((columns,), np.full(3, 3.0), np.zeros(3), target, np.ones(3))
        squares.append(regression.square)
    assert squares[1] - squares[0] < 0.05
    assert squares[2] - squares[0] == pytest.approx(0.25 * float(columns.sum(axis=0) @ columns.sum(axis=0)), rel=0.01)


@pytest.mark.parametrize(
    ("late", "constant", "expected"), [(0.014, 0.0, "clock_offset"), (0.0, 0.03, "low_pass")], ids=["late", "filtered"]
)
def test_smoothing_beside_a_late_clock_is_no_filter(late: float, constant: float, expected: str) -> None:
    """A driver that smooths all signals without delay; the smoothing in the calibration is as late as the wrench."""
    recorded, rng = motion(), np.random.default_rng(4)
    wrench = recorded.prediction
    if constant:
        wrench = crept(recorded.seconds, wrench, constant)
    else:
        wrench = gaussian_filter1d(wrench, 0.045 / recorded.period, axis=0, mode="nearest")
        wrench = at_times(recorded.seconds, wrench, recorded.seconds - late)
    about = replace(recorded, wrench=wrench + SIGMA * rng.normal(size=wrench.shape))
    library = [effect_named(name) for name in ("clock_offset", "low_pass")]
    found = diagnose(about, NominalModel(phi=recorded.phi), library=[each for each in library if each is not None])
    assert [each.effect.name for each in found.findings] == [expected]


def test_a_butterworth_filter_is_no_late_clock() -> None:
    """It delays slow wrenches as a late clock does. That of scipy runs at 20 times the rate of the recording."""
    recorded, rng = motion(), np.random.default_rng(4)
    bandwidth, finer = 4.0, 20
    fine = np.linspace(recorded.seconds[0], recorded.seconds[-1], finer * (len(recorded) - 1) + 1)
    taps = scipy.signal.butter(2, bandwidth, output="sos", fs=finer / recorded.period)
    load = at_times(recorded.seconds, recorded.prediction, fine)
    begin = scipy.signal.sosfilt_zi(taps)[:, :, None] * load[0]
    wrench = scipy.signal.sosfilt(taps, load, axis=0, zi=begin)[0][::finer]
    about = replace(recorded, wrench=wrench + SIGMA * rng.normal(size=wrench.shape))
    library = [effect_named(name) for name in ("clock_offset", "low_pass")]
    found = diagnose(about, NominalModel(phi=recorded.phi), library=[each for each in library if each is not None])
    assert [each.effect.name for each in found.findings] == ["low_pass"]
    assert "Butterworth" in found.findings[0].sentence
    constant = found.findings[0].parameters["time_constant"]
    assert abs(constant.value - np.sqrt(0.5) / (np.pi * bandwidth)) < 3.0 * constant.std


@pytest.mark.parametrize(("late", "expected"), [(0.6, []), (3.0, ["clock_skew"])])
def test_a_skew_that_stays_within_the_tolerance_of_the_clock_is_no_finding(late: float, expected: list[str]) -> None:
    """Clocks differ by 20 to 100 ppm: over a minute that is a millisecond or more, which exact motions show."""
    recorded, rng = motion(), np.random.default_rng(4)
    over = late * NominalModel().tolerance.clock_offset
    wrench = at_times(recorded.seconds, recorded.prediction, recorded.seconds * (1.0 - over / recorded.duration))
    about = replace(recorded, wrench=wrench + SIGMA * rng.normal(size=wrench.shape))
    library = [effect_named(name) for name in ("clock_offset", "clock_skew")]
    found = diagnose(about, NominalModel(phi=recorded.phi), library=[each for each in library if each is not None])
    assert [each.effect.name for each in found.findings] == expected
