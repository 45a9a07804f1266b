"""Least squares of a difference: which of two recordings has more, and what no change of friction or load explains.

Both are guesses: by the first the likely answer is searched for first, by the second a clock differs from a speed.
"""

from collections.abc import Iterator

import numpy as np

from poise.mismatch.effects import COULOMB_TRANSITION, effect_named
from poise.mismatch.reading import acting_on_efforts
from poise.mismatch.recorded import EffortTrack, RecordedMotion
from poise.types import Array

_ROWS = 1500
"""Averages of consecutive samples that are used at most."""


def has_less(difference: RecordedMotion) -> bool:
    """Whether the first recording of a difference has less friction, inertia and load than the other one.

    Friction and rotors have one sign in whichever recording has them, and so has a mass.
    """
    return sum(_signed(*each) for each in _signals(difference)) < 0.0


def unexplained(difference: RecordedMotion) -> float:
    """What friction, rotors, a load and constants leave of a difference, mean square in units of its noise.

    A change is often larger than what a wrong clock does to the predictions; it is removed before that is judged.
    """
    left = []
    for columns, residual, _, _ in _signals(difference):
        wide, rest = _weighed(np.concatenate([columns, _constants(columns)], axis=2), residual)
        left.append(float(np.mean((rest - wide @ _solved(wide.T @ wide, wide.T @ rest)) ** 2)))
    return float(np.mean(left))


def _signals(difference: RecordedMotion) -> Iterator[tuple[Array, Array, int, bool]]:
    """Of efforts and wrench: columns and residual, and which coefficients have a sign, as for `_signed`."""
    effort = difference.effort
    if effort is not None and effort.names:
        columns = _friction(effort)
        load = _load_on_efforts(difference)
        if load is not None:
            columns = np.concatenate([columns, load], axis=2)
        yield columns, effort.measured - effort.prediction, 3 * len(effort.names), load is not None
    if difference.has("wrench"):
        yield _payload(difference), difference.wrench - difference.prediction, 0, True


def _averaged(values: Array) -> Array:
    """Of consecutive samples, `_ROWS` at the most: a change that is smaller than the noise of a sample counts, too."""
    together = -(-len(values) // _ROWS)
    whole = values[: len(values) // together * together]
    return np.asarray(whole.reshape(-1, together, *values.shape[1:]).mean(axis=1))


def _signed(columns: Array, residual: Array, positive: int, mass: bool) -> float:
    """Energy that the columns explain, negative where a coefficient that has to be positive is not.

    Args:
        columns: (N, C, k). residual: (N, C).
        positive: number of the first columns whose coefficients are positive.
        mass: the column after these is a mass, and the rest belongs to it.
    """
    wide, rest = _weighed(columns, residual)
    normal = wide.T @ wide
    found = _solved(normal, wide.T @ rest)
    energy = found * np.abs(found) * np.diag(normal)
    total = float(energy[:positive].sum())
    if mass:
        rest = found[positive:]
        total += float(np.sign(found[positive]) * (rest @ normal[positive:, positive:] @ rest))
    return total


def _weighed(columns: Array, residual: Array) -> tuple[Array, Array]:
    """(R, k) and (R,) averages in units of the noise, from columns (N, C, k) and a residual (N, C)."""
    columns, residual = _averaged(columns), _averaged(residual)
    noise = np.maximum(np.std(np.diff(residual, axis=0), axis=0) / np.sqrt(2.0), 1e-9)
    return (columns / noise[:, None]).reshape(-1, columns.shape[2]), np.asarray((residual / noise).ravel())


def _solved(normal: Array, right: Array) -> Array:
    ridge = 1e-9 * max(float(np.trace(normal)), 1e-12) * np.eye(len(normal))
    return np.asarray(np.linalg.solve(normal + ridge, right))


def _constants(columns: Array) -> Array:
    """(N, C, C) a constant of each channel."""
    rows, channels = columns.shape[:2]
    return np.broadcast_to(np.eye(channels), (rows, channels, channels))


def _friction(effort: EffortTrack) -> Array:
    """(M, J, 3 J) dry and viscous friction and rotors of each joint."""
    parts = (np.tanh(effort.velocity / COULOMB_TRANSITION), effort.velocity, effort.acceleration)
    return np.concatenate([part[:, :, None] * np.eye(len(effort.names)) for part in parts], axis=2)


def _payload(recorded: RecordedMotion) -> Array:
    """(N, 6, 10)."""
    effect = effect_named("payload_parameters")
    return np.zeros((len(recorded), 6, 10)) if effect is None else effect.columns(recorded, {})


def _load_on_efforts(recorded: RecordedMotion) -> Array | None:
    """(M, J, 10), or None where the joints do not reach the load."""
    effect = effect_named("payload_parameters")
    acting = None if effect is None else acting_on_efforts(effect)
    return None if acting is None or acting.untestable(recorded) else acting.columns(recorded, {})
