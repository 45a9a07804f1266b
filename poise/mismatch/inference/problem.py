"""One signal of one recording with its noise model: the basis of every hypothesis."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from poise.kernels import COMPILED
from poise.mismatch.effects import LAYERS, Effect, Values, limited_readings, within
from poise.mismatch.inference.calibration import NORMAL_PRECISION, CalibrationGroup, calibration, effort_calibration
from poise.mismatch.inference.evidence import WhitenedRegression
from poise.mismatch.inference.noise import SignalNoise, fit_noise
from poise.mismatch.inference.reversals import friction_known
from poise.mismatch.reading import NominalModel
from poise.mismatch.recorded import WRENCH_CHANNELS, RecordedMotion, rounding, wrench_rounding
from poise.types import Array, Mask

_BREAK = 2.0
"""s without a sample that separate two recordings."""
_GAP, _GAP_PERIODS, _AFTER_GAP = 0.05, 4.0, 0.15
"""s and periods without a sample, both, that make a gap, and s after it that are predicted, but not compared: across a
gap, filters know their input only by interpolation."""
_RUN_UP, _RUN_OUT = 0.4, 0.1
"""s at the start and the end of a recording that are predicted, but not compared."""
_FEWEST_FREE = 100
"""Readings within the sensor's range that show the noise of a channel."""
_LEAST_SETTLED = 0.5
"""Share of the samples outside the knocks of a part below which these fill its response, and count."""
BRIEF, _BESIDE = 0.3, 0.2
"""Share of a recording within which an event is brief; s on its sides that are left out with it."""
_BEST_MODEL = 0.002
"""Share of a channel's standard deviation below which no model predicts it."""
_CURVES = 3
"""Free curves of which a problem keeps the whitened columns."""


@dataclass(frozen=True, eq=False)
class FittedEffect:
    """An effect with values for its parameters; a hypothesis is a set of them."""

    effect: Effect
    values: Values

    @property
    def order(self) -> tuple[int, int, str]:
        """Sort key: the sequence in which the parts of a hypothesis act."""
        return LAYERS.index(self.effect.layer), self.effect.order, self.effect.name

    def carried(self, recorded: RecordedMotion) -> "FittedEffect":
        """The part in a longer recording or one at another rate, where a free curve has other knots."""
        values = {p.name: self.values.get(p.name, 0.0) for p in self.effect.parameters(recorded)}
        return replace(self, values=values)


@dataclass(frozen=True, eq=False)
class SampleBlocks:
    """Samples that are averaged before comparison: (M, b) rows of each block, and the noise of the averages."""

    rows: NDArray[np.intp]
    noise: SignalNoise

    def means(self, values: Array) -> Array:
        """(M, ...) of values (N, ...); the rows of a block are consecutive."""
        first, length = int(self.rows[0, 0]), self.rows.shape[1]
        count = (int(self.rows[-1, -1]) + 1 - first) // length
        whole = values[first : first + count * length].reshape(count, length, *values.shape[1:]).sum(axis=1)
        if count != len(self.rows):
            whole = whole[(self.rows[:, 0] - first) // length]
        return np.asarray(whole / length)

    def middle(self, count: int) -> Mask:
        """(N,) of `count` samples those in the middle of a block."""
        mask = np.zeros(count, dtype=bool)
        mask[self.rows[:, self.rows.shape[1] // 2]] = True
        return mask


@dataclass(frozen=True, eq=False)
class Problem:
    """A signal with its noise.

    Args:
        recorded: the recording; its predictions are the nominal model's.
        model: tolerances and stated noise.
        noise: of the signal.
        signal: wrench or effort.
        judged: (N,) samples that count, apart from the ends, which never do; None: all.
        blocks: averaged samples; None: each sample counts by itself.
        band: (C,) share of independent samples, one for all noise models, so that their likelihoods are comparable.
        widened: calibration groups that exceed their tolerances, as another signal shows.
        straight: the drift of the sensor has no curvature: a fit is compared with samples after those that it has seen.
        limited: (N, C) readings at the end of the sensor's range, which say only that the load is no smaller, or of
            stuck joints, see `EffortTrack`. None: no reading is.
    """

    recorded: RecordedMotion
    model: NominalModel
    noise: SignalNoise
    signal: Literal["wrench", "effort"] = "wrench"
    judged: Mask | None = None
    blocks: SampleBlocks | None = None
    band: Array | None = None
    widened: frozenset[str] = frozenset()
    straight: bool = False
    limited: Mask | None = None
    _white: dict[int, tuple[CalibrationGroup, Array]] = field(default_factory=dict, init=False, repr=False)
    _curves: list[tuple[Array, Array]] = field(default_factory=list, init=False, repr=False)
    _made: list[tuple[RecordedMotion, tuple[CalibrationGroup, ...]]] = field(
        default_factory=list, init=False, repr=False
    )

    @cached_property
    def measured(self) -> Array:
        """(N, C)."""
        recorded = self.recorded
        return recorded.wrench if recorded.effort is None or self.signal == "wrench" else recorded.effort.measured

    @property
    def channels(self) -> tuple[str, ...]:
        """(C,) names: those of the wrench, or of the joints."""
        effort = None if self.signal == "wrench" else self.recorded.effort
        return WRENCH_CHANNELS if effort is None else effort.names

    @cached_property
    def active(self) -> Mask:
        """(N,) samples that count: at both ends filters and shifts would need samples beyond."""
        at = self.seconds
        begun = np.concatenate([[0], np.flatnonzero(np.diff(at) > _BREAK) + 1])
        first = at[begun][np.searchsorted(begun, np.arange(len(at)), side="right") - 1]
        inner = np.asarray((at >= first + _RUN_UP) & (at <= at[-1] - _RUN_OUT))
        step = np.diff(at)
        ends = np.flatnonzero(step > max(_GAP, _GAP_PERIODS * float(np.median(step)))) + 1
        if len(ends):
            last = np.concatenate([[-np.inf], at[ends]])[np.searchsorted(ends, np.arange(len(at)), side="right")]
            inner &= at >= last + _AFTER_GAP
        return inner if self.judged is None else inner & self.judged

    @cached_property
    def _counting(self) -> Mask:
        """Which of the samples, or of their blocks, count."""
        return self.active if self.blocks is None else np.asarray(self.active[self.blocks.rows].all(axis=1))

    @cached_property
    def _rows(self) -> slice | NDArray[np.intp]:
        """Their indices, as a slice when they are contiguous."""
        index = np.flatnonzero(self._counting)
        in_a_row = len(index) == index[-1] - index[0] + 1
        return slice(int(index[0]), int(index[-1]) + 1) if in_a_row else index

    @property
    def _judging(self) -> SignalNoise:
        return self.noise if self.blocks is None else self.blocks.noise

    @cached_property
    def log_scale(self) -> float:
        """log of the divisors of the whitening, see `SignalNoise.log_divisor`."""
        return float(np.sum((self._judging.log_divisor * self._averaged(self.free))[self._counting]))

    @cached_property
    def free(self) -> Array:
        """(N, C) 1 where a reading follows the load, 0 where it is limited."""
        return np.ones(self.measured.shape) if self.limited is None else np.asarray(~self.limited, dtype=np.float64)

    @cached_property
    def seconds(self) -> Array:
        """(N,)."""
        return self.noise.seconds

    def predicted(self, recorded: RecordedMotion) -> Array:
        """(N, C) the prediction of the signal."""
        return recorded.prediction if recorded.effort is None or self.signal == "wrench" else recorded.effort.prediction

    def with_prediction(self, recorded: RecordedMotion, prediction: Array, later: float = 0.0) -> RecordedMotion:
        """The recording with another prediction (N, C) of the signal, `later` (s) than the present one."""
        if self.signal == "wrench":
            return recorded.with_prediction(prediction, later)
        return recorded.with_effort(prediction)

    def compose(self, parts: Sequence[FittedEffect]) -> tuple[list[RecordedMotion], RecordedMotion]:
        """The recording that each part acts on, in the order given, and the recording after all of them."""
        recorded = self.recorded
        before: dict[int, RecordedMotion] = {}
        for index, part in sorted(enumerate(parts), key=lambda item: item[1].order):
            before[index] = recorded
            predicted = self.predicted(recorded) + part.effect.simulate(recorded, part.values)
            later = part.values[part.effect.delay] if part.effect.delay else 0.0
            recorded = self.with_prediction(recorded, predicted, later)
        return [before[index] for index in range(len(parts))], recorded

    def settled(self, parts: Sequence[FittedEffect]) -> Mask:
        """(N,) samples outside the knocks of each part whose response they do not fill."""
        keep = np.ones(len(self.seconds), dtype=bool)
        for part, recorded in zip(parts, self.compose(parts)[0], strict=True):
            outside = ~within(self.seconds, part.effect.unsettled(recorded, part.values))
            keep &= outside | (outside.mean() < _LEAST_SETTLED)
        return keep

    def calm(self, parts: Sequence[FittedEffect]) -> "Problem":
        """Without the windows of brief events and of knocks: residuals there are their details."""
        keep = self.settled(parts)
        for part, recorded in zip(parts, self.compose(parts)[0], strict=True):
            windows = () if part.effect.transfers else part.effect.windows(recorded, part.values)
            brief = [(begin, end) for begin, end in windows if end - begin < BRIEF * recorded.duration]
            keep &= ~within(self.seconds, brief, _BESIDE)
        return self if keep.all() else replace(self, judged=keep if self.judged is None else keep & self.judged)

    def groups(self, recorded: RecordedMotion, parts: Sequence[FittedEffect] = ()) -> tuple[CalibrationGroup, ...]:
        """The calibration errors about a prediction, without those whose tolerance a part exceeds."""
        without = {"curved_drift"} if self.straight else set[str]()
        without = without.union(*(part.effect.exceeds(part.values) for part in parts))
        if not self._made or self._made[0][0] is not recorded:
            make = calibration if self.signal == "wrench" else effort_calibration
            made = make(recorded, self.model.tolerance)
            made = tuple(group.widened if group.name in self.widened else group for group in made)
            self._made[:] = [(recorded, made)]
        return tuple(group for group in self._made[0][1] if group.name not in without)

    def regression(
        self, parts: Sequence[FittedEffect] = (), recorded: RecordedMotion | None = None
    ) -> WhitenedRegression:
        """Whitened residual of these parts, with the calibration columns about their prediction."""
        recorded = self.compose(parts)[1] if recorded is None else recorded
        groups = self.groups(recorded, parts)
        white = np.concatenate([self._whitened(group) for group in groups if group.seen.any()])
        keep = np.concatenate([group.seen for group in groups])
        bound = np.concatenate([group.bounds for group in groups])[keep]
        precision = np.where(np.isfinite(bound), 3.0 / bound**2, NORMAL_PRECISION)
        target = self.whiten(self.measured - self.predicted(recorded))
        channel = np.concatenate([group.alone for group in groups])[keep]
        rest = np.zeros(len(bound)), target, bound
        return WhitenedRegression((white,), precision, *rest, channel=channel, channels=self.measured.shape[1])

    def _whitened(self, group: CalibrationGroup) -> Array:
        """(k, R) columns of the errors that have a response; groups of the motion alone are kept."""
        known = self._white.get(id(group))
        if known is not None:
            return known[1]
        channel = None if group.channel is None else group.channel[group.seen]
        white = self._white_of(group.values[..., group.seen], channel)
        if group.lasting:
            self._white[id(group)] = group, white
        return white

    def whiten(self, values: Array) -> Array:
        """(N, C) -> (R,); (N, C, k) -> (k, R), R = C times the samples (or blocks) that count; N samples or blocks."""
        wide = values if values.ndim == 3 else values[:, :, None]
        kept = self._white_of(wide)
        return kept[0] if values.ndim == 2 else kept

    def whitened_curve(self, columns: Array) -> Array:
        """`whiten` of an array (N, C, k) that is the same object in each model, as the columns of free curves are."""
        for known, white in self._curves:
            if known is columns:
                return white
        white = self.whiten(columns)
        self._curves[:] = [*self._curves[1 - _CURVES :], (columns, white)]
        return white

    def _white_of(self, values: Array, channel: NDArray[np.intp] | None = None) -> Array:
        """(k, R) of values (N, C, k), or (N, k) that act in one channel each; limited readings do not count."""
        if self.limited is not None and len(values) == len(self.free):
            values = values * (self.free[:, :, None] if channel is None else self.free[:, channel])
        if not COMPILED:
            return self._kept(self._judging.whiten(self._averaged(values), channel))
        whole = self.blocks is None or len(values) == len(self.blocks.rows)
        rows = None if whole or self.blocks is None else self.blocks.rows
        return self._judging.compiled(values, self._counting, rows, channel)

    def _averaged(self, values: Array) -> Array:
        """(M, ...) means over the blocks of values (N, ...); values of blocks, or without blocks, as they are."""
        return values if self.blocks is None or len(values) == len(self.blocks.rows) else self.blocks.means(values)

    def _kept(self, white: Array) -> Array:
        """(k, C, M) -> (k, R)."""
        return white[:, :, self._rows].reshape(len(white), -1)

    def calibrated(self, groups: Sequence[CalibrationGroup], coefficients: Array) -> Array:
        """(N, C) response of calibration errors, in the signal's units, for the coefficients of `regression`."""
        total, taken = np.zeros(self.measured.shape), 0
        for group in groups:
            each = np.zeros(len(group.seen))
            count = int(group.seen.sum())
            each[group.seen] = coefficients[taken : taken + count]
            total += group.response(each)
            taken += count
        return total

    def of(self, recorded: RecordedMotion) -> "Problem":
        """The same signal of another recording, with its own noise."""
        return _begun(recorded, self.model, self.signal, self.widened)

    def with_noise(self, noise: SignalNoise) -> "Problem":
        """The problem with another noise model."""
        return replace(self, noise=noise)

    def unexplained(self, prediction: Array) -> Array:
        """(N, C) measured less a prediction of the signal (N, C); none where a limited reading explains it."""
        left = self.measured - prediction
        if self.limited is None:
            return left
        return np.where(self.limited & ((left * self.measured < 0.0) | (self.signal == "effort")), 0.0, left)

    def left_by(self, prediction: Array) -> Array:
        """(N, C) as `unexplained`, but with what the friction of stuck joints carries: an error of a prediction."""
        return self.measured - prediction if self.signal == "effort" else self.unexplained(prediction)

    @property
    def weight(self) -> Array:
        """(N, C) of a reading in the comparison of errors: 0 of stuck joints."""
        return self.free if self.signal == "effort" else np.ones(self.measured.shape)

    def weighed(self) -> "Problem":
        """The signal as its parameters are estimated: joint efforts by plain least squares in time.

        What a model of an arm leaves are errors of the model, which no noise model describes; whitening would weigh
        them by their spectrum, and friction is then taken from the reversals alone.
        """
        return self if self.signal == "wrench" else self.with_noise(self.noise.uncoloured())

    def fitted_noise(self, residual: Array) -> SignalNoise:
        """The most likely noise for a residual (N, C)."""
        return signal_noise(self.recorded, self.model, self.signal, residual, self.active, self.band, self.limited)


def wrench_problem(recorded: RecordedMotion, model: NominalModel) -> Problem:
    """The wrench against the nominal model; its noise from a first fit of the calibration."""
    return _begun(recorded, model, "wrench")


def effort_problem(recorded: RecordedMotion, model: NominalModel, widened: frozenset[str] = frozenset()) -> Problem:
    """Joint efforts against the rigid arm; `widened`: see `Problem`."""
    return _begun(recorded, model, "effort", widened)


def _begun(
    recorded: RecordedMotion,
    model: NominalModel,
    signal: Literal["wrench", "effort"],
    widened: frozenset[str] = frozenset(),
) -> Problem:
    if signal == "effort" and recorded.effort is not None and friction_known(recorded.effort):
        recorded = replace(recorded)  # its reversals are those of this prediction: the recording may have had another
    saturation = model.effect("saturation")
    stated = None if saturation is None else saturation.values
    stuck = None if recorded.effort is None else recorded.effort.stuck
    limited = limited_readings(recorded, stated) if signal == "wrench" else stuck
    noise = signal_noise(recorded, model, signal, None, limited=limited)
    rough = Problem(recorded, model, noise, signal, widened=widened, limited=limited)
    groups = rough.groups(recorded)
    fitted = rough.calibrated(groups, rough.regression().coefficients())
    noise = rough.fitted_noise(rough.unexplained(rough.predicted(recorded) + fitted))
    return replace(rough, noise=noise, band=noise.band)


def signal_noise(
    recorded: RecordedMotion,
    model: NominalModel,
    signal: Literal["wrench", "effort"],
    residual: Array | None,
    active: Mask | None = None,
    band: Array | None = None,
    limited: Mask | None = None,
) -> SignalNoise:
    """Noise of a signal: white of the measured level when `residual` is None, else the most likely noise model."""
    if signal == "wrench" or recorded.effort is None:
        seconds, speed, motion = recorded.seconds, recorded.speed, recorded.motion_variance
        measured, expected = recorded.wrench, recorded.prediction
        # Rounding is noise as well, even where readings are constant.
        stated = np.repeat([0.5 * (given or 0.0) for given in (model.noise_force, model.noise_torque)], 3)
        least = np.maximum(stated, wrench_rounding(measured))
    else:
        track = recorded.effort
        seconds, speed, motion = track.seconds, np.linalg.norm(track.velocity, axis=1), track.motion_variance
        measured, expected = track.measured, track.prediction
        least = np.array([rounding(column) for column in measured.T])
    least = np.maximum(least, _BEST_MODEL * measured.std(axis=0) + 1e-9)
    coarse = signal == "wrench"  # motor currents are finely resolved, and gears knock
    white = residual is None
    values = measured - expected if residual is None else residual
    kept = np.ones(len(values), dtype=bool) if active is None or white else active

    def of(rows: Mask, channels: slice) -> SignalNoise:
        moved = None if motion is None else motion[rows, channels]
        known = None if band is None else band[channels]
        at = values[rows, channels]
        return fit_noise(
            seconds[rows], speed[rows], at, least[channels], motion=moved, band=known, white=white, coarse=coarse
        )

    found = of(kept, slice(None))
    if limited is not None:
        # Readings at the end of the range have no noise.
        for c in np.flatnonzero(limited.any(axis=0)).tolist():
            rows = kept & ~limited[:, c]
            if rows.sum() >= _FEWEST_FREE:
                found = found.with_channel(c, of(rows, slice(c, c + 1)))
    return replace(found, seconds=seconds, speed=speed, motion=motion)
