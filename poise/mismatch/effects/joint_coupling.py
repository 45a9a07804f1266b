"""Joint coupling: one motor's motion needs torque in another joint."""

from collections.abc import Iterable

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.joint_friction import column_of, efforts, joint_called, numbers, per, sense
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array


class JointCoupling(Effect):
    """tau_driven = J a_driving + d v_driving: belts and gears that run through another joint."""

    name = "joint_coupling"
    layer = "friction"
    signal = "effort"
    equation = "dtau_driven = inertia a_driving + damping v_driving"
    source = "transmissions that pass through joints (Siciliano et al. 2009, section 7.1)"
    excited_by = "moving the driving joint while the driven one does something else"
    separating_motion = "move one joint alone, the others at rest: a coupled one needs more than its links do"
    confused_with = ("motor_inertia", "viscous_friction")
    needs = ("effort",)

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        if recorded.effort is None:
            return ()
        count = float(max(numbers(recorded)))
        damping, inertia = per(recorded, recorded.effort.velocity), per(recorded, recorded.effort.acceleration)
        return (
            *(
                EffectParameter(name, "", low=1.0, high=count, linear=False, choice=True)
                for name in ("driving", "driven")
            ),
            EffectParameter("inertia", "kg m2", float(np.median(inertia))),
            EffectParameter("damping", "N m s/rad", float(np.median(damping))),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The pairs of joints that explain most of a joint's residual beside its own motion."""
        track, known = efforts(recorded), numbers(recorded)
        own = np.stack([track.acceleration, track.velocity, sense(recorded), np.ones_like(track.velocity)], axis=2)
        scores = []
        for driven in range(len(known)):
            basis = np.linalg.qr(own[:, driven])[0]
            left = residual[:, driven] - basis @ (basis.T @ residual[:, driven])
            total = max(float(left @ left), 1e-12)
            for driving in range(len(known)):
                if driving == driven:
                    continue
                pair = own[:, driving, :2]
                pair = pair - basis @ (basis.T @ pair)
                fitted = pair @ np.linalg.lstsq(pair, left, rcond=None)[0]
                share = min(float(fitted @ fitted) / total, 1.0 - 1e-9)
                scores.append((-len(left) * float(np.log1p(-share)), known[driving], known[driven]))
        for _, driving, driven in sorted(scores, reverse=True)[:3]:
            yield {"driving": float(driving), "driven": float(driven)}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        track = efforts(recorded)
        driving, driven = (column_of(recorded, nonlinear[name]) for name in ("driving", "driven"))
        out = np.zeros((*track.velocity.shape, 2))
        out[:, driven, 0], out[:, driven, 1] = track.acceleration[:, driving], track.velocity[:, driving]
        return out

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        driving, driven = (joint_called(recorded, values[name]) for name in ("driving", "driven"))
        return (
            f"The motion of {driving} needs torque in {driven}: {values['inertia']:.2f} kg m2 and "
            f"{values['damping']:.2f} N m s/rad; the nominal model's joints are not coupled."
        )
