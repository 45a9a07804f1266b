"""How sharply the dry friction of joints reverses: it differs between two recordings without being a change.

Friction that is soft reverses within a speed that is proportional to it and to the lightness of the joint (see
`soft_sense`): a rotor or a load changes the reversals of friction that both recordings have. The same holds beside the
friction that a model states: the real one may be sharper, or reverse along bristles. A difference of two reversals
vanishes at speed, unlike friction.
"""

import numpy as np

from poise.mismatch.effects import COULOMB_TRANSITION, bristles_along, soft_ramp, stated_sense
from poise.mismatch.recorded import EffortTrack
from poise.types import Array, Mask

_RAMPS = np.array([0.0015, 0.003, 0.006, 0.012, 0.025, 0.05, 0.1, 0.2, 0.4])
"""rad/s or m/s."""
_SLOW = 0.5
"""Share of the usual speed of a joint up to which ramps are looked for: longer ones are no reversals."""
_SHARP = 0.025
"""rad/s or m/s: longest ramp of a model that states none. A drive sharper than a soft model imitates stiction."""
_LEADS = (0.0, 0.0095)
"""s by which the acceleration leads: of dry friction, and of MuJoCo's friction loss."""
_CREEPS = 3.0
"""Usual speed of a joint, in units of the model's reversal, below which the whole motion is a part of that."""
_DISTANCES = np.geomspace(1e-4, 0.03, 5)
"""rad or m, along which bristles bend after a reversal."""


def friction_known(track: EffortTrack) -> bool:
    """Whether the efforts are compared beside dry friction that is known: of another recording, or of a model."""
    return track.errors_cancel or any(each.friction for each in track.stated)


def reversal_columns(track: EffortTrack) -> Array:
    """(M, J) of each joint the difference of two reversals that explains most of its residual beside smooth functions.

    One unit is twice what least squares give: one sigma of a normal prior.
    """
    residual = track.measured - track.prediction
    turned = np.hstack([np.sin(track.position), np.cos(track.position), np.ones((len(residual), 1))])
    found, bent = np.zeros_like(residual), bristles_along(track, _DISTANCES.tolist())
    for joint in range(residual.shape[1]):
        velocity, acceleration = track.velocity[:, joint], track.acceleration[:, joint]
        usual = float(np.quantile(np.abs(velocity), 0.9))
        ramps = _RAMPS[_SLOW * usual > _RAMPS]
        own = _own_law(track, joint) if usual < _CREEPS * COULOMB_TRANSITION else []
        if len(ramps) < 2 and not own:
            continue
        common = np.tanh(velocity / ramps[-1])
        beside = np.column_stack([turned, velocity, acceleration, track.rigid[:, joint], common])
        if own:
            # Beside such a motion every reversal is smooth: errors of the weight alone count.
            beside = np.column_stack([np.ones_like(velocity), track.rigid[:, joint]])
        soft = [soft_ramp(velocity, acceleration, lead, ramp) for lead in _LEADS for ramp in ramps]
        laws = np.column_stack([*soft, *(each[:, joint] for each in bent), *own])
        longest = np.inf if track.errors_cancel else max(_SHARP, track.stated[joint].ramp)
        modelled = np.append(np.tile(ramps <= longest, len(_LEADS)), [True] * (len(bent) + len(own)))
        found[:, joint] = _likeliest(laws, beside, residual[:, joint], modelled)
    return found


def _own_law(track: EffortTrack, joint: int) -> list[Array]:
    """(M,) how the friction that the model states for a joint reverses; none without such friction.

    No other law is near it where the whole motion is hardly faster than its reversal.
    """
    if not track.stated or not track.stated[joint].friction:
        return []
    physics = track.stated[joint]
    return [stated_sense(track.velocity[:, joint], track.acceleration[:, joint], physics.lead, physics.ramp)]


def _likeliest(laws: Array, beside: Array, residual: Array, modelled: Mask) -> Array:
    """(M,) the difference of two laws (M, L) by which the friction of one joint reverses: that of the drive and one of
    the model, which may have those of a mask (L,).
    """
    smooth = np.linalg.qr(beside)[0]
    left, own = residual - smooth @ (smooth.T @ residual), laws - smooth @ (smooth.T @ laws)
    across, products = own.T @ left, own.T @ own
    squares = np.diag(products)
    size = squares[:, None] + squares - 2.0 * products
    likely = across[:, None] - across
    won = np.maximum(likely, 0.0) ** 2 / np.maximum(size, 1e-6 * len(residual)) * modelled
    i, j = np.unravel_index(int(np.argmax(won)), won.shape)
    return np.asarray(2.0 * likely[i, j] / max(float(size[i, j]), 1e-9) * (laws[:, i] - laws[:, j]))
