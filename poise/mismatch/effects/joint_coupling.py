"""Joint coupling: one motor's motion needs torque in another joint."""

from collections.abc import Iterable, Sequence
from typing import ClassVar

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.joint_friction import (
    COULOMB_TRANSITION,
    column_of,
    efforts,
    joint_called,
    numbers,
    per,
    sense,
    torque_sizes,
)
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_SHARED, _OPPOSED, _ONE_WAY = 1.0, -1.0, 0.0
"""A motor that turns with the sum, or with the difference, of two joints; a joint that another one drags along."""


class JointCoupling(Effect):
    """A motor turns with two joints: T = J (a_1 + a_2) + d (v_1 + v_2) + c sign(v_1 + v_2) acts on both.

    What depends on one joint alone is that joint's own rotor and friction; the remainder is the coupling. With the
    difference of both speeds, the torque on the second joint is -T. In the one-way form a joint drags another one.
    """

    name = "joint_coupling"
    layer = "friction"
    signal = "effort"
    equation = (
        "dtau_driven = shared (inertia a_driving + damping v_driving) + friction sign(v_driven + shared v_driving), "
        "dtau_driving alike; one way: dtau_driven = inertia a_driving + damping v_driving + friction sign(v_driving)"
    )
    source = "Gautier and Khalil 1990 (motors 5 and 6 of the Staubli TX series); Siciliano et al. 2009, section 7.1"
    excited_by = "moving the driving joint while the driven one does something else"
    separating_motion = "move one joint alone, the others at rest: a coupled one needs more than its links do"
    confused_with = ("motor_inertia", "viscous_friction", "coulomb_friction")
    needs = ("effort",)
    defaults: ClassVar[Values] = {"shared": _ONE_WAY, "friction": 0.0}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        if recorded.effort is None:
            return ()
        count = float(max(numbers(recorded)))
        damping, inertia = per(recorded, "velocity"), per(recorded, "acceleration")
        return (
            *(
                EffectParameter(name, "", low=1.0, high=count, linear=False, choice=True)
                for name in ("driving", "driven")
            ),
            EffectParameter("shared", "", low=_OPPOSED, high=_SHARED, linear=False, choice=True, hidden=True),
            EffectParameter("inertia", "kg m2", float(np.median(inertia))),
            EffectParameter("damping", "N m s/rad", float(np.median(damping))),
            EffectParameter("friction", "N m", float(np.median(torque_sizes(recorded)))),
        )

    def untestable(self, recorded: RecordedMotion) -> str:
        reason = super().untestable(recorded) or ("the robot has one joint" if len(numbers(recorded)) < 2 else "")
        return reason or ("" if efforts(recorded).moves.any() else "no joint moves")

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The pair and form that explain most of the residuals beside each joint's own motion, and the next best."""
        track, known = efforts(recorded), numbers(recorded)
        moves = track.moves
        own = np.stack([track.acceleration, track.velocity, sense(recorded), np.ones_like(track.velocity)], axis=2)
        bases = [np.linalg.qr(own[:, joint])[0] for joint in range(len(known))]
        left = np.stack([residual[:, j] - q @ (q.T @ residual[:, j]) for j, q in enumerate(bases)], axis=1)
        total = np.maximum(np.sum(left**2, axis=0), 1e-12)
        scores = []
        for one in range(len(known)):
            for other in range(len(known)):
                for shared in (_ONE_WAY, _SHARED, _OPPOSED) if one != other else ():
                    if not (moves[other] or (shared and moves[one])) or (shared and other < one):
                        continue
                    pair = _torques(recorded, other, one, shared)
                    rows = [one, other] if shared else [one]
                    free = [pair[:, j] - bases[j] @ (bases[j].T @ pair[:, j]) for j in rows]
                    weight = np.sqrt(len(left) / total[rows])
                    wide = np.concatenate([part * w for part, w in zip(free, weight, strict=True)])
                    wanted = np.concatenate([left[:, j] * w for j, w in zip(rows, weight, strict=True)])
                    found = np.linalg.lstsq(wide, wanted, rcond=None)[0]
                    if _drives(recorded, other, one, shared, found):
                        continue  # the sum of two speeds and their difference act alike, one with a negative sign
                    rest = wanted - wide @ found
                    square = np.sum(rest.reshape(len(rows), -1) ** 2, axis=1) / len(left)
                    scores.append((-float(np.log(square + 1e-12).sum()), known[other], known[one], shared))
        for _, driving, driven, shared in sorted(scores, reverse=True)[:3]:
            yield {"driving": float(driving), "driven": float(driven), "shared": shared}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        driving, driven = (column_of(recorded, nonlinear[name]) for name in ("driving", "driven"))
        return _torques(recorded, driving, driven, nonlinear.get("shared", _ONE_WAY))

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """Friction takes power: that of a shared motor, and that between two joints beside their own."""
        shared = values.get("shared", _ONE_WAY)
        driving, driven = (column_of(recorded, values[name]) for name in ("driving", "driven"))
        sizes = [values[name] for name in ("inertia", "damping", "friction")]
        if not efforts(recorded).moves[[driving, driven] if shared else [driving]].any():
            return f"joint {values['driving']:.0f} stands still"
        drives = _drives(recorded, driving, driven, shared, sizes)
        drives |= not shared and abs(values["damping"]) > _most_damping(recorded, (driving, driven))
        return super().implausible(recorded, values) or ("its friction would drive the joints" if drives else "")

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        driving, driven = (joint_called(recorded, values[name]) for name in ("driving", "driven"))
        sizes = (
            f"{values['inertia']:.3g} kg m2, {values['damping']:.3g} N m s/rad and {values['friction']:.3g} N m; "
            "the nominal model's joints are not coupled."
        )
        if values.get("shared", _ONE_WAY):
            return f"A motor turns with both {driving} and {driven}: {sizes}"
        return f"The motion of {driving} needs torque in {driven}: {sizes}"


def _drives(recorded: RecordedMotion, driving: int, driven: int, shared: float, sizes: Sequence[float]) -> bool:
    """Whether the friction of a shared motor of this inertia, damping and friction would give power, two columns."""
    velocity = efforts(recorded).velocity
    speed = np.abs(velocity[:, driven] + shared * velocity[:, driving])
    return bool(shared and sizes[1] * float(np.mean(speed**2)) + sizes[2] * float(np.mean(speed)) < 0.0)


def _most_damping(recorded: RecordedMotion, pair: Sequence[int]) -> float:
    """The largest damping between two columns of joints whose own damping d explains their whole efforts, at the most.

    Together they take power for all speeds only if |d_12| <= 2 sqrt(d_1 d_2).
    """
    track = efforts(recorded)
    sizes, speeds = (track.measured[:, pair].std(axis=0), np.sqrt(np.mean(track.velocity[:, pair] ** 2, axis=0)))
    return 2.0 * float(np.sqrt(np.prod(sizes / np.maximum(speeds, 1e-9))))


def _torques(recorded: RecordedMotion, driving: int, driven: int, shared: float) -> Array:
    """(M, J, 3) response to inertia, damping and dry friction of the coupling of two columns of joints."""
    track = efforts(recorded)
    out = np.zeros((*track.velocity.shape, 3))
    speed = track.velocity[:, driving] + (shared * track.velocity[:, driven] if shared else 0.0)
    dry = np.tanh(speed / COULOMB_TRANSITION)
    sign = shared or 1.0
    for joint, other in ((driven, driving), (driving, driven)) if shared else ((driven, driving),):
        out[:, joint, 0] = sign * track.acceleration[:, other]
        out[:, joint, 1] = sign * track.velocity[:, other]
    out[:, driven, 2] = sign * dry
    if shared:
        out[:, driving, 2] = dry
    return out
