"""Shared by effects on joint efforts: joint numbers, sign of motion, and typical sizes."""

from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.recorded import EffortTrack, RecordedMotion
from poise.types import Array

COULOMB_TRANSITION = 0.005
"""rad/s, the usual width of the transition in the sign of a joint's velocity."""
TRANSITION = EffectParameter("transition", "rad/s", low=5e-4, high=0.15, linear=False, log=True)
"""The fitted width, one for all joints: bristles, belts and the control loop make dry friction reverse smoothly."""


def transitions() -> Iterable[Values]:
    """Widths from which a fit reaches every other one."""
    for width in (0.003, 0.015, 0.06):
        yield {TRANSITION.name: width}


RAMPS_LAW = EffectParameter("law", "", low=0.0, high=1.0, linear=False, choice=True, hidden=True)
"""0: dry friction reverses as tanh(v / transition) in all joints; 1: as a soft constraint of a physics engine."""
RAMPS_LEAD = EffectParameter("lead", "s", low=5e-4, high=0.1, linear=False, log=True, hidden=True)
"""The time constant of the constraint; of MuJoCo by default solref, 0.02 s, times solimp's 0.95, over 2."""
RAMP_DEFAULTS: Values = {"law": 0.0, "lead": 0.0095, "ramp": 0.02}
_RAMPS = np.geomspace(0.004, 0.8, 12)
_OF_RAMPS = ("lead", "ramp_")
"""Stems of the parameters of the soft constraint alone."""


def ramps(recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
    """The speed, rad/s, up to which the soft friction of each joint grows."""
    return tuple(
        EffectParameter(f"ramp_{i}", "rad/s", low=5e-4, high=3.0, linear=False, log=True, hidden=True)
        for i in numbers(recorded)
    )


def soft_sense(recorded: RecordedMotion, values: Values) -> Array:
    """(M, J) the law of dry friction in physics engines: a constraint at velocity level that is soft.

    MuJoCo's friction loss is min(max((v + lead a) / ramp, -1), 1): the ramp is longer the lighter the joint is
    (Todorov 2014, "Convex and analytically-invertible dynamics with contacts and constraints").
    """
    track = efforts(recorded)
    widths = of_joints(recorded, values, "ramp")
    return np.asarray(np.clip((track.velocity + values["lead"] * track.acceleration) / widths, -1.0, 1.0))


def reversal_parameters(recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
    """Of the law by which dry friction reverses, see `reversal`."""
    return (TRANSITION, RAMPS_LAW, RAMPS_LEAD, *ramps(recorded))


def reversal(recorded: RecordedMotion, values: Values) -> Array:
    """(M, J) the sense of dry friction, -1 to 1, by either law: smooth about rest, or a soft constraint."""
    return soft_sense(recorded, values) if values["law"] else sense(recorded, values[TRANSITION.name])


def reversals_by_law(recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
    """Values of `reversal_parameters` from which a fit reaches every other one; the soft constraint comes last."""
    common = {p.name: RAMP_DEFAULTS["ramp"] for p in ramps(recorded)}
    common |= {name: RAMP_DEFAULTS[name] for name in ("law", "lead")}
    for start in transitions():
        yield {**common, **start}
    soft = likely_ramps(recorded, residual)
    yield {**common, **soft, "law": 1.0, TRANSITION.name: COULOMB_TRANSITION}


class TwoLawFriction(Effect):
    """Dry friction with the parameters of `reversal`: it reverses by either law."""

    dry = True

    def general_at(self, start: Values) -> bool:
        """Real drives follow no engine's law, whose ramps can imitate other effects."""
        return bool(start["law"])

    def inert(self, values: Values) -> tuple[str, ...]:
        return (TRANSITION.name,) if values["law"] else tuple(name for name in values if name.startswith(_OF_RAMPS))


def likely_ramps(recorded: RecordedMotion, residual: Array) -> Values:
    """The ramp of each joint with which soft friction explains most of a residual (M, J), beside what is smooth."""
    track = efforts(recorded)
    turned = np.hstack([np.sin(track.position), np.cos(track.position), np.ones((len(residual), 1))])
    found = {}
    for j, i in enumerate(numbers(recorded)):
        beside = np.column_stack([turned, track.velocity[:, j], track.acceleration[:, j], track.rigid[:, j]])
        smooth = np.linalg.qr(beside)[0]
        ahead = track.velocity[:, j] + RAMP_DEFAULTS["lead"] * track.acceleration[:, j]
        dry = np.clip(ahead[:, None] / _RAMPS, -1.0, 1.0)
        dry -= smooth @ (smooth.T @ dry)
        left = residual[:, j] - smooth @ (smooth.T @ residual[:, j])
        won = (left @ dry) ** 2 / np.maximum((dry**2).sum(axis=0), 1e-9 * len(dry))
        found[f"ramp_{i}"] = float(_RAMPS[int(np.argmax(won))])
    return found


def laws_of_dry_friction(recorded: RecordedMotion, joint: int) -> Iterable[Array]:
    """(M,) how dry friction of 1 N m of a joint (its column) may reverse: smoothly, or as a soft constraint."""
    track = efforts(recorded)
    velocity = track.velocity[:, joint]
    for start in transitions():
        yield np.tanh(velocity / start[TRANSITION.name])
    ahead = velocity + RAMP_DEFAULTS["lead"] * track.acceleration[:, joint]
    for ramp in _RAMPS:
        yield np.clip(ahead / ramp, -1.0, 1.0)


def efforts(recorded: RecordedMotion) -> EffortTrack:
    """The joint efforts of a recording that has them.

    Raises:
        ValueError: when it has none; effects on effort are then `untestable`.
    """
    if recorded.effort is None:
        raise ValueError("this recording has no joint efforts")
    return recorded.effort


def numbers(recorded: RecordedMotion) -> tuple[int, ...]:
    """The numbers of the joints with a measured effort; 1 is at the base."""
    if recorded.effort is None:
        return ()
    names = recorded.effort.names
    arm = names if recorded.joints is None or not set(names) <= set(recorded.joints.names) else recorded.joints.names
    return tuple(arm.index(name) + 1 for name in names)


def numbered_joints(recorded: RecordedMotion) -> dict[int, str]:
    """The joints with a measured effort by their numbers."""
    names = () if recorded.effort is None else recorded.effort.names
    return dict(zip(numbers(recorded), names, strict=True))


def sense(recorded: RecordedMotion, width: float = COULOMB_TRANSITION) -> Array:
    """(M, J) sign of the velocity, smooth through zero within a width in rad/s."""
    return np.tanh(efforts(recorded).velocity / width)


def each_joint(values: Array) -> Array:
    """(M, J, J) columns that act on one joint each, from (M, J)."""
    count = np.arange(values.shape[1])
    columns = np.zeros((*values.shape, len(count)))
    columns[:, count, count] = values
    return columns


def of_joints(recorded: RecordedMotion, values: Values, name: str) -> Array:
    """(J,) the values of a parameter that each joint has."""
    return np.array([values[f"{name}_{i}"] for i in numbers(recorded)])


def in_model(recorded: RecordedMotion, what: str) -> tuple[float, ...]:
    """(J) the friction, damping or armature of the joints that the nominal model has already."""
    if recorded.effort is None:
        return ()
    return tuple(getattr(each, what) for each in recorded.effort.stated) or (0.0,) * len(recorded.effort.names)


def lacking(recorded: RecordedMotion, what: str, words: str) -> str:
    """What the nominal model lacks, as a clause that ends a sentence."""
    return f"the nominal model has {'too little or too much' if any(in_model(recorded, what)) else 'no'} {words}"


def torque_sizes(recorded: RecordedMotion) -> Array:
    """(J,) a typical friction: a third of the usual measured effort, as wrists need little effort for anything else."""
    if recorded.effort is None:
        return np.zeros(0)
    usual = _usual(recorded, recorded.effort, "measured")
    return np.asarray(0.3 * np.maximum(usual, 0.02 * usual.max(initial=0.0)) + 1e-6)


def per(recorded: RecordedMotion, rates: Literal["velocity", "acceleration"]) -> Array:
    """(J,) sizes of a coefficient that maps these rates of the joints to torques."""
    usual = _usual(recorded, efforts(recorded), rates)
    return np.asarray(torque_sizes(recorded) / np.maximum(usual, max(0.05 * float(usual.max(initial=0.0)), 1e-3)))


def _usual(recorded: RecordedMotion, track: EffortTrack, what: str) -> Array:
    """(J,) the size that nine tenths of its values do not exceed, from a tenth of them where there are many."""
    values: Array = getattr(track, what)
    few = values[:: max(len(values) // 1000, 1)]
    return recorded.once(("usual", what), lambda: np.asarray(np.quantile(np.abs(few), 0.9, axis=0)))


def joint_called(recorded: RecordedMotion, number: float) -> str:
    """The name of a joint by its number."""
    return numbered_joints(recorded).get(round(number), f"joint {number:.0f}")


def column_of(recorded: RecordedMotion, number: float) -> int:
    """The column of a joint's number among the efforts; 0 for a joint that is absent."""
    known = numbers(recorded)
    return known.index(round(number)) if round(number) in known else 0


def listed(recorded: RecordedMotion, values: Sequence[float], unit: str) -> str:
    """Values by joint, the largest first, without much smaller ones: 'elbow_joint 5.1, wrist_1_joint 1 N m'."""
    track = efforts(recorded)
    ranked = sorted(zip(values, track.names, strict=True), key=lambda item: -abs(item[0]))
    shown = [(name, value) for value, name in ranked[:3] if abs(value) >= 0.15 * abs(ranked[0][0])]
    units = [track.unit(unit, name) for name, _ in shown]
    if len(set(units)) > 1:
        return ", ".join(f"{name} {value:.3g} {own}" for (name, value), own in zip(shown, units, strict=True))
    return f"{', '.join(f'{name} {value:.3g}' for name, value in shown)} {units[0]}"


def joint_unit(recorded: RecordedMotion, unit: str, name: str, values: Values) -> str:
    """The unit of a parameter of an effect on joints: of the joint that ends its name, of the effect's, or of all."""
    if recorded.effort is None or name == "phase":
        return unit
    number = name.rpartition("_")[2]
    one = float(number) if number.isdigit() else values.get("joint")
    return recorded.effort.unit(unit, *(() if one is None else (joint_called(recorded, one),)))
