"""Effects of the load, seen in joint efforts where there is no wrench."""

from collections.abc import Iterable

from poise.mismatch.effects import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion, joint_torques, wrench_of_torques
from poise.types import Array

_SHOWN = ("payload_parameters", "world_force", "air_drag", "cable", "mass_step", "mass_leak", "contact")
"""Effects that act on the load from outside, or change it."""


class LoadOnEfforts(Effect):
    """An effect of the load on the joint efforts that balance it: tau = -J^T w, under the same name."""

    signal = "effort"

    def __init__(self, inner: Effect) -> None:
        self._inner = inner
        same = ("name", "layer", "equation", "source", "excited_by", "separating_motion", "confused_with", "transfers")
        vars(self).update({name: getattr(inner, name) for name in (*same, "order", "widens", "made_of", "defaults")})
        vars(self)["needs"] = (*inner.needs, "joints", "effort")

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        return self._inner.parameters(recorded)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """From the wrench that explains the residual of the efforts."""
        return self._inner.starts(recorded, wrench_of_torques(recorded, residual))

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        return joint_torques(recorded, self._inner.columns(recorded, nonlinear))

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        return joint_torques(recorded, self._inner.simulate(recorded, values)[:, :, None])[:, :, 0]

    def windows(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        return self._inner.windows(recorded, values)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        return self._inner.derived(recorded, values)

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        return self._inner.implausible(recorded, values)

    def untestable(self, recorded: RecordedMotion) -> str:
        return super().untestable(recorded) or self._inner.untestable(recorded)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        return self._inner.sentence(recorded, values)


def on_efforts(effect: Effect, recorded: RecordedMotion) -> Effect:
    """The effect as the efforts show it, for a recording of joint efforts without a wrench."""
    shown = effect.name in _SHOWN and recorded.effort is not None and not recorded.has("wrench")
    return LoadOnEfforts(effect) if shown else effect
