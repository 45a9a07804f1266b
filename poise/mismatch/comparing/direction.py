"""Which of two recordings has more: a guess by least squares, so that the likely answer is searched for first."""

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
    found = 0.0
    effort = difference.effort
    if effort is not None and effort.names:
        columns = _friction(effort)
        load = _load_on_efforts(difference)
        if load is not None:
            columns = np.concatenate([columns, load], axis=2)
        residual = effort.measured - effort.prediction
        found += _signed(columns, residual, positive=3 * len(effort.names), mass=load is not None)
    if difference.has("wrench"):
        found += _signed(_payload(difference), difference.wrench - difference.prediction, positive=0, mass=True)
    return found < 0.0


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
    columns, residual = _averaged(columns), _averaged(residual)
    noise = np.maximum(np.std(np.diff(residual, axis=0), axis=0), 1e-9)
    wide = (columns / noise[:, None]).reshape(-1, columns.shape[2])
    right = wide.T @ (residual / noise).ravel()
    normal = wide.T @ wide
    found = np.linalg.solve(normal + 1e-9 * max(float(np.trace(normal)), 1e-12) * np.eye(len(normal)), right)
    energy = found * np.abs(found) * np.diag(normal)
    total = float(energy[:positive].sum())
    if mass:
        rest = found[positive:]
        total += float(np.sign(found[positive]) * (rest @ normal[positive:, positive:] @ rest))
    return total


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
