"""Cable: a hose or a cord pulls the tool towards a point, as a spring with damping."""

from collections.abc import Iterable

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion, forces_at
from poise.types import Array

_ANCHOR = ("anchor_x", "anchor_y", "anchor_z")
_HOOK = ("x", "y", "z")
_LEAST_WAY = 0.02
"""m that the tool must travel to change a cable's length."""


class Cable(Effect):
    """A cord from a hook on the tool to an anchor: taut beyond its length, f = (k (l - l0) + c dl/dt) towards it.

    The geometry is exact: direction and length follow the tool. The anchor is fixed in the world or to the base.
    """

    name = "cable"
    layer = "load"
    equation = "f = max(k (l - l0) + c dl/dt, 0) u, l = |anchor - hook|, u its direction, zero while slack (l < l0)"
    source = "cord as a one-sided spring and damper (MuJoCo documentation, spatial tendon)"
    excited_by = "moving the tool away from and around the anchor"
    separating_motion = "circle the anchor at a constant distance, then move towards and away from it"
    confused_with = ("world_force", "payload_parameters", "joint_offset")

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        place, _ = self._hook(recorded, dict.fromkeys(_HOOK, 0.0) | {"on_base": 0.0})
        low, high = place.min(axis=0) - 3.0, place.max(axis=0) + 3.0
        anchors = (
            EffectParameter(name, "m", low=a, high=b, linear=False)
            for name, a, b in zip(_ANCHOR, low.tolist(), high.tolist(), strict=True)
        )
        hooks = (EffectParameter(name, "m", low=-0.4, high=0.4, linear=False) for name in _HOOK)
        return (
            EffectParameter("on_base", "", low=0.0, high=1.0, linear=False, choice=True, hidden=True),
            *anchors,
            *hooks,
            EffectParameter("rest_length", "m", low=0.0, high=4.0, linear=False),
            EffectParameter("stiffness", "N/m", 30.0, positive=True),
            EffectParameter("damping", "N s/m", 5.0, positive=True),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The residual forces point at the anchor: the point nearest to all their lines; then force against length."""
        for on_base in (0.0, 1.0) if recorded.base is not None else (0.0,):
            hook, turn = self._hook(recorded, dict.fromkeys(_HOOK, 0.0) | {"on_base": on_base})
            force = np.einsum("nji,nj->ni", turn, recorded.to_world(residual[:, :3]))
            square = np.einsum("ni,ni->n", force, force)
            # Weighted by the force's square: sum (|f|^2 1 - f f^T)(x - hook) = 0.
            across = square[:, None, None] * np.eye(3) - force[:, :, None] * force[:, None, :]
            normal = across.sum(axis=0) + 1e-3 * float(square.sum()) * np.eye(3) / 3
            pull = np.einsum("nij,nj->i", across, hook) + 1e-3 * float(square.sum()) / 3 * hook.mean(axis=0)
            anchor = np.linalg.solve(normal + 1e-9 * np.eye(3), pull)
            length = np.linalg.norm(anchor - hook, axis=1)
            along = np.einsum("ni,ni->n", force, anchor - hook) / np.maximum(length, 1e-6)
            slope = float(np.cov(length, along)[0, 1]) / max(float(np.var(length)), 1e-12)
            level = float(along.mean()) - slope * float(length.mean())
            rest = float(np.clip(-level / slope if slope > 0 else 0.0, 0.0, 0.98 * length.max()))
            for slack in sorted({0.7 * float(length.min()), rest, float(np.quantile(length, 0.3))}):
                yield {
                    "on_base": on_base,
                    **dict(zip(_ANCHOR, anchor.tolist(), strict=True)),
                    **dict.fromkeys(_HOOK, 0.0),
                    "rest_length": slack,
                }

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        hook, turn = self._hook(recorded, nonlinear)
        away = np.array([nonlinear[name] for name in _ANCHOR]) - hook
        length = np.linalg.norm(away, axis=1)
        toward = away / np.maximum(length, 1e-6)[:, None]
        taut = length > nonlinear["rest_length"]
        stretch = np.where(taut, length - nonlinear["rest_length"], 0.0)
        speed = np.gradient(length, recorded.seconds)
        # The sample in which the cord goes taut counts in part: the response is then smooth in the length.
        share = (length - nonlinear["rest_length"]) / (np.abs(speed) * recorded.period + 1e-9) + 0.5
        rate = np.clip(share, 0.0, 1.0) * speed
        pull = recorded.to_sensor(np.einsum("nij,nj->ni", turn, toward))
        point = np.array([nonlinear[name] for name in _HOOK])
        return np.stack([forces_at(point, pull * size[:, None]) for size in (stretch, rate)], axis=2)

    def untestable(self, recorded: RecordedMotion) -> str:
        lacking = super().untestable(recorded)
        way = float(np.ptp(recorded.position_in_world, axis=0).max())
        return lacking or ("" if way > _LEAST_WAY else f"the tool stays within {1e3 * way:.0f} mm")

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        place = ", ".join(f"{values[name]:.2f}" for name in _ANCHOR)
        return (
            f"A cable pulls the tool towards ({place}) m with {values['stiffness']:.0f} N/m beyond "
            f"{values['rest_length']:.2f} m: the nominal model has no cable."
        )

    @staticmethod
    def _hook(recorded: RecordedMotion, values: Values) -> tuple[Array, Array]:
        """(N, 3) the hook, in the world or in the base's frame, and rotation (N, 3, 3) from that frame to the world."""
        place = recorded.position_in_world + recorded.to_world(
            np.broadcast_to(np.array([values[name] for name in _HOOK]), (len(recorded), 3))
        )
        if values["on_base"] > 0.5 and recorded.base is not None:
            turn = recorded.base.rotation_world_base
            return np.einsum("nji,nj->ni", turn, place - recorded.base.position_in_world), turn
        return place, np.broadcast_to(np.eye(3), (len(recorded), 3, 3))
