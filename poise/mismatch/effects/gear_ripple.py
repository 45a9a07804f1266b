"""Gear ripple: a joint's torque oscillates with its position, as teeth or wave generators mesh."""

from collections.abc import Iterable

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.joint_friction import column_of, efforts, joint_called, numbers, slides, torque_sizes
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_HIGHEST = 250.0
"""Waves per revolution that are tried."""
_LEAST_SPAN = 0.05
"""rad or m that a joint has to travel."""
_SHOWN = 1e-4
"""Determinant of a wave's information, per sample, below which the places where a joint stops do not show it."""
_FEW = np.linspace(1.0, 2.0, 9)
"""Waves in the range travelled that are compared with a cubic: both have four parameters."""
_MANY = 3.0
"""Waves in the range travelled from which a sine is no piece of another curve over the position."""


class GearRipple(Effect):
    """tau_j = A sin(n q_j + phase) of one joint."""

    name = "gear_ripple"
    layer = "friction"
    signal = "effort"
    equation = "dtau_j = amplitude sin(order q_j + phase) = sine sin(order q_j) + cosine cos(order q_j)"
    source = "torque ripple of harmonic drives (Taghirad and Belanger 1998)"
    excited_by = "a joint that travels over several waves"
    separating_motion = "the same stroke at two speeds: a ripple stays in the joint's position, a vibration in time"
    confused_with = ("external_vibration", "coulomb_friction")
    needs = ("effort",)

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        if recorded.effort is None:
            return ()
        count, size = float(max(numbers(recorded))), float(np.median(torque_sizes(recorded)))
        return (
            EffectParameter("joint", "", low=1.0, high=count, linear=False, choice=True),
            EffectParameter("order", "", low=1.0, high=1.2 * _HIGHEST, linear=False, log=True),
            EffectParameter("sine", "N m", size, hidden=True),
            EffectParameter("cosine", "N m", size, hidden=True),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The highest peaks of the residuals' spectra over position, joint by joint."""
        track = efforts(recorded)
        peaks = []
        for column, number in enumerate(numbers(recorded)):
            position, left = track.position[:, column], residual[:, column]
            orders, power = np.hstack([_few_waves(position, left), _spectrum(position, left)])
            if len(orders):
                best = int(np.argmax(power))
                peaks.append((float(power[best]), float(orders[best]), float(number)))
        for _, order, joint in sorted(peaks, reverse=True)[:2]:
            yield {"joint": joint, "order": order}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        track, column = efforts(recorded), column_of(recorded, nonlinear["joint"])
        turn = nonlinear["order"] * track.position[:, column]
        out = np.zeros((*track.position.shape, 2))
        out[:, column, 0], out[:, column, 1] = np.sin(turn), np.cos(turn)
        return out

    def imitated(self, recorded: RecordedMotion, values: Values) -> str:
        """A few waves follow any curve over the position, as of a cable, a spring or a limit of the torque."""
        span = float(np.ptp(efforts(recorded).position[:, column_of(recorded, values["joint"])]))
        return "joint_position" if values["order"] * span < _MANY * 2.0 * np.pi else ""

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        del recorded
        sine, cosine = values["sine"], values["cosine"]
        return {
            "amplitude": (float(np.hypot(sine, cosine)), "N m"),
            "phase": (float(np.arctan2(cosine, sine)), "rad"),
        }

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        joint, order = joint_called(recorded, values["joint"]), values["order"]
        amplitude = self.derived(recorded, values)["amplitude"][0]
        if slides(recorded, values["joint"]):
            size = f"force of {joint} oscillates {order / (2.0 * np.pi):.1f} times per metre by {amplitude:.2f} N"
        else:
            size = f"torque of {joint} oscillates {order:.1f} times per revolution by {amplitude:.2f} N m"
        return f"The {size}: the nominal gear runs smoothly."


def _few_waves(position: Array, residual: Array) -> Array:
    """(2, k) orders of one to two waves in the range travelled; their power, as below, beyond that of a cubic."""
    span = float(np.ptp(position))
    if span < _LEAST_SPAN:
        return np.zeros((2, 0))
    place = (position - position.min()) / span
    turns = 2.0 * np.pi * _FEW[:, None] * place
    line, cubic = (np.vander(place, count) for count in (2, 4))
    waves = [np.column_stack([line, np.sin(turn), np.cos(turn)]) for turn in turns]
    smooth, *left = (_unexplained(columns, residual) for columns in (cubic, *waves))
    power = 0.5 * len(residual) * np.maximum(1.0 - np.array(left) / max(smooth, 1e-12), 0.0)
    return np.array([2.0 * np.pi / span * _FEW, power])


def _unexplained(columns: Array, residual: Array) -> float:
    """Sum of squares that least squares leave."""
    rest = residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
    return float(rest @ rest)


def _spectrum(position: Array, residual: Array) -> Array:
    """(2, k) orders (waves per revolution, 1/rad) of two waves or more in the range; their power over the noise.

    Of a wave beside a cubic, at uneven positions: a joint that stops at few places spends most samples there
    (Zechmeister and Kuerster 2009, "The generalised Lomb-Scargle periodogram").
    """
    span = float(np.ptp(position))
    if span < _LEAST_SPAN:
        return np.zeros((2, 0))
    # Sums over narrow bins of position; their Fourier transforms are those over the positions.
    count = int(np.ceil(span * _HIGHEST * 8.0 / (2.0 * np.pi))) + 1
    place = np.minimum((position - position.min()) / span * count, count - 1).astype(int)
    weight = np.bincount(place, minlength=count).astype(float)
    root = np.sqrt(weight)
    cubic = np.linalg.qr(root[:, None] * np.vander(np.linspace(-1.0, 1.0, count), 4))[0]
    sums = np.bincount(place, weights=residual, minlength=count)
    smooth = cubic.T @ (sums / np.maximum(root, 1.0))
    rest = sums - root * (cubic @ smooth)
    size = 4 * count
    order = np.asarray(2.0 * np.pi * np.arange(2 * count + 1) * count / (size * span))
    kept = np.flatnonzero((order > 2.0 * 2.0 * np.pi / span) & (order < _HIGHEST))
    wave = np.fft.fft(np.column_stack([rest, root[:, None] * cubic, weight]), size, axis=0)
    parts = np.stack([wave.real, -wave.imag])[:, kept]
    double = wave[2 * kept % size, -1]
    (cosine, sine), of_cubic = parts[:, :, 0], parts[:, :, 1:-1]
    taken = np.einsum("ank,bnk->abn", of_cubic, of_cubic)
    own = 0.5 * (weight.sum() + np.array([double.real, -double.real])) - taken[[0, 1], [0, 1]]
    both = -0.5 * double.imag - taken[0, 1]
    determinant = own[0] * own[1] - both**2
    shown = determinant > _SHOWN * weight.sum() ** 2
    fall = own[1] * cosine**2 + own[0] * sine**2 - 2.0 * both * cosine * sine
    power = np.where(shown, fall / np.where(shown, determinant, 1.0), 0.0)
    left = float(residual @ residual - smooth @ smooth)
    return np.array([order[kept], 0.5 * len(residual) * power / max(left, 1e-12)])
