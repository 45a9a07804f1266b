"""The samples of a recording weighed by any method of the registry; Poise's own also shows how it closed in."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia.bayes import PRIOR_SPREAD, SURELY, PoiseEstimator
from poise.inertia.estimators import OWN_METHOD, InformationAccumulator, method, solve
from poise.inertia.model import EstimateFinding, IdentificationProblem, InertialSolution, Parts, RejectionLog
from poise.inertia.pipeline.clock_offset import clock_offset
from poise.inertia.pipeline.estimate import Identification, InertialEstimate
from poise.inertia.pipeline.samples import LEAST_NOISE, RecordedSamples
from poise.recording import interpolate, interpolate_rotations
from poise.robot import USED, SensorMotion
from poise.types import Array

HISTORY = 12
"""Points that show the estimate closing in."""

SHARP = 0.0015
"""s: clocks that the samples alone compare this well need no prior, and no shape."""

UNBIASED = ("pmd", "hps")
"""Methods that know no bias."""

MISFIT, ENOUGH = 1.15, 50
"""Residual in units of what least squares leave, from so many samples on, at which a shape is dropped."""

LEARNT = 0.8
"""Of the prior's spread: a delay that is no better known has not been estimated."""

LARGEST_GAP = 0.1
"""s between samples across which nothing is interpolated."""

MAX_SAMPLES = 20_000
"""For methods that look at every sample again and again; of more, that many are taken, evenly spread."""


def weigh(
    samples: RecordedSamples,
    name: str,
    *,
    parts: Parts | None = None,
    shape_accuracy: float | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Identification:
    """Estimate what the sensor carried.

    Args:
        samples: of the recording.
        name: of the method, see `methods`.
        parts: of the object in the sensor frame; None when nothing is known of its shape.
        shape_accuracy: relative error of lengths in the shape; None: that of a model from CAD.
        progress: is told how far it is.

    Raises:
        InputError: UNSUPPORTED for a method that wants a shape when there is none.
        NoAnswerError: TOO_FEW_SAMPLES, NOT_IDENTIFIABLE, SOLVER_FAILED.
    """
    if not samples.used.any():
        raise NoAnswerError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"{name}: none of the {len(samples.stamps) + len(samples.lost[0])} wrench samples can be used (left out:"
            f" {_counts(samples)}); see that motion and wrench are of the same time",
            n_samples=0,
        )
    try:  # least squares say what the samples alone show, when nothing is known of the bias; without that, no answer
        information = InformationAccumulator()
        information.add(samples.matrix[samples.used], samples.wrench[samples.used])
        plain = solve(information)
        _refuse_other_sign(plain)
        if name == OWN_METHOD:
            answer = _by_poise(samples, parts, shape_accuracy, progress)
            if parts is None or not _fits_worse(answer.estimate, plain):
                return answer
            answer = _by_poise(samples, None, None, progress)
            found = replace(answer.estimate, findings=(*answer.estimate.findings, _NO_SUCH_SHAPE))
            return replace(answer, estimate=found, history=(*answer.history[:-1], found))
        return _by_registry(samples, name, parts, plain)
    except NoAnswerError as error:
        raise NoAnswerError(
            error.code, f"{name}: {error.message} (left out: {_counts(samples)})", **error.data
        ) from None


def _fits_worse(estimate: InertialEstimate, plain: InertialSolution) -> bool:
    """The shape keeps the estimate from following the wrench, where nothing but a rigid body would follow it."""
    force = estimate.residual_force / max(plain.residual_force, LEAST_NOISE.force)
    torque = estimate.residual_torque / max(plain.residual_torque, LEAST_NOISE.torque)
    return estimate.n_samples >= ENOUGH and max(force, torque) > MISFIT


_NO_SUCH_SHAPE = EstimateFinding(
    ErrorCode.SHAPE_MISMATCH,
    "no object of the shape that was given weighs like this, wherever its mass is: the answer does without the shape;"
    " check that it is the right object, its unit (metres), frame and pose",
)


def _refuse_other_sign(plain: InertialSolution) -> None:
    """A payload that pulls upwards is a wrench of the other sign: the load's on the sensor is wanted."""
    mass, deviation = plain.phi[0], np.sqrt(plain.covariance[0, 0])
    if np.isfinite(mass) and mass < -SURELY * deviation:
        raise NoAnswerError(
            ErrorCode.NOT_CONSISTENT,
            f"the wrench shows a mass of {mass:.4g} kg, so its sign is turned around (or gravity's is): record what the"
            " load exerts on the sensor, at rest f = m g",
            mass=float(mass),
        )


def _by_registry(samples: RecordedSamples, name: str, parts: Parts | None, plain: InertialSolution) -> Identification:
    """Any other method, with what `plain` least squares see and say of the bias."""
    if name == "rtls" and plain.unidentified:
        raise NoAnswerError(
            ErrorCode.NOT_IDENTIFIABLE,
            f"this motion does not show {', '.join(plain.unidentified)}, and total least squares go astray without:"
            " turn the payload about every axis, or take poise or ols",
            unidentified=plain.unidentified,
        )
    solution = replace(method(name)(_problem(samples, parts)), unidentified=plain.unidentified)
    deviations = plain.bias / np.sqrt(np.diag(plain.bias_covariance))
    findings: tuple[EstimateFinding, ...] = ()
    if name in UNBIASED and np.any(np.abs(np.nan_to_num(deviations)) > SURELY):
        size = float(np.linalg.norm(np.nan_to_num(plain.bias[:3])))
        sentence = f"{name} takes the sensor for one without bias, but it reads {size:.2f} N with nothing on it"
        findings = (EstimateFinding(ErrorCode.UNSUPPORTED, f"{sentence}: zero the sensor, or take poise"),)
    return _identification(samples, (_estimate(samples, replace(solution, findings=findings), name),))


def _by_poise(
    samples: RecordedSamples, parts: Parts | None, shape_accuracy: float | None, progress: Callable[[float], None]
) -> Identification:
    """Portion by portion, an answer after each; clocks are compared beforehand when the samples alone can do that."""
    known = clock_offset(samples)
    sharp = known is not None and known.std < SHARP
    options: dict[str, Any] = {} if shape_accuracy is None else {"shape_accuracy": shape_accuracy}
    if sharp:
        options["longest_delay"] = 0.0
    estimator = PoiseEstimator(parts, samples.noise, gravity=samples.gravity, **options)
    motion, wrench = _on_one_clock(samples, known.mean if sharp and known is not None else 0.0)
    history: list[InertialEstimate] = []
    pieces = [piece for piece in np.array_split(np.arange(len(wrench)), HISTORY) if len(piece)]
    for number, piece in enumerate(pieces):
        estimator.add_motion(motion.select(piece), wrench[piece])
        progress((number + 1) / len(pieces))
        try:
            solution = estimator.solve()
        except NoAnswerError:
            if number + 1 < len(pieces):
                continue
            raise
        if sharp and known is not None:
            solution = replace(solution, delay=known.mean, delay_std=known.std)
        history.append(_estimate(samples, solution, OWN_METHOD))
    return _identification(samples, tuple(history))


def _on_one_clock(samples: RecordedSamples, delay: float) -> tuple[SensorMotion, Array]:
    """The samples used, each wrench (N, 6) with the motion of the time at which it was really measured."""
    motion, wrench = samples.motion.select(samples.used), samples.wrench[samples.used]
    if not delay:
        return motion, wrench
    then = motion.stamps - round(delay * 1e9)
    rotation = interpolate_rotations(motion.stamps, motion.rotation_world_sensor, then, max_gap=LARGEST_GAP)
    rates = interpolate(motion.stamps, np.hstack([getattr(motion, name) for name in _RATES]), then, max_gap=LARGEST_GAP)
    known = rotation.found & rates.found
    moved = SensorMotion(motion.stamps, rotation.values, *np.hsplit(rates.values, 3))
    return moved.select(known), wrench[known]


_RATES = ("angular_velocity_in_sensor", "angular_acceleration_in_sensor", "linear_acceleration_in_sensor")


def _problem(samples: RecordedSamples, parts: Parts | None) -> IdentificationProblem:
    """What methods of the registry are asked; the bias is not known."""
    rows = np.flatnonzero(samples.used)
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), MAX_SAMPLES)).astype(np.int64))]
    known = {}
    if parts is not None:
        known = {"unit_parts": parts.unit_phi, "part_volumes": parts.volumes, "shape_points": parts.inside}
    return IdentificationProblem.from_motion(
        samples.motion.select(rows), samples.wrench[rows], samples.gravity, noise=samples.noise, **known
    )


def _estimate(samples: RecordedSamples, solution: InertialSolution, name: str) -> InertialEstimate:
    """Dress a solution; what came out of the samples and what was left out at their door belong together."""
    log = RejectionLog(None)
    stamps = np.concatenate([samples.stamps, samples.lost[0]])
    reasons = np.concatenate([samples.reasons, samples.lost[1]])
    order = np.argsort(stamps, kind="stable")
    log.add(stamps[order], reasons[order])
    stamp = int(samples.stamps[samples.used][-1])
    dressed = InertialEstimate.from_solution(
        solution, stamp=stamp, frame_id=samples.frame_id, method=name, rejected=log.intervals
    )
    if solution.delay_std < LEARNT * PRIOR_SPREAD:
        return dressed
    return replace(dressed, delay=np.nan, delay_std=np.nan)


def _identification(samples: RecordedSamples, history: tuple[InertialEstimate, ...]) -> Identification:
    """The last estimate is the answer; predictions are for the samples as they were stamped."""
    answer = history[-1]
    delay = 0.0 if np.isnan(answer.delay) else answer.delay
    motion = samples.motion
    matrix = samples.matrix
    if delay:
        then = motion.stamps - round(delay * 1e9)
        flat = interpolate(motion.stamps, matrix.reshape(len(matrix), -1), then, max_gap=LARGEST_GAP).values
        matrix = flat.reshape(matrix.shape)
    return Identification(
        estimate=answer,
        stamps=samples.stamps,
        wrench_measured=samples.wrench,
        wrench_predicted=matrix @ np.nan_to_num(answer.phi) + np.nan_to_num(answer.bias),
        motion=motion,
        history=history,
        source=samples.source,
    )


def _counts(samples: RecordedSamples) -> str:
    reasons = np.concatenate([samples.reasons, samples.lost[1]])
    names, counts = np.unique(reasons[reasons != USED], return_counts=True)
    return ", ".join(f"{count} {reason}" for reason, count in zip(names, counts, strict=True)) or "none"
