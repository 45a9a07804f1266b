"""External vibration: for a while the robot's base vibrates sinusoidally."""

from collections.abc import Iterable

import numpy as np

import poise.mismatch.effects.accelerometer_input as felt
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_wrench import shaking, shaking_columns
from poise.mismatch.effects.starts import noise_in
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array, Mask

_PHASES = ("sine", "cosine")
_LOWEST = 2.0
"""Hz; slower oscillations belong to the commanded motion."""
_STRETCH = 1.28
"""s of each spectrum; the next one begins a quarter of it later."""
_RAMP = 0.1
"""s in which the vibration rises and falls."""
_CLEAR = 0.1
"""Share of the robot's own acceleration that a line must exceed: splines smooth a jerk by up to 4 % of it, and joints
that ring by less hide it in the noise of their encoders."""
_RINGS = 1.0
"""s after which a joint rings with another phase: in a longer line its errors add up like noise, unless the arm itself
moves at that frequency."""
_ABOVE = 25.0
"""Power of a line over the median power of the spectrum near it: the largest of a thousand values of a noise of any
colour reaches 15. Corners of the motion that encoders do not show leave such a noise below their bandwidth."""
_ABOVE_EACH = 6.0
"""Power of a line over the largest one near it: it exceeds 37 lines of a white noise as much once in five million."""
_NEAR = (3.0, 12.0)
"""Distance of that spectrum from the line, times the length of the window."""
_KEPT, _CHANCE = 0.5, 40.0
"""Share of the energy of a line in the channels below which the base's axes do not explain it, and energy, in units of
the noise, that its six further parameters do not have by chance."""
_FEWEST_WAVES = 6.0
"""Of a vibration; a shorter burst is another event."""


class ExternalVibration(Effect):
    """The base accelerates as A sin(2 pi f t) + B cos(2 pi f t) in its own axes, from `start` for `length`.

    With an accelerometer on the sensor, its measurement replaces the sine: its clock offset and a gain are fitted.
    """

    name = "external_vibration"
    layer = "event"
    fast = True
    equation = "dw = (-m a, -mc x a), a = R_sensor_base (A sin 2 pi f t + B cos 2 pi f t) in the window"
    source = "base excitation (Inman 2014, Engineering Vibration, section 2.4)"
    excited_by = "nothing: a machine nearby, a fan, a pump"
    separating_motion = (
        "stand still in two attitudes: a vibration keeps the base's axes, the oscillation of a part decays"
    )
    confused_with = ("flexible_mode", "base_motion", "contact", "gear_ripple")
    needs = ("load",)
    transfers = False
    varies = True  # a machine nearby is no even shaker, and the arm between both answers at each place otherwise

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        if recorded.accelerometer is not None:
            return felt.parameters(recorded)
        first, last = float(recorded.seconds[0]), float(recorded.seconds[-1])
        when = (
            EffectParameter("start", "s", low=first - 1.0, high=last, linear=False, resolution=0.05),
            EffectParameter("length", "s", low=0.1, high=recorded.duration + 2.0, linear=False, resolution=0.05),
            EffectParameter("frequency", "Hz", low=_LOWEST, high=0.5 / recorded.period, linear=False),
        )
        sizes = (EffectParameter(f"{phase}_{a}", "m/s2", 0.4, hidden=True) for phase in _PHASES for a in "xyz")
        return (*when, *sizes)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """A line above the spectra of several stretches in a row; its phase then gives the start."""
        if recorded.accelerometer is not None:
            yield from felt.starts(recorded, residual)
            return
        for start in self.oscillations(recorded, shaking(recorded, residual)):
            if not self._of_the_sensor(recorded, residual, start):
                yield start

    def oscillations(self, recorded: RecordedMotion, shake: Array) -> Iterable[Values]:
        """Windows and frequencies from an unreported acceleration (N, 3) in world axes."""
        for frequency, begin, end in self._lines(recorded, shake):
            near = frequency + np.linspace(-0.6, 0.6, 61) / _STRETCH
            inside = (recorded.seconds >= begin) & (recorded.seconds <= end)
            turns = np.exp(-2j * np.pi * np.outer(near, recorded.seconds[inside]))
            best = float(near[int(np.argmax((np.abs(turns @ shake[inside]) ** 2).sum(axis=1)))])
            start, stop = self._span(recorded, shake, best, inside)
            if (stop - start) * best < _FEWEST_WAVES or not self._clear(recorded, shake, best, (start, stop)):
                continue
            yield {"start": start, "length": max(stop - start, 0.2), "frequency": max(best, _LOWEST)}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        if recorded.accelerometer is not None:
            return felt.columns(recorded, nonlinear)
        waves = self.waves(recorded.seconds, nonlinear)
        answer = shaking_columns(recorded, None if recorded.base is None else recorded.base.rotation_world_base)
        return np.asarray((waves[:, None, :, None] * answer[:, :, None, :]).reshape(len(recorded), 6, 6))

    @staticmethod
    def waves(seconds: Array, values: Values) -> Array:
        """(M, 2) the sine and the cosine at stamps (M,); zero outside the window."""
        start, length = values["start"], values["length"]
        since = seconds - start
        ramp = min(_RAMP, length / 4)
        size = np.clip(np.minimum(since, length - since) / ramp + 0.5, 0.0, 1.0)
        # Phases count from the middle of the window: they then hardly depend on the frequency.
        turn = 2.0 * np.pi * values["frequency"] * (since - length / 2)
        return np.stack([np.sin(turn), np.cos(turn)], axis=1) * size[:, None]

    def windows(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        if recorded.accelerometer is not None:
            return felt.windows(recorded, values)
        return ((values["start"], values["start"] + values["length"]),)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        if recorded.accelerometer is not None:
            return felt.derived(recorded, values)
        ellipse = np.array([[values[f"{phase}_{axis}"] for axis in "xyz"] for phase in _PHASES])
        _, size, axes = np.linalg.svd(ellipse)
        parts = {f"direction_{axis}": (float(value), "") for axis, value in zip("xyz", axes[0], strict=True)}
        return {"amplitude": (float(size[0]), "m/s2"), **parts}

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        if recorded.accelerometer is not None:
            return felt.sentence(recorded, values)
        ((start, end),) = self.windows(recorded, values)
        return (
            f"From {start:.1f} s to {end:.1f} s the base vibrated at {values['frequency']:.1f} Hz with "
            f"{self.derived(recorded, values)['amplitude'][0]:.2f} m/s2: the nominal base does not vibrate."
        )

    @staticmethod
    def _lines(recorded: RecordedMotion, shake: Array, count: int = 2) -> Iterable[tuple[float, float, float]]:
        """(frequency, begin, end) of the line that exceeds the spectra longest and most."""
        period = recorded.period
        even = np.arange(recorded.seconds[0], recorded.seconds[-1], period)
        length = min(int(_STRETCH / period), len(even))
        firsts = np.arange(0, len(even) - length + 1, max(length // 4, 1))
        rows = firsts[:, None] + np.arange(length)
        power = np.zeros((len(firsts), length // 2 + 1))
        for part in shake.T:
            pieces = np.interp(even, recorded.seconds, part)[rows]
            pieces = pieces - pieces.mean(axis=1, keepdims=True)
            power += np.abs(np.fft.rfft(pieces * np.hanning(length))) ** 2
        frequency = np.fft.rfftfreq(length, period)
        fast = frequency >= _LOWEST
        # The median at higher frequencies is noise; lines below a multiple of it do not count.
        excess = np.where(fast, power / max(float(np.median(power[:, frequency > 4.0])), 1e-30) - 6.0, -1.0)
        for _ in range(count):
            total, begin, end = _longest_gain(excess)
            line = int(np.argmax(total))
            if total[line] <= 0.0:
                return
            first, last = firsts[begin[line]], firsts[end[line]] + length - 1
            yield float(frequency[line]), float(even[first]), float(even[last])
            excess[:, max(line - 2, 0) : line + 3] = -1.0

    @staticmethod
    def _clear(recorded: RecordedMotion, shake: Array, frequency: float, span: tuple[float, float]) -> bool:
        """Whether a line exceeds the error of differentiated encoders during this motion."""
        inside = (recorded.seconds >= span[0]) & (recorded.seconds <= span[1])
        own = recorded.linear_acceleration[inside]
        window = np.hanning(int(inside.sum()) + 2)[1:-1]
        wave = np.exp(-2j * np.pi * frequency * recorded.seconds[inside]) * window / window.sum()
        amplitude, moved = (2.0 * float(np.linalg.norm(wave @ part)) for part in (shake[inside], own))
        error = _CLEAR * float(np.sqrt(np.mean(np.sum(own**2, axis=1))))
        lasts = np.sqrt(_RINGS / max(span[1] - span[0], _RINGS))
        return bool(amplitude > min(error, max(error * lasts, moved))) and _stands_out(
            recorded.seconds[inside], shake[inside], frequency, window
        )

    def _of_the_sensor(self, recorded: RecordedMotion, residual: Array, start: Values) -> bool:
        """Whether a line keeps to the channels of the sensor instead of the base's axes and the load's lever.

        The mains couple into the cables of a sensor: such a line neither turns with the base nor acts at the load.
        """
        every, read = self.waves(recorded.seconds, start), residual.any(axis=0)
        inside, level = every.any(axis=1), noise_in(recorded, residual)[read]
        waves, left = every[inside], residual[inside][:, read] / level
        columns = (self.columns(recorded, start)[inside][:, read] / level[:, None]).reshape(left.size, -1)
        channels, base = _explained(waves, left), _explained(columns, left.reshape(-1, 1))
        return base < _KEPT * channels and channels - base > _CHANCE

    @staticmethod
    def _span(recorded: RecordedMotion, shake: Array, frequency: float, inside: Mask) -> tuple[float, float]:
        """Most likely first and last moment of a sine whose amplitude is that of the samples inside."""
        wave = np.exp(-2j * np.pi * frequency * recorded.seconds)
        amplitude = 2.0 * (shake[inside] * wave[inside, None]).mean(axis=0)
        predicted = (amplitude * wave.conj()[:, None]).real
        gain = (2.0 * shake * predicted - predicted**2).sum(axis=1)
        _, begin, end = _longest_gain(gain[:, None])
        return float(recorded.seconds[begin[0]]), float(recorded.seconds[end[0]])


def _stands_out(seconds: Array, shake: Array, frequency: float, window: Array) -> bool:
    """Whether a line in (N, 3) exceeds every value that a noise as large as the spectrum near it has."""
    away = np.linspace(*_NEAR, 19) / max(float(seconds[-1] - seconds[0]), 1e-9)
    near = np.concatenate([frequency - away, frequency + away])
    waves = np.exp(-2j * np.pi * np.outer([frequency, *near[near > _LOWEST]], seconds)) * window
    line, *others = (np.abs(waves @ shake) ** 2).sum(axis=1)
    return bool(line > min(_ABOVE * np.median(others), _ABOVE_EACH * max(others)))


def _explained(columns: Array, values: Array) -> float:
    """Sum of the squares that columns (M, k) explain of signals (M, C)."""
    basis = np.linalg.qr(columns)[0]
    return float(np.sum((basis.T @ values) ** 2))


def _longest_gain(values: Array) -> tuple[Array, Array, Array]:
    """For each column the stretch of rows with the largest sum: (sum, first row, last row), Kadane's algorithm."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    lowest = np.minimum.accumulate(total[:-1], axis=0)
    gain = total[1:] - lowest
    end = gain.argmax(axis=0)
    begin = np.array([int(np.argmin(total[: last + 1, column])) for column, last in enumerate(end.tolist())], dtype=int)
    return gain.max(axis=0), begin, end
