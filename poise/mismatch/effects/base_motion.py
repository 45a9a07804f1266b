"""Base motion: for a while the base moves horizontally, and odometry does not report it."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_wrench import shaking, shaking_columns
from poise.mismatch.effects.starts import bursts, chained, smoothed
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

FEWEST_SPLINES, MAX_SPLINES = 10, 36
"""Number of splines of a speed: few for a single move, many for a base that keeps swaying."""
_FINEST = 0.4
"""s between the knots of a swaying motion."""
_CHAINED = 2.5
"""s between bursts of one motion: a swaying base stands still for a moment at every reversal."""
_MARGIN = 0.15
"""s by which a window may be wider than the burst that exceeds the noise."""
_STRONGEST, _FARTHEST = 2.0, 1.0
"""m/s2 and m: what a base that slips, sways or is pushed does at most; wheels lose their grip at about 0.2 g."""
_HIDDEN, _ROUNDED = 3.0, 10.0
"""Sigmas of the measured position up to which a displacement is an error of the measured motion; the second while the
reported acceleration of the base changes by at least half of what the event has. A spline through noisy positions
turns a jump of the acceleration into a slope, and halves a short one: the wrench shows what odometry does report."""
_CORNERS = 0.1
"""Speed, relative to the change of the reported one, that splines through odometry may lose where a ramp begins or
ends."""


class UnreportedBaseMotion(Effect):
    """The whole robot accelerates horizontally from rest to rest; the payload responds with its inertia.

    The base's velocity is a sum of cubic B-splines within the window: velocity and acceleration are zero at both ends
    and the jerk is limited.
    """

    name = "base_motion"
    layer = "event"
    equation = "dw = (-m a, -mc x a), a = R^T d/dt sum_k V_k B_k(t), V_k level; B_k: cubic B-splines in the window"
    source = "thesis eq. 2.97 with an acceleration that the kinematics lack; splines: de Boor 2001, chapter IX"
    excited_by = "nothing: it happens"
    separating_motion = "none needed with an imu on the base; without one, repeat the motion with the base braked"
    confused_with = ("hanging_chain", "contact", "external_vibration", "base_tilt")
    needs = ("load",)
    transfers = False
    free_course = True
    defaults: ClassVar[Values] = {"speed_": 0.0}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        first, last = float(recorded.seconds[0]), float(recorded.seconds[-1])
        when = (
            EffectParameter("start", "s", low=first - 1.0, high=last, linear=False),
            EffectParameter("length", "s", low=0.1, high=max(recorded.duration, 1.0), linear=False, log=True),
            EffectParameter(
                "splines", "", low=FEWEST_SPLINES, high=MAX_SPLINES, linear=False, choice=True, hidden=True
            ),
        )
        speeds = (EffectParameter(f"speed_{a}_{k}", "m/s", 0.2, hidden=True) for k in range(MAX_SPLINES) for a in "xy")
        return (*when, *speeds)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """Bursts of the horizontal acceleration that the residual force implies."""
        yield from self.moves(recorded, shaking(recorded, residual)[:, :2])

    def moves(self, recorded: RecordedMotion, level: Array) -> Iterable[Values]:
        """Windows and numbers of splines from a horizontal acceleration (N, 2) in the world."""
        calm = np.stack([smoothed(recorded, part, 0.1) for part in level.T], axis=1)
        found = list(bursts(recorded, calm, count=8))
        for begin, end in sorted({chained(found, found[0], _CHAINED), found[0]}) if found else ():
            length = min(end - begin + 2 * _MARGIN, 0.98 * max(recorded.duration, 1.0))
            for splines in sorted({FEWEST_SPLINES, min(max(round(length / _FINEST), FEWEST_SPLINES), MAX_SPLINES)}):
                yield {"start": begin - _MARGIN, "length": max(length, 0.2), "splines": float(splines)}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        rows, rates = self.rates(recorded.seconds, nonlinear)
        out = np.zeros((len(recorded), 6, 2 * MAX_SPLINES))
        level = shaking_columns(recorded)[rows, :, :2]
        waves = rates[:, None, :, None] * level[:, :, None, :]
        out[rows, :, : 2 * rates.shape[1]] = waves.reshape(len(rows), 6, 2 * rates.shape[1])
        return out

    def windows(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        del recorded
        return ((values["start"], values["start"] + values["length"]),)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        count, speed = int(values["splines"]), _speeds(values)
        acceleration = self.rates(recorded.seconds, values)[1] @ speed
        peak = float(np.linalg.norm(acceleration, axis=1).max(initial=0.0))
        # A cubic B-spline covers its coefficient times the interval between knots.
        path = np.cumsum(speed, axis=0) * values["length"] / (count + 3)
        farthest = float(np.linalg.norm(path, axis=1).max())
        return {"peak_acceleration": (peak, "m/s2"), "displacement": (farthest, "m")}

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        sizes = self.derived(recorded, values)
        acceleration, displacement = sizes["peak_acceleration"][0], sizes["displacement"][0]
        if acceleration > _STRONGEST:
            return f"the base would accelerate by {acceleration:.1f} m/s2"
        if displacement > _FARTHEST:
            return f"the base would move by {displacement:.2f} m"
        acceleration_change, speed_change = _reported_changes(recorded, values)
        changes = 0.5 * acceleration < acceleration_change
        speed = float(np.linalg.norm(_speeds(values), axis=1).max())
        if changes and speed < _CORNERS * speed_change:
            return (
                f"the base would move {1e3 * speed:.0f} mm/s faster, while its measured speed changes by ten times that"
            )
        if displacement < (_ROUNDED if changes else _HIDDEN) * recorded.place_noise:
            return f"the base would move by {1e3 * displacement:.1f} mm, which the noise of its measured position hides"
        return super().implausible(recorded, values)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        ((start, end),) = self.windows(recorded, values)
        sizes = self.derived(recorded, values)
        return (
            f"From {start:.1f} s to {end:.1f} s the base accelerated by up to {sizes['peak_acceleration'][0]:.2f} m/s2 "
            f"and moved by up to {sizes['displacement'][0]:.2f} m; odometry, and so the nominal model, does not report "
            "it."
        )

    @staticmethod
    def rates(seconds: Array, values: Values) -> tuple[NDArray[np.intp], Array]:
        """Samples (M,) within the window, and (n, K) d B_k / dt there, 1/s; B_k spans four of K + 3 intervals."""
        count = int(values["splines"])
        interval = values["length"] / (count + 3)
        place = (seconds - values["start"]) / interval
        rows = np.flatnonzero((place > 0.0) & (place < count + 3))
        x = place[rows, None] - np.arange(2, count + 2)
        size = np.abs(x)
        inner, outer = -2.0 * x + 1.5 * x * size, -np.sign(x) * (2.0 - np.minimum(size, 2.0)) ** 2 / 2.0
        return rows, np.where(size < 1.0, inner, outer) / interval


def _speeds(values: Values) -> Array:
    """(K, 2) m/s, the coefficients of the splines."""
    return np.array([[values[f"speed_{axis}_{k}"] for axis in "xy"] for k in range(int(values["splines"]))])


def _reported_changes(recorded: RecordedMotion, values: Values) -> tuple[float, float]:
    """m/s2 and m/s, by which the base's horizontal acceleration and velocity in odometry change during the event."""
    after = recorded.seconds - values["start"]
    during = (after > 0.0) & (after < values["length"])
    if recorded.base is None or not during.any():
        return 0.0, 0.0
    states = recorded.base.acceleration_in_world, recorded.base.velocity_in_world
    acceleration, velocity = (float(np.linalg.norm(np.ptp(state[during, :2], axis=0))) for state in states)
    return acceleration, velocity
