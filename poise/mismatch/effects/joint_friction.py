"""Shared by effects on joint efforts: joint numbers, laws of dry friction, and typical sizes."""

from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_motion import accumulated
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


SMOOTH, SOFT, PRESLIDING = 0.0, 1.0, 2.0
"""How dry friction reverses in all joints: as tanh(v / transition), as a soft constraint of a physics engine, or along
the first distance after a reversal, as bristles that bend."""
LAW = EffectParameter("law", "", low=SMOOTH, high=PRESLIDING, linear=False, choice=True, hidden=True)
RAMPS_LEAD = EffectParameter("lead", "s", low=5e-4, high=0.1, linear=False, log=True, hidden=True)
"""The time constant of the constraint; of MuJoCo by default solref, 0.02 s, times solimp's 0.95, over 2."""
REVERSAL_DEFAULTS: Values = {"law": SMOOTH, "lead": 0.0095, "ramp": 0.02, "presliding": 2e-3}
_SIZES = {PRESLIDING: ("presliding", np.geomspace(1e-4, 0.03, 10)), SOFT: ("ramp", np.geomspace(0.004, 0.8, 12))}
"""Distances and ramps that are tried, by law."""
_OF_LAW = {SMOOTH: ("transition",), SOFT: ("lead", "ramp_"), PRESLIDING: ("presliding_",)}
"""Stems of the parameters of each law alone."""
_STILL = 2e-3
"""Share of the usual speed of a joint below which it stands still: its path would be noise."""

_ALIKE = 0.1
"""Largest relative difference of constant efforts and of the weight that a turned base would have."""


def reversal_parameters(recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
    """Of the law by which dry friction reverses, see `reversal`.

    `ramp`: the speed up to which the soft friction of a joint grows; `presliding`: see `presliding_sense`.
    """
    kinds = (("ramp", "rad/s", 5e-4, 3.0), ("presliding", "rad", 1e-6, 0.05))
    each = (
        EffectParameter(f"{kind}_{i}", unit, low=low, high=high, linear=False, log=True, hidden=True)
        for kind, unit, low, high in kinds
        for i in numbers(recorded)
    )
    return (TRANSITION, LAW, RAMPS_LEAD, *each)


def soft_sense(recorded: RecordedMotion, values: Values) -> Array:
    """(M, J) the law of dry friction in physics engines: a constraint at velocity level that is soft.

    MuJoCo's friction loss is min(max((v + lead a) / ramp, -1), 1): the ramp is longer the lighter the joint is
    (Todorov 2014, "Convex and analytically-invertible dynamics with contacts and constraints").
    """
    track = efforts(recorded)
    return soft_ramp(track.velocity, track.acceleration, values["lead"], of_joints(recorded, values, "ramp"))


def soft_ramp(velocity: Array, acceleration: Array, lead: Array | float, ramp: Array | float) -> Array:
    """(M, ...) the sense of soft friction, -1 to 1, with the lead, s, and the ramp, rad/s or m/s, of each column."""
    return np.asarray(np.clip((velocity + lead * acceleration) / ramp, -1.0, 1.0))


def stated_sense(velocity: Array, acceleration: Array, lead: Array | float, ramp: Array | float) -> Array:
    """(M, ...) the sense of friction that a model states: soft along its ramp, sharp where it states none (0)."""
    soft = soft_ramp(velocity, acceleration, lead, np.maximum(ramp, 1e-9))
    return np.where(np.greater(ramp, 0.0), soft, np.tanh(velocity / COULOMB_TRANSITION))


def presliding_sense(recorded: RecordedMotion, values: Values) -> Array:
    """(M, J) the law of bristles: after a reversal, dry friction approaches its size along the path of the joint.

    dy/dx = (sign(dx) - y) / d, with the distance d of each joint (Dahl 1976, "Solid friction damping of mechanical
    vibrations"; de Wit et al. 1995 with stiff bristles), exact between samples; y = 0 at the first.
    """
    path = recorded.once("path of the joints", lambda: path_of_joints(efforts(recorded)))
    return bristles(path, of_joints(recorded, values, "presliding"))


def bristles(path: Array, distances: Array) -> Array:
    """(M, J) how bristles bend along a path (M - 1, J), each joint with its distance (J,); see `presliding_sense`."""
    kept = np.exp(-np.abs(path) / distances)
    added = np.vstack([np.zeros((1, path.shape[1])), (1.0 - kept) * np.sign(path)])
    return np.hstack([accumulated(*pair) for pair in zip(kept.T, np.hsplit(added, path.shape[1]), strict=True)])


def bristles_along(track: EffortTrack, distances: Iterable[float]) -> list[Array]:
    """(M, J) each: how bristles bend along the path of the joints, for each distance that all of them may have."""
    path = path_of_joints(track)
    return [bristles(path, np.full(path.shape[1], distance)) for distance in distances]


def path_of_joints(track: EffortTrack) -> Array:
    """(M - 1, J) rad or m that each joint moves between samples, 0 where it stands still."""
    return np.where(np.abs(track.velocity[1:]) > _STILL * track.speeds, np.diff(track.position, axis=0), 0.0)


def reversal(recorded: RecordedMotion, values: Values) -> Array:
    """(M, J) the sense of dry friction, -1 to 1, by the law of the values."""
    if values["law"] == SOFT:
        return soft_sense(recorded, values)
    if values["law"] == PRESLIDING:
        return presliding_sense(recorded, values)
    return sense(recorded, values[TRANSITION.name])


def reversals_by_law(recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
    """Values of `reversal_parameters` from which a fit reaches every other one: smooth, bristles, soft constraint."""
    common = {p.name: REVERSAL_DEFAULTS[p.name.partition("_")[0]] for p in reversal_parameters(recorded)[1:]}
    for start in transitions():
        yield {**common, **start}
    common[TRANSITION.name] = COULOMB_TRANSITION
    for law, likely in likely_reversals(recorded, residual).items():
        yield {**common, **likely, "law": law}


class DryFriction(Effect):
    """Dry friction with the parameters of `reversal`: it reverses by one of three laws."""

    dry = True

    def general_at(self, start: Values) -> bool:
        """Real drives follow no engine's law, whose ramps can imitate other effects."""
        return start["law"] == SOFT

    def inert(self, values: Values) -> tuple[str, ...]:
        others = tuple(stem for law, stems in _OF_LAW.items() if law != values["law"] for stem in stems)
        return tuple(name for name in values if name.startswith(others))

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        """The distances of the law of bristles."""
        names = (f"presliding_{i}" for i in numbers(recorded))
        return {name: (values[name], "rad") for name in names} if values["law"] == PRESLIDING else {}


def likely_reversals(recorded: RecordedMotion, residual: Array) -> dict[float, Values]:
    """By law the distance, or the ramp, of each joint with which its friction explains most of a residual (M, J).

    They are found beside what is smooth.
    """
    track = efforts(recorded)
    turned = np.hstack([np.sin(track.position), np.cos(track.position), np.ones((len(residual), 1))])
    senses = {law: np.stack(list(_reversed(recorded, law)), axis=2) for law in _SIZES}
    found: dict[float, dict[str, float]] = {law: {} for law in _SIZES}
    for j, i in enumerate(numbers(recorded)):
        beside = np.column_stack([turned, track.velocity[:, j], track.acceleration[:, j], track.rigid[:, j]])
        smooth = np.linalg.qr(beside)[0]
        left = residual[:, j] - smooth @ (smooth.T @ residual[:, j])
        for law, (stem, sizes) in _SIZES.items():
            dry = senses[law][:, j] - smooth @ (smooth.T @ senses[law][:, j])
            won = (left @ dry) ** 2 / np.maximum((dry**2).sum(axis=0), 1e-9 * len(dry))
            found[law][f"{stem}_{i}"] = float(sizes[int(np.argmax(won))])
    return dict(found)


def _reversed(recorded: RecordedMotion, law: float) -> Iterable[Array]:
    """(M, J) the sense of dry friction, for each ramp or distance that all joints may have."""
    stem, sizes = _SIZES[law]
    for size in sizes.tolist():
        values = {f"{stem}_{i}": size for i in numbers(recorded)}
        yield reversal(recorded, {**values, "law": law, RAMPS_LEAD.name: REVERSAL_DEFAULTS["lead"]})


def laws_of_dry_friction(recorded: RecordedMotion) -> Iterable[Array]:
    """(M, J) how dry friction of 1 N m of each joint may reverse."""
    for start in transitions():
        yield sense(recorded, start[TRANSITION.name])
    for law in (SOFT, PRESLIDING):
        yield from _reversed(recorded, law)


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


def slides(recorded: RecordedMotion, joint: float) -> bool:
    """Whether a joint, by its number, is prismatic."""
    return joint_called(recorded, joint) in efforts(recorded).prismatic


def joint_unit(recorded: RecordedMotion, unit: str, name: str, values: Values) -> str:
    """The unit of a parameter of an effect on joints: of the joint that ends its name, of the effect's, or of all."""
    if recorded.effort is None or name == "phase":
        return unit
    number = name.rpartition("_")[2]
    one = float(number) if number.isdigit() else values.get("joint")
    return recorded.effort.unit(unit, *(() if one is None else (joint_called(recorded, one),)))


def like_a_turned_base(recorded: RecordedMotion, offsets: Array) -> str:
    """A sentence where constant efforts (J,) are those of gravity on a base that is turned; "" where they are not."""
    by_gravity, gravity = efforts(recorded).by_gravity, float(np.linalg.norm(recorded.gravity[0]))
    if by_gravity is None or np.ptp(by_gravity, axis=0).max() * gravity > _ALIKE * np.abs(offsets).max():
        return ""
    mean, down = by_gravity.mean(axis=0), np.array([0.0, 0.0, -gravity])
    change = np.linalg.lstsq(mean, offsets, rcond=1e-3)[0]
    size = float(np.linalg.norm(down + change))
    explained = np.linalg.norm(mean @ change - offsets) < _ALIKE * np.linalg.norm(offsets)
    if not explained or abs(size / gravity - 1.0) > _ALIKE:
        return ""
    angle = np.degrees(np.arccos(np.clip((down + change) @ down / (size * gravity), -1.0, 1.0)))
    return f" The weight does the same if the base is turned by {angle:.0f} degrees against its description."
