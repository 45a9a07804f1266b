"""Link parameters: masses, centres of mass and inertias of the links differ from those of the robot description."""

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.joint_friction import efforts, listed, numbers
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_OTHER_ROBOT = 0.5
"""Change of all efforts, relative to those of the description, from which that may be of another robot."""


class LinkParameters(Effect):
    """The effort is linear in the base parameters: the sets of inertial parameters that act independently.

    Each parameter counts relative to its typical size: the link's mass, times reach, times reach squared. A parameter
    also represents those of other links that act in the same way.
    """

    name = "link_parameters"
    layer = "friction"
    signal = "effort"
    equation = "dtau = Y(q, q', q'') dphi, Y: columns of the independent base parameters"
    source = "Gautier 1991 (base parameters by QR); Khalil and Dombre 2002, section 12"
    excited_by = "gravity in many postures; accelerations of all joints"
    separating_motion = "slow strokes of each joint over its whole range with the others folded, then quick ones"
    confused_with = (
        "payload_parameters",
        "motor_gain",
        "motor_inertia",
        "effort_offset",
        "series_elasticity",
        "joint_offset",
        "base_tilt",
    )
    needs = ("effort",)
    widens = "links"
    general = True

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        return tuple(EffectParameter(name, "", 0.3, hidden=True) for name in _base(recorded)[0])

    def untestable(self, recorded: RecordedMotion) -> str:
        lacking = "" if _base(recorded)[0] else "the links need no visible effort"
        return super().untestable(recorded) or lacking

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        return _base(recorded)[1]

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        change = np.sqrt(np.mean(self.simulate(recorded, values) ** 2, axis=0))
        return {f"rms_{i}": (float(c), "N m") for i, c in zip(numbers(recorded), change, strict=True)}

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        sizes = listed(recorded, [size for size, _ in self.derived(recorded, values).values()], "N m")
        said = f"The links differ from the robot description: the joints need other efforts, {sizes} (rms)"
        rigid, change = efforts(recorded).rigid, self.simulate(recorded, values)
        if np.linalg.norm(change) > _OTHER_ROBOT * np.linalg.norm(rigid):
            return f"{said}. That is much of what the description says: is it of this robot?"
        return f"{said}."


def _base(recorded: RecordedMotion) -> tuple[tuple[str, ...], Array]:
    links = None if recorded.effort is None else recorded.effort.links
    return links.base_parameters if links is not None else ((), np.zeros((len(recorded), 0, 0)))
