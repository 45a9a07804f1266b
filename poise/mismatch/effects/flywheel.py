"""Flywheel: a rotor in the tool spins, and its angular momentum resists rotation."""

import numpy as np

from poise.geometry import cross
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion, directed
from poise.types import Array

_NAMES = ("momentum_x", "momentum_y", "momentum_z")


class Flywheel(Effect):
    """tau = -omega x h: a rotor with constant angular momentum h in the tool (a spindle, a fan, a hard disk)."""

    name = "flywheel"
    layer = "load"
    equation = "dtau = -omega x h, h constant in sensor axes"
    source = "gyrostat (Wittenburg 2008, Dynamics of Multibody Systems, chapter 4)"
    excited_by = "turning the tool about axes across the rotor's"
    separating_motion = (
        "turn evenly about each axis both ways: the torque changes sign with the speed, an inertia's does not"
    )
    confused_with = ("payload_parameters", "air_drag", "clock_offset")

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return tuple(EffectParameter(name, "N m s", 0.05) for name in _NAMES)

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        out = np.zeros((len(recorded), 6, 3))
        out[:, 3:] = -cross(recorded.angular_velocity[:, None], np.eye(3)).swapaxes(1, 2)
        return out

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        del recorded
        return (
            "A rotor in the tool spins with an angular momentum of "
            f"{directed([values[name] for name in _NAMES], 'N m s')}: the nominal load has no rotor."
        )
