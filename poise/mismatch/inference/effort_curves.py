"""Joint efforts that depend freely on a state: the rivals of each named effect of the arm.

A friction, a spring or a payload is named where it explains the efforts as well as free curves over the same states
do. Each joint has curves of its own.
"""

from collections.abc import Callable

import numpy as np

from poise.mismatch.effects import Effect, EffectParameter, Values
from poise.mismatch.inference.unknown import FreeCurve, coefficients, linear_bspline_basis
from poise.mismatch.recorded import EffortTrack, RecordedMotion
from poise.types import Array

_CURVE, _TURNS = 8, 12
"""Linear B-splines over the range of a velocity or a load, and of a position."""
_TIME_STEP, _MOST_KNOTS = 4.0, 24
"""s between the knots of a curve in time, and their number at most."""
_SIZE = 0.3
"""Size of the curves in units of what the rigid arm leaves; priors are 0.3 to 9 times as wide."""
_SLOW = 0.05
"""rad/s or m/s, the width of the transition of dry friction."""


def _time(track: EffortTrack, _joint: int) -> Array:
    span = float(np.ptp(track.seconds))
    return linear_bspline_basis(track.seconds, min(max(int(span / _TIME_STEP), 4), _MOST_KNOTS))


def _rate(track: EffortTrack, joint: int) -> Array:
    return linear_bspline_basis(track.velocity[:, joint], _CURVE)


def _changing_friction(track: EffortTrack, joint: int) -> Array:
    """Dry and viscous friction that change with time."""
    course, rate = _time(track, joint), track.velocity[:, joint, None]
    return np.hstack([course * np.tanh(rate / _SLOW), course * rate / max(float(rate.std()), 1e-9)])


def _place(track: EffortTrack, joint: int) -> Array:
    return linear_bspline_basis(track.position[:, joint], _TURNS)


def _friction_at_place(track: EffortTrack, joint: int) -> Array:
    return linear_bspline_basis(track.position[:, joint], _CURVE) * np.tanh(track.velocity[:, joint, None] / _SLOW)


def _friction_under_load(track: EffortTrack, joint: int) -> Array:
    return linear_bspline_basis(track.rigid[:, joint], _CURVE) * np.tanh(track.velocity[:, joint, None] / _SLOW)


_CURVES: dict[str, Callable[[EffortTrack, int], Array]] = {
    "time": _time,
    "joint_velocity": _rate,
    "time:friction": _changing_friction,
    "joint_position": _place,
    "joint_position:friction": _friction_at_place,
    "load:friction": _friction_under_load,
}


class EffortCurve(FreeCurve):
    """Each joint's effort has a part that is some function of a state.

    Args:
        state: of `_CURVES`.
    """

    layer = "friction"
    signal = "effort"
    equation = "tau_j = c_j(s), c_j: a free curve over the state s"

    def __init__(self, state: str) -> None:
        self.state = state
        self.name = f"unknown:{state}"  # type: ignore[misc]

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        return coefficients(self.columns(recorded, {}).shape[2])

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        track = recorded.effort
        if track is None:
            return np.zeros((len(recorded), 6, 0))
        key = ("effort curve", self.state, len(track.seconds))
        return recorded.once(key, lambda: _columns(track, _CURVES[self.state]))

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        del recorded, values
        return f"The joint efforts have a part that depends on {self.state}."


def _columns(track: EffortTrack, curve: Callable[[EffortTrack, int], Array]) -> Array:
    """(M, J, k) the curves of every joint, of about the size of what the rigid arm leaves there."""
    count = len(track.names)
    size = np.maximum(_SIZE * np.std(track.measured - track.rigid, axis=0), 1e-9)
    parts = []
    for joint in range(count):
        basis = curve(track, joint)
        wide = np.zeros((len(basis), count, basis.shape[1]))
        wide[:, joint] = basis * size[joint]
        parts.append(wide)
    return np.concatenate(parts, axis=2)


def effort_curves() -> tuple[Effect, ...]:
    """One effect for each state."""
    return tuple(EffortCurve(state) for state in _CURVES)
