"""The verdict on a fit: tests of what an estimate leaves unexplained, and the uncertainty that follows from it.

An estimator weighs under assumptions: the axes, units and signs of the wrench, a constant bias, one payload, a sensor
that touches nothing else. Where one of them is false, the noise of the samples says nothing about the error. What
remains to judge by is the slow residual: averages over a tenth of a second contain little noise, and a correct model
leaves little of them. On recordings of a real arm (KUKA with an ATI Gamma) that is 1.6 to 2.2 % of the weight.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode
from poise.inertia.model import (
    EstimateFinding,
)
from poise.inertia.verdict.calibration import ShownCalibration, calibration_of
from poise.inertia.verdict.clipping import ExtremeReadings
from poise.inertia.verdict.samples import FitSamples
from poise.inertia.verdict.slow_residual import LEVER, PARTS, Extension, Fit, SlowResidual, sizes
from poise.types import Array

_LEAST_BINS = 20
"""Slow averages from which on a fit is judged."""

_MATERIAL, _SLACK = 0.04, np.array([0.06, 0.003])
"""Limit of the slow residual: this share of the load, and what sensors drift and creep by, N and N m."""

_TREND, _TREND_SLACK = 0.03, np.array([0.1, 0.005])
"""Limit of a linear drift over half of the recording: share of the load, and N and N m."""

_TILT, _WEIGHT, _LEVER_SHARE, _CERTAIN = 0.01, 0.05, 0.5, 5.0
"""Limits of the error of gravity relative to it, sideways and upwards, and of the first moment; a finding exceeds them
by this many standard deviations."""

_LEVER_CERTAIN = 8.0
"""Standard deviations of the first moment in the force: few fast turns show it, and eight blocks are few."""

_SHIFTED = 25.0
"""Squared standard deviations by which a drift or a tilt is seen and moves the answer, which then depends on it."""

_HOPELESS = 0.2
"""Share of the load from which on the numbers mean nothing."""

_REJECTED, _MOSTLY_REJECTED = 0.35, 0.6
"""Shares of rejected samples: a press, an arm that is shaken and jerky motion give up to 0.27."""

_ATTITUDE = 3e-4
"""rad: no arm knows the attitude of its wrist better; the parameters are at least this share of the load uncertain."""

_AT_LIMIT = 0.95
"""Share of the longest delay."""

_BEYOND_CHANCE = 8.0
"""Variance, in units of the stated one, that the scores of few blocks do not have by chance."""


_BLIND = (
    ("weight", 0.3, "a payload that the controller compensates, or a wrong gravity (accelerate the load)"),
    ("lever", 2.0, "a wrong sign of the torque (turn the load faster)"),
    ("lever", 0.775, "a force in lbf, or another wrong unit of force or torque alone (turn the load faster)"),
    ("tilt", 0.1, "a base that is not level (turn the load about more axes)"),
)
"""Tests, limits above which they see nothing, and what they would see."""


@dataclass(frozen=True)
class FitTest:
    """One test of a fit.

    Args:
        name: residual, halves or drift with _force or _torque; lever; tilt; weight; rejected; calibration; delay;
            clipped.
        value, limit, hopeless: it passes up to the limit; from `hopeless` on the estimate means nothing.
        sentence: what was measured, with its numbers.
    """

    name: str
    value: float
    limit: float
    hopeless: float
    sentence: str

    @property
    def passed(self) -> bool:
        """The value keeps its limit."""
        return not self.value > self.limit


@dataclass(frozen=True, eq=False)
class FitVerdict:
    """What the tests say of a fit.

    Args:
        tests: those that the samples allowed.
        covariance: (10, 10) of phi with the errors that the blocks of the recording show, and, where a test failed,
            with what stays unexplained; None: as it was.
    """

    tests: tuple[FitTest, ...] = ()
    covariance: Array | None = None

    @property
    def failed(self) -> tuple[FitTest, ...]:
        """The tests that did not pass, the worst first."""
        return tuple(
            sorted(
                (test for test in self.tests if not test.passed), key=lambda test: -test.value / max(test.limit, 1e-9)
            )
        )

    @property
    def passed(self) -> bool:
        """All tests passed."""
        return not self.failed

    @property
    def is_hopeless(self) -> bool:
        """The numbers of the estimate mean nothing: withhold them."""
        return any(test.value > test.hopeless for test in self.tests)

    @property
    def cannot_exclude(self) -> tuple[str, ...]:
        """What would stay unnoticed, because the motion shows too little of it."""
        if not self.tests:
            return ("anything, because the samples are too few to judge a fit",)
        limits = {test.name: test.limit for test in self.tests}
        return tuple(words for name, most, words in _BLIND if limits[name] > most)

    @property
    def finding(self) -> EstimateFinding | None:
        """POOR_FIT with the evidence, where a test failed."""
        if self.passed:
            return None
        sentences = "; ".join(test.sentence for test in self.failed)
        what = "the numbers mean nothing" if self.is_hopeless else "the uncertainty is wider by what is not explained"
        return EstimateFinding(
            ErrorCode.POOR_FIT,
            f"no single payload explains the wrench: {sentences}; {what}: check the frame, units and signs of the"
            " wrench, contact, drift and the clocks",
            {test.name: test.value for test in self.failed},
        )


def judge(fit: Fit, samples: FitSamples, extremes: ExtremeReadings | None = None) -> FitVerdict:
    """Test a fit on its samples, and on the extreme readings."""
    used = samples.outside(fit.rejected)
    slow = SlowResidual(fit, samples, used)
    if len(slow.samples) < _LEAST_BINS:
        return FitVerdict()
    share = 1.0 - float(samples.counts[used].sum() / samples.counts.sum())
    calibration = calibration_of(slow)
    tests = [*_load_tests(slow), *_gravity_tests(slow, samples.gravity), _rejected_test(share, fit.only_contact)]
    tests.append(_calibration_test(calibration))
    if np.isfinite(fit.delay) and fit.longest_delay > 0:
        tests.append(_delay_test(fit))
    if extremes is not None:
        tests.append(_clipped_test(extremes))
    failed = [test for test in tests if not test.passed]
    widened = _widened(fit, slow)
    if widened is not None:
        widened = widened + _of_share(fit, max(_unexplained(slow, failed), _ATTITUDE)) + calibration.covariance
    return FitVerdict(tuple(tests), widened)


def _unexplained(slow: SlowResidual, failed: Sequence[FitTest]) -> float:
    """Share of the load that stays unexplained; 0 where no test failed."""
    scale = dict(zip(("force", "torque"), slow.scale, strict=True))
    shares = [test.value / max(scale[kind], 1e-9) for test in failed if (kind := test.name.rpartition("_")[2]) in scale]
    shares += [test.value for test in failed if test.name in ("tilt", "weight", "lever", "clipped")]
    return min(max(shares, default=0.0), 1.0)


def _of_share(fit: Fit, share: float) -> Array:
    """(10, 10) covariance of parameters that are off by a share of the load."""
    phi = np.nan_to_num(fit.phi)
    mass = abs(phi[0])
    reach = max(float(np.linalg.norm(phi[1:4])) / mass, LEVER) if mass else LEVER
    units = mass * np.array([1.0] + [reach] * 3 + [reach**2] * 6)
    inertia = float(np.abs(phi[[4, 7, 9]]).sum())
    units[4:] = np.maximum(units[4:], inertia)
    result = np.diag(np.square(share * units))
    result[np.isnan(fit.covariance)] = np.nan
    return result


_RESIDUAL = "averages over 0.1 s differ from the payload's wrench by {:.3g} {} rms"
_HALVES = "the payloads of the two halves of the samples differ by {:.3g} {} rms"
_DRIFT = "the residual drifts by {:.3g} {} in half of the time"


def _load_tests(slow: SlowResidual) -> list[FitTest]:
    """Of the residual, of its two halves against each other, and of a drift."""
    scale, white = slow.scale, slow.white
    limits, hopeless = _MATERIAL * scale + _SLACK, _HOPELESS * scale + 2 * _SLACK
    drift = sizes(slow.drift.values[None])
    few = np.sqrt(16.0 / len(slow.samples)) * white  # noise of an answer in the prediction
    checks = (
        ("residual", sizes(slow.residual), limits + 3 * white, hopeless + 6 * white, _RESIDUAL),
        ("halves", slow.halves(), limits + 6 * few, hopeless + 12 * few, _HALVES),
        ("drift", drift, _TREND * scale + _TREND_SLACK + 6 * few, np.full(2, np.inf), _DRIFT),
    )
    found = []
    for name, values, limit, most, words in checks:
        for which, (kind, unit) in enumerate((("force", "N"), ("torque", "N m"))):
            value, size = float(values[which]), float(scale[which])
            sentence = f"{words.format(value, unit)}, {value / max(size, 1e-9):.0%} of the load's {size:.3g} {unit}"
            found.append(FitTest(f"{name}_{kind}", value, float(limit[which]), float(most[which]), sentence))
    return found


def _gravity_tests(slow: SlowResidual, gravity: Array) -> list[FitTest]:
    """Of the direction of gravity, and of the weight against the inertial forces."""
    size = float(np.linalg.norm(gravity))
    tilts, doubts = np.abs(slow.tilt.values) / size, _CERTAIN * slow.tilt.deviations / size
    clearest = int(np.argmax(tilts - doubts))
    tilt, least_tilt = float(tilts[clearest]), _TILT + float(doubts[clearest])
    weight = float(abs(slow.weight.values[0])) / size
    least_weight = _WEIGHT + _CERTAIN * float(slow.weight.deviations[0]) / size
    words = f"the weight points {np.degrees(np.arctan(tilt)):.1f} degrees off gravity"
    return [
        _lever_test(slow),
        FitTest("tilt", tilt, least_tilt, np.inf, words),
        FitTest("weight", weight, least_weight, np.inf, f"weight and inertial forces differ by {weight:.0%}"),
    ]


def _widened(fit: Fit, slow: SlowResidual) -> Array | None:
    """(10, 10) covariance of phi, not less than the scatter of the scores of the blocks shows (sandwich estimator).

    Errors that last (drift, a payload that changes, contact) do not average out as noise does. They show in how the
    blocks of a recording pull the answer to different sides (White 1980; Zeileis 2004).
    """
    seen = np.isfinite(np.diag(fit.covariance))
    bias = np.isfinite(fit.bias)
    if not seen.any():
        return None
    information, scores = slow.blocks(PARTS)
    rest = np.flatnonzero(np.append(np.zeros(10, dtype=bool), bias))
    total = information.sum(axis=0)
    on_bias = np.linalg.lstsq(total[np.ix_(rest, rest)], total[rest][:, :10], rcond=1e-12)[0]
    pulls = (scores[:, :10] - scores[:, rest] @ on_bias)[:, seen]
    shown = (total[:10, :10] - total[:10, rest] @ on_bias)[np.ix_(seen, seen)]
    pulls -= pulls.mean(axis=0)
    root = np.linalg.cholesky(_regular(fit.covariance[np.ix_(seen, seen)]))
    values, axes = np.linalg.eigh(root.T @ shown @ root)
    # In units of the stated covariance: how far each block alone pulls the answer.
    steps = (pulls @ root @ axes) / np.maximum(values, 1.0)
    scatter = axes @ (steps.T @ steps) @ axes.T * PARTS / (PARTS - 1)
    variances, directions = np.linalg.eigh(scatter)
    factors = np.where(variances > _BEYOND_CHANCE, variances, 1.0)
    inside = root @ directions
    widened = (inside * factors) @ inside.T
    for extension in (slow.drift, slow.tilt):
        shift = extension.shift[seen]
        is_seen = np.sum((extension.values / np.maximum(extension.deviations, 1e-12)) ** 2) > _SHIFTED
        if is_seen and np.sum(np.linalg.solve(root, shift) ** 2) > _SHIFTED:
            widened += np.outer(shift, shift)
    if slow.filtered is not None:
        widened += _of_filter(slow.filtered)[np.ix_(seen, seen)]
    result = fit.covariance.copy()
    result[np.ix_(seen, seen)] = widened
    return result


def _of_filter(found: Extension) -> Array:
    """(10, 10) covariance of phi, because the wrench may be late by a filter, which attenuates it, or by its clock."""
    value, spread = float(found.values[0]), float(found.deviations[0])
    squares = 1.0 + (spread / value) ** 2 if value else 1.0
    return np.asarray(squares * np.outer(found.shift, found.shift))


def _regular(covariance: Array) -> Array:
    """The same covariance, positive definite beyond rounding."""
    scale = np.sqrt(np.diag(covariance).clip(min=1e-30))
    return np.asarray(covariance + np.diag(1e-10 * scale**2))


def _lever_test(slow: SlowResidual) -> FitTest:
    """Of the first moment in the force (by rotation) against that in the torque (by weight)."""
    moment = slow.unknowns[1:4]
    size = max(float(np.linalg.norm(moment)), 1e-6)
    along = moment / size
    error = float(abs(slow.lever.values @ along)) / size
    doubt = float(np.sqrt(np.square(slow.lever.deviations) @ np.square(along))) / size
    words = f"force and torque show centres of mass that differ by {error:.0%}"
    return FitTest("lever", error, _LEVER_SHARE + _LEVER_CERTAIN * doubt, np.inf, words)


def _calibration_test(found: ShownCalibration) -> FitTest:
    value, limit = found.worst
    return FitTest("calibration", value, limit, np.inf, found.words)


def _clipped_test(extremes: ExtremeReadings) -> FitTest:
    found = extremes.clipped
    if found is None:
        return FitTest("clipped", 0.0, 0.0, np.inf, "no reading stops at one value")
    channel, value, share = found
    name, unit = ("fx", "fy", "fz", "tx", "ty", "tz")[channel], "N" if channel < 3 else "N m"
    return FitTest(
        "clipped", share, 0.0, np.inf, f"{share:.1%} of the readings of {name} are exactly {value:.6g} {unit}"
    )


def _rejected_test(share: float, only_contact: bool) -> FitTest:
    sentence = f"{share:.0%} of the samples were rejected because no payload explains them"
    return FitTest("rejected", share, _REJECTED, np.inf if only_contact else _MOSTLY_REJECTED, sentence)


def _delay_test(fit: Fit) -> FitTest:
    value, limit = abs(fit.delay), _AT_LIMIT * fit.longest_delay
    sentence = f"the delay of the wrench, {1e3 * fit.delay:.0f} ms, is at the limit of its search"
    return FitTest("delay", value, limit, np.inf, sentence)
