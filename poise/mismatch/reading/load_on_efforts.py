"""Effects of the load, the base and the encoders, as joint efforts show them."""

from collections.abc import Iterable

import numpy as np

from poise.mismatch.effects import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion, joint_torques, wrench_of_torques
from poise.types import Array

_SHOWN = ("payload_parameters", "world_force", "air_drag", "cable", "mass_step", "mass_leak", "contact")
"""Effects that act on the load from outside, or change it."""


class _OnEfforts(Effect):
    """An effect of the wrench on the joint efforts, under the same name and with the same parameters."""

    signal = "effort"

    def __init__(self, inner: Effect) -> None:
        self._inner = inner
        same = ("name", "layer", "equation", "source", "excited_by", "separating_motion", "confused_with", "transfers")
        vars(self).update({name: getattr(inner, name) for name in (*same, "order", "widens", "made_of", "defaults")})
        vars(self)["needs"] = ("joints", "effort")

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        return self._inner.parameters(recorded)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        return self._inner.derived(recorded, values)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        return self._inner.sentence(recorded, values)


class LoadOnEfforts(_OnEfforts):
    """An effect of the load on the joint efforts that balance it: tau = -J^T w."""

    def __init__(self, inner: Effect) -> None:
        super().__init__(inner)
        vars(self)["needs"] = (*inner.needs, "joints", "effort")

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """From the wrench that explains the residual of the efforts."""
        return self._inner.starts(recorded, wrench_of_torques(recorded, residual))

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        return joint_torques(recorded, self._inner.columns(recorded, nonlinear))

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        return joint_torques(recorded, self._inner.simulate(recorded, values)[:, :, None])[:, :, 0]

    def windows(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        return self._inner.windows(recorded, values)

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        return self._inner.implausible(recorded, values)

    def untestable(self, recorded: RecordedMotion) -> str:
        return super().untestable(recorded) or self._inner.untestable(recorded)


class TiltOnEfforts(_OnEfforts):
    """A tilted base on the efforts that carry the arm, to first order in the tilt."""

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        inner = self._inner.parameters(recorded)
        return tuple(EffectParameter(p.name, p.unit, p.scale, low=p.low, high=p.high) for p in inner)

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        track = recorded.effort
        if track is None or track.by_tilt is None:
            return super().columns(recorded, nonlinear)
        return track.by_tilt

    def untestable(self, recorded: RecordedMotion) -> str:
        known = recorded.effort is not None and recorded.effort.by_tilt is not None
        return super().untestable(recorded) or ("" if known else "the mass of the arm is not known")


class OffsetOnEfforts(_OnEfforts):
    """Wrong zeros of encoders on the efforts that carry the arm, to first order in the offsets."""

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        track, joints = recorded.effort, recorded.joints
        if track is None or joints is None:
            return super().simulate(recorded, values)
        offsets = np.array([values[f"offset_{joints.names.index(name) + 1}"] for name in track.names])
        return np.asarray(-track.by_position @ offsets)


def acting_on_efforts(effect: Effect) -> Effect | None:
    """The effect as it acts on joint efforts; None for an effect that does not reach them."""
    if effect.name in _SHOWN:
        return LoadOnEfforts(effect)
    known = {"base_tilt": TiltOnEfforts, "joint_offset": OffsetOnEfforts}.get(effect.name)
    return None if known is None else known(effect)


def on_efforts(effect: Effect, recorded: RecordedMotion) -> Effect:
    """The effect as the efforts show it, for a recording of joint efforts without a wrench."""
    shown = recorded.effort is not None and not recorded.has("wrench") and effect.name in (*_SHOWN, "base_tilt")
    return (acting_on_efforts(effect) if shown else None) or effect
