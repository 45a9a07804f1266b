"""Segments of a recording between changes of the payload, each weighed, and the segment that is the answer."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia.estimators import DEFAULT_METHOD, estimator_named, model_matrix
from poise.inertia.model import EstimateFinding, RejectedInterval
from poise.inertia.pipeline.block_means import BlockMeans, block_means
from poise.inertia.pipeline.estimate import InertialEstimate, PayloadSegment
from poise.inertia.pipeline.method_pipeline import PairedSamples
from poise.inertia.pipeline.online import OnlineEstimator
from poise.inertia.pipeline.payload_changes import PayloadChanges, find_changes
from poise.robot import USED, PairingReasons, SensorMotion
from poise.types import Array, Mask, Stamps

PAYLOAD_CHANGE = "payload_change"
"""Reason of samples that were not used because the payload changed."""

_EMPTY_HAND, _EMPTY_SHARE, _SURELY = 0.02, 0.1, 3.0
"""kg, share of the heaviest payload, and standard deviations below which nothing is held."""

_SAME_SHARE = 0.02
"""Share of a mass by which an object that is weighed twice may differ."""

_SHARP_DELAY = 0.005
"""s: a delay that is known better is taken out before changes are looked for."""

_SPREAD, _LEAST_SPREAD = 1.5, np.array([0.03, 0.002])
"""Of the bias that the other segments show: in units of its standard deviation, and what a sensor creeps, N and N m."""

_SHOWN = 4
"""Changes that a finding names."""


@dataclass(frozen=True, eq=False)
class _KnownMotion:
    """Motion that was paired before, as a `MotionBuffer`."""

    samples: PairedSamples

    @property
    def decided(self) -> int:
        return int(self.samples.stamps[-1])

    def update(self, flush: bool = False) -> None:
        """Nothing more will come."""

    def pair(self, stamps: Stamps) -> tuple[SensorMotion, PairingReasons]:
        rows = np.searchsorted(self.samples.stamps, stamps)
        return self.samples.motion.select(rows), self.samples.reasons[rows]

    def forget_before(self, stamp: int) -> None:
        """Everything is kept."""

    def needs_from(self) -> None:
        return None


def weigh_segments(
    samples: PairedSamples, whole: InertialEstimate | None, estimator: OnlineEstimator, method: str
) -> tuple[PayloadSegment, ...]:
    """Look for changes of the payload, and weigh what was held between them.

    Args:
        samples: of the whole recording.
        whole: the answer for one payload; None when there is none.
        estimator: that has taken the samples.
        method: of estimation; a segment that it cannot weigh is weighed by the default one.

    Returns:
        The segments in the order of time; none where the payload did not change, or where one of them is no payload.
    """
    used = samples.reasons == USED
    if not used.any():
        return ()
    known = whole is not None and whole.delay_std < _SHARP_DELAY
    delay = whole.delay if whole is not None and known else 0.0
    blocks = block_means(samples.motion.select(used), samples.wrench[used], estimator.gravity, delay)
    changes = find_changes(blocks)
    if changes is None:
        return ()
    try:
        if changes.slope is not None:
            return _leaking(samples, blocks, changes.slope, changes.log_odds[0], estimator, method)
        return _weighed_each(samples, blocks, changes, estimator, method)
    except NoAnswerError:  # in a part of the recording, no payload has the wrench
        if whole is None:
            raise
        return ()


def _weighed_each(
    samples: PairedSamples, blocks: BlockMeans, changes: PayloadChanges, estimator: OnlineEstimator, method: str
) -> tuple[PayloadSegment, ...]:
    """Every segment between changes."""
    found: list[PayloadSegment] = []
    for number in range(changes.count):
        own = np.flatnonzero(changes.labels == number)
        start, end = int(blocks.start[own[0]]), int(blocks.end[own[-1]])
        is_empty = bool(changes.masses[number] < _EMPTY_HAND)
        estimate = _weighed(_between(samples, start, end), estimator, method, changes.biases[number], is_empty)
        since = start if not number else int(blocks.start[changes.edges[number - 1]])
        event = "start" if not number else _event([each.estimate for each in found], estimate)
        odds = np.nan if not number else changes.log_odds[number - 1]
        found.append(PayloadSegment(start, end, since, event, odds, estimate))
    return tuple(found)


def answer_of(segments: tuple[PayloadSegment, ...], whole: tuple[RejectedInterval, ...]) -> InertialEstimate:
    """The estimate of the last segment in which an object was held, with a finding that names the changes.

    Args:
        segments: at least one.
        whole: samples of the whole recording that were not used.
    """
    chosen = _last_held(segments)
    estimate = chosen.estimate
    others = [RejectedInterval(each.start, each.end, each.estimate.n_samples, PAYLOAD_CHANGE) for each in segments]
    others = [span for span in others if span.start != chosen.start]
    first = min(each.start for each in segments)
    rejected = sorted((*whole, *others, *estimate.rejected), key=lambda span: span.start)
    finding = _finding(segments, chosen, first)
    return replace(
        estimate, rejected=tuple(dict.fromkeys(rejected)), findings=(finding, *estimate.findings), since=chosen.start
    )


def predicted_wrench(segments: tuple[PayloadSegment, ...], motion: SensorMotion, gravity: Array) -> Array:
    """(N, 6) what the payload of each segment says of the samples, N and N m; NaN in transitions."""
    result = np.full((len(motion), 6), np.nan)
    for segment in segments:
        some = (motion.stamps >= segment.start) & (motion.stamps <= segment.end)
        matrix = model_matrix(motion.select(some), gravity)
        result[some] = matrix @ np.nan_to_num(segment.estimate.phi) + np.nan_to_num(segment.estimate.bias)
    return result


def _between(samples: PairedSamples, start: int, end: int) -> PairedSamples:
    some: Mask = (samples.stamps >= start) & (samples.stamps <= end)
    return PairedSamples(samples.stamps[some], samples.wrench[some], samples.motion.select(some), samples.reasons[some])


def _weighed(
    samples: PairedSamples, estimator: OnlineEstimator, method: str, bias: tuple[Array, Array], is_empty: bool
) -> InertialEstimate:
    """One segment, with the bias that it shows itself or with that of the others, whichever is more precise.

    Args:
        samples: of the segment.
        estimator: of the recording.
        method: of estimation.
        bias: (6,) that the other segments show, N and N m, and its deviations (2,).
        is_empty: nothing is held.
    """
    spread = np.hypot(_SPREAD * bias[1], _LEAST_SPREAD)
    found: list[InertialEstimate] = []
    for name in dict.fromkeys((method, DEFAULT_METHOD)):
        found += _tried(samples, estimator, name, (np.zeros(6), np.full(2, np.nan)), is_empty)
        if found and np.isfinite(found[0].mass_std):
            break
    if np.isfinite(spread).all():
        found += _tried(samples, estimator, DEFAULT_METHOD, (bias[0], spread), is_empty)
    if not found:
        raise NoAnswerError(
            ErrorCode.TOO_FEW_SAMPLES, f"{len(samples.stamps)} samples of a payload are too few: record it for longer"
        )
    return min(found, key=lambda each: float(np.nan_to_num(each.mass_std, nan=np.inf)))


def _tried(
    samples: PairedSamples, estimator: OnlineEstimator, method: str, bias: tuple[Array, Array], is_empty: bool
) -> list[InertialEstimate]:
    """The estimate with one method and a bias (6,) with a spread (2,), NaN where it is not known; none if it fails."""
    spread = float(bias[1][0]), float(bias[1][1])
    pipeline = estimator.pipeline_of(estimator_named(method), _KnownMotion(samples), bias[0], spread, is_empty)
    pipeline.add(samples.stamps, samples.wrench)
    pipeline.update(0, flush=True)
    try:
        return [pipeline.estimate(estimator.frame_id)]
    except NoAnswerError:
        return []


def _leaking(
    samples: PairedSamples,
    blocks: BlockMeans,
    slope_known: tuple[Array, Array],
    log_odds: float,
    estimator: OnlineEstimator,
    method: str,
) -> tuple[PayloadSegment, ...]:
    """One segment whose estimate is that of its end: the wrench of what has left since is taken off."""
    slope, covariance = slope_known
    start, end = int(blocks.start[0]), int(blocks.end[-1])
    time = 2 * (samples.stamps - start) / max(end - start, 1) - 1
    gone = (model_matrix(samples.motion, estimator.gravity)[:, :, :4] @ slope) * (time - 1)[:, None]
    last = replace(samples, wrench=samples.wrench - gone)
    found = _weighed(last, estimator, method, (np.zeros(6), np.full(2, np.inf)), is_empty=False)
    widened = found.covariance.copy()
    widened[:4, :4] += covariance
    found = replace(found, covariance=widened)
    return (PayloadSegment(start, end, start, "leaking", log_odds, found, -2 * float(slope[0])),)


def _event(before: list[InertialEstimate], after: InertialEstimate) -> str:
    """What happened: grasped, released (the hand is as it was before a grasp, or empty), or spilled."""
    if after.parameters.mass > before[-1].parameters.mass:
        return "grasped"
    lighter = [each for each in before if each.parameters.mass < before[-1].parameters.mass]
    if _is_empty(after, before) or any(_same_mass(each, after) for each in lighter):
        return "released"
    return "spilled"


def _is_empty(estimate: InertialEstimate, others: list[InertialEstimate]) -> bool:
    """Nothing is held, in comparison with other segments."""
    heaviest = max(each.parameters.mass for each in others)
    least = max(min(_EMPTY_HAND, _EMPTY_SHARE * heaviest), _SURELY * estimate.mass_std)
    return bool(estimate.parameters.mass < least)


def _same_mass(one: InertialEstimate, other: InertialEstimate) -> bool:
    least = _EMPTY_HAND + _SAME_SHARE * one.parameters.mass
    deviation = float(np.hypot(one.mass_std, other.mass_std))
    return bool(abs(one.parameters.mass - other.parameters.mass) < max(least, _SURELY * deviation))


def _last_held(segments: tuple[PayloadSegment, ...]) -> PayloadSegment:
    """The last segment that neither a release began nor a grasp ended; the last of all when there is none."""
    events = [*(each.event for each in segments[1:]), ""]
    all_of_them = [each.estimate for each in segments]
    held = [
        each
        for each, then in zip(segments, events, strict=True)
        if each.event != "released" and then != "grasped" and not _is_empty(each.estimate, all_of_them)
    ]
    return held[-1] if held else segments[-1]


def _finding(segments: tuple[PayloadSegment, ...], chosen: PayloadSegment, first: int) -> EstimateFinding:
    """When the payload changed, and which one the answer is for."""
    if chosen.event == "leaking":
        end = chosen.estimate.parameters.mass
        return EstimateFinding(
            ErrorCode.PAYLOAD_CHANGED,
            f"the payload became lighter steadily, from {end + chosen.lost:.3f} to {end:.3f} kg; the answer is for the"
            " end of the recording: weigh it again when it has stopped",
            {"mass_before": end + chosen.lost, "mass_after": end, "log_odds": chosen.log_odds},
        )
    evidence: dict[str, float] = {"changes": len(segments) - 1.0}
    words = []
    for number, (before, after) in enumerate(pairwise(segments), 1):
        seconds, masses = (
            (after.since - first) * 1e-9,
            (before.estimate.parameters.mass, after.estimate.parameters.mass),
        )
        evidence |= {f"time_{number}": seconds, f"mass_before_{number}": masses[0], f"mass_after_{number}": masses[1]}
        evidence[f"log_odds_{number}"] = after.log_odds
        words.append(f"at {seconds:.1f} s from {masses[0]:.3f} to {masses[1]:.3f} kg ({after.event})")
    more = f" and {len(words) - _SHOWN} more times" if len(words) > _SHOWN else ""
    start, end = ((stamp - first) * 1e-9 for stamp in (chosen.start, chosen.end))
    return EstimateFinding(
        ErrorCode.PAYLOAD_CHANGED,
        f"the payload changed {', '.join(words[:_SHOWN])}{more}; the answer is for {start:.1f} to {end:.1f} s, the last"
        " time that an object was held; `segments` has the others",
        evidence,
    )
