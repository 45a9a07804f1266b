"""Gains and delays of position drives where efforts were measured: tau = k (u(t - d) - q) - b v by least squares."""

import numpy as np

from poise.simulation.rollout.drive_fit import DriveEstimate, DriveValue
from poise.simulation.rollout.free_arm import FreeArm
from poise.types import Array, Mask

_HELD, _LEAST = 0.3, 0.02
"""Share of the recording that proves a fit, and the part of the error there that it must remove."""
_LATEST, _COARSE, _FINE = 0.2, 4e-3, 2.5e-4
"""s: the longest delay, and the steps in which delays are tried."""
_FOLLOWS = 0.9
"""Share of the effort's square on held-out samples that the law must explain: else the effort is not of this drive."""
_PARTS = 8
"""Parts of the recording whose fits give the scatter."""


def drives_by_effort(arm: FreeArm) -> tuple[DriveEstimate, ...]:
    """The drives of a model as commands, motion and efforts show them; joints whose efforts follow no such law are
    left out.

    Args:
        arm: with commands and efforts.
    """
    run, now = arm.run, arm.drive_values()
    held = run.seconds > run.seconds[-1] - _HELD * (run.seconds[-1] - run.seconds[0])
    found = []
    for j, joint in enumerate(arm.joints):
        column = run.names.index(joint)
        effort = run.effort[:, column]
        usual = np.isfinite(effort) & (run.seconds > run.seconds[0] + _LATEST)
        if arm.drives[j] is None or usual.sum() < 100:
            continue
        # A drive feels the speed that it measures; where that was not recorded or is noisy, take the smoothed one.
        laws = [_Law(arm, column, effort, speed[:, column]) for speed in (run.measured_velocity, run.velocity)]
        fits = [(each.fitted(usual & ~held), each) for each in laws if each.known]
        values, law = min(fits, key=lambda fit: fit[1].error(fit[0], usual & ~held))
        nominal = np.array([now["gain"][j], now["rate_gain"][j], now["delay"][j]])
        after, before = (law.error(each, usual & held) for each in (values, nominal))
        if after > np.sqrt((1.0 - _FOLLOWS) * float(np.mean(effort[usual & held] ** 2))):
            continue
        rows = np.flatnonzero(usual & ~held)
        parts = [law.fitted(np.isin(np.arange(len(effort)), part), values[2]) for part in np.array_split(rows, _PARTS)]
        sigma = np.std(parts, axis=0, ddof=1) / np.sqrt(_PARTS)
        sigma[2] = max(float(sigma[2]), law.period / np.sqrt(12.0))
        named = zip(("gain", "rate_gain", "delay"), values, sigma, nominal, strict=True)
        estimates = {name: DriveValue(float(v), float(s), float(n)) for name, v, s, n in named}
        found.append(DriveEstimate(joint, estimates, before, after, after < (1.0 - _LEAST) * before, "N m"))
    return tuple(found)


class _Law:
    """The law of one joint's drive."""

    def __init__(self, arm: FreeArm, column: int, effort: Array, velocity: Array) -> None:
        self._run, self._column, self._effort, self._velocity = arm.run, column, effort, velocity

    @property
    def known(self) -> bool:
        """Whether its velocity was recorded."""
        return bool(np.isfinite(self._velocity).all())

    @property
    def period(self) -> float:
        """s between commands: a delay is not known better."""
        return float(np.median(np.diff(self._run.command_seconds)))

    def _columns(self, delay: float) -> Array:
        """(N, 2) command minus position, and minus the velocity."""
        run, c = self._run, self._column
        sent = run.command_at(run.seconds - delay, c)
        return np.column_stack([sent - run.position[:, c], -self._velocity])

    def _solved(self, delay: float, rows: Mask) -> tuple[float, Array]:
        columns, effort = self._columns(delay)[rows], self._effort[rows]
        gains = np.asarray(np.linalg.lstsq(columns, effort, rcond=None)[0], dtype=np.float64)
        return float(np.mean((effort - columns @ gains) ** 2)), gains

    def fitted(self, rows: Mask, about: float | None = None) -> Array:
        """(3,) gain, rate gain and delay with the least error on some samples; `about`: a delay near the best one."""
        if about is None:
            tried = np.arange(0.0, _LATEST, _COARSE)
            about = float(tried[int(np.argmin([self._solved(each, rows)[0] for each in tried.tolist()]))])
        reach = max(_COARSE, 1.5 * self.period)
        near = np.arange(max(about - reach, 0.0), about + reach, min(_FINE, self.period / 4.0))
        squares = np.array([self._solved(each, rows)[0] for each in near.tolist()])
        # Commands come in steps, so that the error is flat between them: the middle of the flat.
        flat = near[squares <= squares.min() * (1.0 + 1e-6) + 1e-15]
        delay = float(flat.mean())
        return np.array([*self._solved(delay, rows)[1], delay])

    def error(self, values: Array, rows: Mask) -> float:
        """N m, rms on some samples."""
        rest = self._effort[rows] - self._columns(float(values[2]))[rows] @ values[:2]
        return float(np.sqrt(np.mean(rest**2)))
