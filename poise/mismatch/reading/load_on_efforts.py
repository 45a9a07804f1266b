"""Effects of the load, the base and the encoders, as joint efforts show them."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from poise.geometry import applied
from poise.mismatch.effects import (
    FEWEST_SPLINES,
    MAX_SPLINES,
    Effect,
    EffectParameter,
    ExternalVibration,
    UnreportedBaseMotion,
    Values,
    like_a_turned_base,
)
from poise.mismatch.recorded import RecordedMotion, at_times, joint_torques, wrench_of_torques
from poise.types import Array

_EVENTS = ("mass_step", "mass_leak", "contact")
"""Events that happen to the load."""
_OF_EFFORTS = ("signal", "needs")
"""Attributes that an effect on efforts has of its own."""
_CALM = 0.05
"""s, one sigma of the filter that removes the noise of a wrench."""


class _OnEfforts(Effect):
    """An effect of the wrench on the joint efforts, under the same name and with the same parameters."""

    signal = "effort"

    def __init__(self, inner: Effect) -> None:
        self._inner = inner
        vars(self).update({name: getattr(inner, name) for name in Effect.__annotations__ if name not in _OF_EFFORTS})
        vars(self)["needs"] = ("joints", "effort")

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        return self._inner.parameters(recorded)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        return self._inner.derived(recorded, values)

    def renewed(self, values: Values) -> Values:
        return self._inner.renewed(values)

    def law(self, values: Values) -> str:
        return self._inner.law(values)

    def free(self, values: Values) -> bool:
        return self._inner.free(values)

    def general_at(self, start: Values) -> bool:
        return self._inner.general_at(start)

    def inert(self, values: Values) -> tuple[str, ...]:
        return self._inner.inert(values)

    def twins(self, recorded: RecordedMotion, values: Values) -> tuple[str, ...]:
        return self._inner.twins(recorded, values)

    def windows(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        return self._inner.windows(recorded, values)

    def unsettled(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        return self._inner.unsettled(recorded, values)

    def imitated(self, recorded: RecordedMotion, values: Values) -> str:
        return self._inner.imitated(recorded, values)

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

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        said = self._inner.sentence(recorded, values)
        if self.name != "world_force":
            return said
        return said + like_a_turned_base(recorded, self.simulate(recorded, values).mean(axis=0))

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        if self._straight(recorded):
            return recorded.once(("on efforts", self.name), lambda: self._columns(recorded, nonlinear))
        return self._columns(recorded, nonlinear)

    def _columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        return joint_torques(recorded, self._inner.columns(recorded, nonlinear))

    def _straight(self, recorded: RecordedMotion) -> bool:
        """Whether it is linear in all parameters: its columns then depend on the motion alone."""
        return self.layer == "load" and all(p.linear for p in self.parameters(recorded))

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        if self._straight(recorded):
            linear = np.array([values[p.name] for p in self.parameters(recorded)])
            return applied(self.columns(recorded, values), linear)
        return joint_torques(recorded, self._inner.simulate(recorded, values)[:, :, None])[:, :, 0]

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """An event of free course that acts at the end of its reach follows what other effects leave of the joints."""
        places = [p for p in self.parameters(recorded) if self.free(values) and p.unit == "m" and p.name in values]
        if any(p.at_end(values[p.name]) for p in places):
            return "it would act at the end of its reach"
        return self._inner.implausible(recorded, values)

    def untestable(self, recorded: RecordedMotion) -> str:
        return super().untestable(recorded) or self._inner.untestable(recorded)


class TiltOnEfforts(_OnEfforts):
    """A tilted base on the efforts that carry the arm, to first order in the tilt."""

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        inner = (p for p in self._inner.parameters(recorded) if not p.choice)
        return tuple(EffectParameter(p.name, p.unit, p.scale, low=p.low, high=p.high) for p in inner)

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        track, gravity = recorded.effort, float(np.linalg.norm(recorded.gravity[0]))
        axes = recorded.axes_of_base(track.seconds) if track is not None and nonlinear.get("on_base") else np.eye(3)
        by_tilt = None if track is None else track.by_tilt(gravity, axes)
        return super().columns(recorded, nonlinear) if by_tilt is None else by_tilt

    def untestable(self, recorded: RecordedMotion) -> str:
        return super().untestable(recorded) or _unknown_mass(recorded)


class OffsetOnEfforts(_OnEfforts):
    """Wrong zeros of encoders on the efforts that carry the arm, to first order in the offsets."""

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        track, joints = recorded.effort, recorded.joints
        if track is None or joints is None:
            return super().columns(recorded, nonlinear)
        out = np.zeros((*track.measured.shape, len(joints.names)))
        out[:, :, [joints.names.index(name) for name in track.names]] = -track.by_position
        return out


class MotionOnEfforts(_OnEfforts):
    """An unreported motion of the base on the efforts of arm and load: for them gravity turns, to first order.

    Args:
        inner: the motion.
        splines: of its speed, at the most.
    """

    def __init__(self, inner: UnreportedBaseMotion, splines: int = MAX_SPLINES) -> None:
        super().__init__(inner)
        self._motion, self._splines = inner, splines

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        inner = self._motion.parameters(recorded)
        return inner[: len(inner) - 2 * (MAX_SPLINES - self._splines)]

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """From the accelerations that explain the residual (M, J) of the efforts."""
        by_motion, seconds = by_acceleration(recorded)
        level = _acceleration(by_motion[:, :, :2], residual)
        for start in self._motion.moves(recorded, at_times(seconds, level, recorded.seconds)):
            yield {**start, "splines": float(min(start["splines"], self._splines))}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        by_motion, seconds = by_acceleration(recorded)
        rows, rates = self._motion.rates(seconds, nonlinear)
        out = np.zeros((*by_motion.shape[:2], 2 * self._splines))
        waves = rates[:, None, :, None] * by_motion[rows, :, None, :2]
        out[rows, :, : 2 * rates.shape[1]] = waves.reshape(len(rows), by_motion.shape[1], 2 * rates.shape[1])
        return out

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        unused = (p.name for p in self._motion.parameters(recorded) if p.name not in values)
        return self._motion.implausible(recorded, {**dict.fromkeys(unused, 0.0), **values})

    def untestable(self, recorded: RecordedMotion) -> str:
        return super().untestable(recorded) or _unknown_mass(recorded)


class VibrationOnEfforts(_OnEfforts):
    """A vibration of the base on the efforts of arm and load: for them gravity oscillates."""

    def __init__(self, inner: ExternalVibration) -> None:
        super().__init__(inner)
        self._vibration = inner

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """Lines in the accelerations that explain the residual (M, J) of the efforts."""
        by_motion, seconds = by_acceleration(recorded)
        shake = at_times(seconds, _acceleration(by_motion, residual), recorded.seconds)
        yield from self._vibration.oscillations(recorded, shake)

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        by_motion, seconds = by_acceleration(recorded)
        answer = by_motion @ recorded.axes_of_base(seconds)
        waves = self._vibration.waves(seconds, nonlinear)
        return np.asarray((waves[:, None, :, None] * answer[:, :, None, :]).reshape(*answer.shape[:2], 6))

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        return self._vibration.implausible(recorded, values)

    def untestable(self, recorded: RecordedMotion) -> str:
        measured = recorded.accelerometer is not None
        felt = "the accelerometer on the sensor measures it, and there is no wrench that responds" if measured else ""
        return super().untestable(recorded) or felt or _unknown_mass(recorded)


def _unknown_mass(recorded: RecordedMotion) -> str:
    """Why the base's motion does not show in the efforts; "" where it does."""
    known = recorded.effort is not None and recorded.effort.by_gravity is not None
    return "" if known else "the mass of the arm is not known"


def by_acceleration(recorded: RecordedMotion) -> tuple[Array, Array]:
    """(M, J, 3) efforts by the acceleration of the base along the axes of the world, and their stamps (M,)."""
    track = recorded.effort
    if track is None or track.by_gravity is None:
        return np.zeros((0, 0, 3)), np.zeros(0)
    return -track.by_gravity, track.seconds


def _acceleration(by_motion: Array, residual: Array) -> Array:
    """(M, k) m/s2: the least accelerations that explain a residual (M, J) of efforts with columns (M, J, k)."""
    square = np.einsum("mjx,mjy->mxy", by_motion, by_motion)
    count = square.shape[1]
    square += (0.01 * float(np.trace(square.mean(axis=0))) + 1e-12) * np.eye(count)
    return np.asarray(np.linalg.solve(square, np.einsum("mjx,mj->mx", by_motion, residual)[:, :, None])[:, :, 0])


_OF_THE_ARM: dict[str, type[_OnEfforts]] = {"base_tilt": TiltOnEfforts, "joint_offset": OffsetOnEfforts}
"""Effects on the arm's own weight: its efforts show them beside a wrench, too."""


def acting_on_efforts(effect: Effect) -> Effect | None:
    """The effect as it acts on joint efforts; None for an effect that does not reach them."""
    if effect.layer == "load" or effect.name in _EVENTS:
        return LoadOnEfforts(effect)
    if isinstance(effect, UnreportedBaseMotion):
        return MotionOnEfforts(effect)
    if isinstance(effect, ExternalVibration):
        return VibrationOnEfforts(effect)
    known = _OF_THE_ARM.get(effect.name)
    return None if known is None else known(effect)


def with_rest(recorded: RecordedMotion, wrench: Array) -> RecordedMotion:
    """The recording with the efforts (`by_rest`) of a wrench (N, 6) that no effect explains, without its fast noise."""
    if recorded.effort is None or recorded.joints is None:
        return recorded
    slow = gaussian_filter1d(wrench, _CALM / recorded.period, axis=0, mode="nearest")
    by_rest = joint_torques(recorded, slow[:, :, None])[:, :, 0]
    return replace(recorded, effort=replace(recorded.effort, by_rest=by_rest))


def on_efforts(effect: Effect, recorded: RecordedMotion) -> Effect:
    """The effect as the efforts show it, for a recording of joint efforts without a wrench.

    A wrong zero of an encoder and a tilted base turn the arm's own weight, which a wrench does not show.
    """
    alone = not recorded.has("wrench")
    if recorded.effort is None or not (alone or effect.name in _OF_THE_ARM):
        return effect
    if isinstance(effect, UnreportedBaseMotion):
        return MotionOnEfforts(effect, FEWEST_SPLINES)
    return acting_on_efforts(effect) or effect
