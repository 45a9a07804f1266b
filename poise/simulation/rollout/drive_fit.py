"""Gains and delays of drives, and the friction and rotors behind them, from commands and motion alone.

The error of free runs is least (output error, Ljung 1999, section 4.2): windows of the recording are simulated from
their recorded states under the recorded commands, and Gauss-Newton steps change each joint's parameters by its own
error, since geared joints hardly move one another. The windows of the fit are not those of the proof.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.simulation.rollout.free_arm import FreeArm
from poise.simulation.rollout.windows import RolloutOptions, rolled_out, span, window_starts
from poise.types import Array, Mask

_HORIZON, _WINDOWS = 1.0, 30
"""s of a window of the fit, and how many of them at most."""
_STEPS, _SETTLED = 12, 2e-3
"""Gauss-Newton steps at most, and the relative fall of the square at which a joint has settled."""
_SHIFT = 0.05
"""Of a parameter's logarithm, and of `_LATE` for delays, for derivatives by differences."""
_LATE, _LATEST = 0.02, 0.5
"""s: the unit of delays, and the longest one."""
_FURTHEST = 1.0
"""Largest change of a logarithm in one step."""
_HELD, _LEAST = 0.3, 0.02
"""Share of the recording that proves a fit; and the share of the error there that a joint's fit must remove."""
_SOFTER = (1.0, 0.2, 0.05, 0.01)
"""Factors of the gain from which the fit starts."""

_FITTED = ("gain", "delay", "damping", "armature", "friction")
DRIVE_UNITS = {"gain": "N m/rad", "rate_gain": "N m s/rad", "delay": "s"} | {
    "damping": "N m s/rad",
    "armature": "kg m2",
    "friction": "N m",
}
"""What is known of a drive and of the joint behind it, with units for joints that turn."""
_TYPICAL = {"damping": 0.05, "armature": 0.003, "friction": 0.01}
"""Least values, in parts of the gain: s, s2 and rad; a logarithm has no zero."""


@dataclass(frozen=True)
class DriveValue:
    """A parameter of a drive: fitted, with one sigma, and as the model has it."""

    value: float
    std: float
    before: float


@dataclass(frozen=True)
class DriveEstimate:
    """One joint.

    Args:
        joint: its name.
        values: by the names of `DRIVE_UNITS`.
        before, after: of `unit`, errors that the fit did not see: of free runs of one second, or of the effort.
        kept: the fit lowers that error.
        unit: of the errors, of joints that turn.
    """

    joint: str
    values: dict[str, DriveValue]
    before: float
    after: float
    kept: bool
    unit: str = "rad"


@dataclass(eq=False)
class _Fit:
    """The parameters (P, J) of a model in its units, and their windows."""

    arm: FreeArm
    names: tuple[str, ...]
    starts: Array

    def residual(self, values: Array) -> Array:
        """(J, R) error of each joint over all windows for parameters (P, J)."""
        self.arm.set_drives({name: np.exp(row) if name != "delay" else row * _LATE for name, row in self.named(values)})
        seconds, position, _ = self.arm.positions(self.starts, _HORIZON)
        recorded = self.arm.recorded(self.starts[:, None] + seconds)
        off = np.clip(np.nan_to_num(position - recorded, nan=np.pi), -np.pi, np.pi)
        return np.asarray(off.reshape(-1, off.shape[2]).T)

    def named(self, values: Array) -> list[tuple[str, Array]]:
        return list(zip(self.names, values, strict=True))

    def slopes(self, values: Array, here: Array) -> Array:
        """(P, J, R): every joint's parameter of a kind moves at once."""
        found = []
        for p in range(len(values)):
            moved = values.copy()
            moved[p] += _SHIFT
            found.append((self.residual(moved) - here) / _SHIFT)
        return np.array(found)


def fit_drives(
    arm: FreeArm, names: Sequence[str] = _FITTED, progress: Callable[[float], None] = lambda share: None
) -> tuple[DriveEstimate, ...]:
    """Fit the drives of a model to a recording; the arm keeps the values that were kept.

    Args:
        arm: with a position drive and commands of each joint.
        names: of `DRIVE_UNITS` but the rate gain, which acts as damping does; what efforts show is not fitted again.
        progress: is called with the completed share, 0 to 1.

    Raises:
        InputError: UNSUPPORTED when a joint has no position drive; TOO_FEW_SAMPLES.
    """
    if not all(drive is not None and drive.kind == "position" for drive in arm.drives):
        lacking = [name for name, drive in zip(arm.joints, arm.drives, strict=True) if drive is None]
        raise InputError(ErrorCode.UNSUPPORTED, f"no position drive with commands at {', '.join(lacking)}")
    begin, end = span(arm.run, RolloutOptions())
    proof = RolloutOptions((_HORIZON,), _WINDOWS, end - _HELD * (end - begin), end)
    first = arm.drive_values()
    starts = window_starts(begin + _LATEST, proof.begin, _HORIZON, _WINDOWS)
    before = rolled_out(arm, proof).horizons[0].by_joint
    fit = _Fit(arm, tuple(names), starts)
    values, deviation = _fitted(fit, _start(fit, first), progress)
    found = {name: np.exp(row) if name != "delay" else row * _LATE for name, row in fit.named(values)}
    arm.set_drives(found)
    after = rolled_out(arm, proof).horizons[0].by_joint
    kept = after < (1.0 - _LEAST) * before
    arm.set_drives({name: np.where(kept, found[name], first[name]) for name in names})
    sigma = {n: row * (found[n] if n != "delay" else _LATE) for n, row in fit.named(deviation)}
    return tuple(
        DriveEstimate(
            joint,
            {n: DriveValue(float(found[n][j]), float(sigma[n][j]), float(first[n][j])) for n in names},
            float(before[j]),
            float(after[j]),
            bool(kept[j]),
        )
        for j, joint in enumerate(arm.joints)
    )


def _start(fit: _Fit, first: dict[str, Array]) -> Array:
    """(P, J) logarithms (delays: units) from which each joint's error is least: gains may be far too stiff."""
    best, least = None, np.full(len(fit.arm.joints), np.inf)
    for factor in _SOFTER if "gain" in fit.names else (1.0,):
        for late in (0.0, 2.0) if "delay" in fit.names else (0.0,):
            gain = first["gain"] * factor
            tried = []
            for name in fit.names:
                if name == "delay":
                    tried.append(np.maximum(first["delay"] / _LATE, late))
                else:
                    value = gain if name == "gain" else np.maximum(first[name], _TYPICAL[name] * gain * 0.1)
                    tried.append(np.log(np.maximum(value, 1e-6)))
            values = np.array(tried)
            square = np.mean(fit.residual(values) ** 2, axis=1)
            better = square < least
            best = values if best is None else np.where(better, values, best)
            least = np.minimum(square, least)
    return np.zeros((0, 0)) if best is None else best


def _fitted(fit: _Fit, values: Array, progress: Callable[[float], None]) -> tuple[Array, Array]:
    """(P, J) parameters with the least error of each joint, and one sigma of them."""
    here = fit.residual(values)
    square = np.mean(here**2, axis=1)
    damping, busy = np.full(len(square), 1e-2), np.ones(len(square), dtype=bool)
    slopes = fit.slopes(values, here)
    for step in range(_STEPS):
        progress(step / _STEPS)
        moved = values + np.where(busy, _step(slopes, here, damping), 0.0)
        moved = _bounded(fit.names, moved)
        tried = fit.residual(moved)
        new = np.mean(tried**2, axis=1)
        better = new < square
        busy = _busy(busy, better, new, square, damping)
        damping = np.where(better, damping / 5.0, damping * 8.0)
        values = np.where(better, moved, values)
        if not busy.any():
            break
        if better.any():
            here = fit.residual(values)
            square, slopes = np.mean(here**2, axis=1), fit.slopes(values, here)
    return values, _deviation(slopes, here, len(fit.starts))


def _busy(busy: Mask, better: Mask, new: Array, square: Array, damping: Array) -> Mask:
    settled = better & (new > (1.0 - _SETTLED) * square)
    return busy & ~settled & ~(~better & (damping > 1e3))


def _step(slopes: Array, here: Array, damping: Array) -> Array:
    """(P, J) Levenberg-Marquardt steps of each joint by itself."""
    out = np.zeros(slopes.shape[:2])
    for j in range(slopes.shape[1]):
        columns = slopes[:, j]
        normal = columns @ columns.T
        held = damping[j] * np.diag(normal) + 1e-9 * max(float(np.trace(normal)), 1e-12)
        out[:, j] = -np.linalg.solve(normal + np.diag(held), columns @ here[j])
    return np.clip(out, -_FURTHEST, _FURTHEST)


def _bounded(names: Sequence[str], values: Array) -> Array:
    """Delays between zero and the longest; logarithms above what has no effect."""
    low = np.array([[0.0 if name == "delay" else np.log(1e-6)] for name in names])
    high = np.array([[_LATEST / _LATE if name == "delay" else np.log(1e5)] for name in names])
    return np.clip(values, low, high)


def _deviation(slopes: Array, here: Array, windows: int) -> Array:
    """(P, J) one sigma of the parameters: windows are independent, samples in them are not."""
    out = np.full(slopes.shape[:2], np.nan)
    for j in range(slopes.shape[1]):
        columns, rest = slopes[:, j].reshape(len(slopes), windows, -1), here[j].reshape(windows, -1)
        pulls = np.einsum("pwt,wt->wp", columns, rest)
        normal = np.einsum("pwt,qwt->pq", columns, columns)
        inverse = np.linalg.pinv(normal + 1e-9 * np.trace(normal) * np.eye(len(normal)))
        out[:, j] = np.sqrt(np.maximum(np.diag(inverse @ (pulls.T @ pulls) @ inverse), 0.0))
    return out
