"""Values of joints that the motion of a recording does not separate from others."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from poise.mismatch.answer import Diagnosis, NamedEffect, SignalDiagnosis
from poise.mismatch.effects import laws_of_dry_friction, numbered_joints
from poise.mismatch.inference import residual_of
from poise.types import Array

_UNSURE, _SIGMAS = 0.15, 2.0
"""Share of a value that so many of its sigmas may reach."""
_SMALL = 0.1
"""Share of the usual value of the joints below which a value counts as zero."""
_OF_LAW, _CHANCE = 0.01, 9.0
"""Share of the energy that dry friction explains, and squares of the noise, by which another law may be worse: laws of
friction hold to a tenth."""
_NAMES = {"friction": "dry friction", "damping": "damping", "armature": "rotor"}


@dataclass(frozen=True)
class UnsureValue:
    """A value of a joint that other values explain nearly as well.

    Args:
        joint: its name.
        kind: friction, damping or armature.
        value: as it is exported.
        std: one sigma of it.
        motion: that would separate it.
    """

    joint: str
    kind: str
    value: float
    std: float
    motion: str

    @property
    def clause(self) -> str:
        """For people."""
        what = f"{_NAMES[self.kind]} of {self.joint}, {self.value:.3g} +- {self.std:.2g}"
        return f"{what}; this would show it: {self.motion}"

    def as_json(self) -> dict[str, object]:
        """For the answer."""
        return {"joint": self.joint, "kind": self.kind, "value": self.value, "std": self.std, "motion": self.motion}


def unsure_values(found: Diagnosis, values: Mapping[str, Mapping[str, float]]) -> tuple[UnsureValue, ...]:
    """The values whose two sigmas exceed 15 %; of values near zero, of a tenth of the usual one.

    The errors of a fit hold for its law of friction. How fast dry friction reverses is uncertain in each joint, and the
    slower, the more it resembles damping: the values under every law that is nearly as good widen the errors.

    Args:
        found: a diagnosis.
        values: see `joint_values`.
    """
    unsure = []
    for examined in found.examinations:
        findings = {each.effect.name: each for each in examined.findings}
        spread = _by_laws(examined, findings) if examined.problem.signal == "effort" else {}
        for joint, kind, std, motion in _stds(examined):
            std, value = max(std, spread.get((joint, kind), 0.0)), values.get(joint, {}).get(kind, 0.0)
            usual = float(np.median([abs(each.get(kind, 0.0)) for each in values.values()]))
            if _SIGMAS * std > _UNSURE * max(abs(value), _SMALL * usual) > 0.0:
                unsure.append(UnsureValue(joint, kind, value, std, motion))
    return tuple(unsure)


def _stds(examined: SignalDiagnosis) -> Iterator[tuple[str, str, float, str]]:
    """Joint, kind, one sigma and separating motion of each value."""
    joints = numbered_joints(examined.problem.recorded)
    for finding in examined.findings:
        for name, quantity in finding.parameters.items():
            stem, _, number = name.rpartition("_")
            if stem in finding.effect.of_joint:
                kind, motion = finding.effect.of_joint[stem], finding.effect.separating_motion
                yield joints[int(number)], kind, quantity.std, motion


def _by_laws(examined: SignalDiagnosis, findings: Mapping[str, NamedEffect]) -> dict[tuple[str, str], float]:
    """Half the range of dry friction and damping by joint, over the laws that are nearly as good."""
    dry, viscous = findings.get("coulomb_friction"), findings.get("viscous_friction")
    effort = examined.problem.recorded.effort
    if dry is None or effort is None:
        return {}
    problem, recorded = examined.problem, examined.problem.recorded
    rows, left = problem.active, residual_of(problem, examined.best)
    friction = [each for each in (dry, viscous) if each is not None]
    left = left + np.sum([each.effect.simulate(recorded, each.values) for each in friction], axis=0)
    found: dict[tuple[str, str], float] = {}
    every = [each[rows] for each in laws_of_dry_friction(recorded)]
    for j, (number, joint) in enumerate(numbered_joints(recorded).items()):
        beside = [np.ones(len(left)), np.sin(effort.position[:, j]), np.cos(effort.position[:, j]), effort.rigid[:, j]]
        beside += [effort.acceleration[:, j]] * ("motor_inertia" in findings)
        beside += [effort.velocity[:, j]] * (viscous is not None)
        now = [dry.values[f"torque_{number}"]]
        if viscous is not None:
            now.append(viscous.values[f"damping_{number}"])
        ranges = _ranges([each[:, j] for each in every], np.column_stack(beside)[rows], left[rows, j], now)
        found |= {(joint, kind): half for kind, half in zip(("friction", "damping"), ranges, strict=False)}
    return found


def _ranges(laws: Sequence[Array], beside: Array, wanted: Array, now: Sequence[float]) -> list[float]:
    """Half the range of the coefficients of a law and of the last column beside it, where the law is nearly the best.

    Args:
        laws: (N,) the response of dry friction of 1 N m, by each law.
        beside: (N, k). wanted: (N,) N m. now: the coefficients of the answer, which count as well.
    """
    without = _solved(beside, wanted)[1]
    tried = [_solved(np.column_stack([law, beside]), wanted) for law in laws]
    least = min(square for _, square in tried)
    noise = least / len(wanted)
    allowed = least + max(_OF_LAW * (without - least), _CHANCE * noise)
    good = [[values[0], values[-1]][: len(now)] for values, square in tried if square <= allowed]
    halves: list[float] = (0.5 * np.ptp(np.array([*good, now]), axis=0)).tolist()
    return halves


def _solved(columns: Array, wanted: Array) -> tuple[Array, float]:
    values: Array = np.asarray(np.linalg.lstsq(columns, wanted, rcond=1e-9)[0], dtype=np.float64)
    rest = wanted - columns @ values
    return values, float(rest @ rest)
