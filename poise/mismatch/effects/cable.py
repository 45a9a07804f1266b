"""Cable: a hose or a cord pulls the tool towards a point, as a spring with damping."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from poise.geometry import cross, lengths
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_wrench import beside_errors, coarsely, likely_place
from poise.mismatch.recorded import RecordedMotion, forces_at
from poise.types import Array, Mask

_ANCHOR = ("anchor_x", "anchor_y", "anchor_z")
_HOOK = ("x", "y", "z")
_CORD = (*_ANCHOR, "rest_length", *_HOOK, "damping_time")
_LEAST_WAY = 0.02
"""m that the tool must travel to change a cable's length."""
_APART, _SAMPLES = 0.03, 600
"""s between the samples from which anchors are searched; their number where that gives more."""
_DISTANCES = (0.3, 0.7, 1.2, 2.0)
"""m, along the mean force, of anchors from which the search begins: the lines of small motions hardly meet."""
_SLACK, _TAUT = (0.0, 0.3, 0.6), 0.3
"""Shares of the samples in which the cord is slack; a cord that is always taut is shorter by a share of the way."""
_REFINED, _STEPS, _ROUGHLY, _KEPT = 3, 40, 1e-3, 2
"""Cords that are refined, steps of each, relative changes of cord and error that end them, and starting points."""
_UNDAMPED, _USUAL, _MOST = 1e-3, 0.05, 2.0
"""s, damping relative to stiffness: of a cord that is as good as undamped, from which a search begins, and the most."""
_FARTHEST = 3.0
"""m from the middle of the path to an anchor."""


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
    rough = True

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        place, _ = _hook(recorded, dict.fromkeys(_HOOK, 0.0) | {"on_base": 0.0})
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
            EffectParameter("rest_length", "m", low=0.0, high=4.0, linear=False, vanishes=True),
            EffectParameter(
                "damping_time", "s", low=_UNDAMPED, high=_MOST, linear=False, log=True, vanishes=True, hidden=True
            ),
            EffectParameter("stiffness", "N/m", 30.0, positive=True),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """Cords that explain the residual best, from anchors near and far; the torques give a first hook."""
        apart = max(_APART, recorded.duration / _SAMPLES)
        few, left = coarsely(recorded, residual, apart)
        weight = 1.0 / np.maximum(np.sqrt(np.mean(left**2, axis=0)), 1e-9)
        wanted = beside_errors(few, left) * weight
        hook = dict(zip(_HOOK, likely_place(left[:, :3], left[:, 3:]).tolist(), strict=True))
        for on_base in (0.0, 1.0) if recorded.base is not None else (0.0,):

            def pulled(cord: Array, on_base: float = on_base) -> tuple[_Line, Array, float]:
                """A cord, its pull (N, 6) beside errors, and its best stiffness."""
                line = _line(few, _cord(cord, on_base))
                pull = beside_errors(few, line.wrench) * weight
                stiffness = max(float(np.vdot(pull, wanted)), 0.0) / max(float(np.vdot(pull, pull)), 1e-12)
                return line, pull, stiffness

            def unexplained(cord: Array) -> Array:
                _, pull, stiffness = pulled(cord)
                return np.asarray((wanted - stiffness * pull).ravel())

            def slopes(cord: Array) -> Array:
                """(6 N, 8) of `unexplained`, whose stiffness follows the cord (variable projection; Kaufman 1975)."""
                line, pull, stiffness = pulled(cord)
                change = line.slopes(few, np.sign(cord[[3, 7]]))
                flat = beside_errors(few, change.reshape(len(few), -1)).reshape(change.shape)
                flat = (flat * weight[:, None]).reshape(-1, len(cord))
                along = pull.ravel() / max(float(np.linalg.norm(pull)), 1e-12)
                return np.asarray(-stiffness * (flat - np.outer(along, along @ flat)))

            place, turn = _hook(few, hook | {"on_base": on_base})
            force = np.einsum("nij,nj->ni", turn, left[:, :3])
            tried = [np.array([*cord, *hook.values(), _USUAL]) for cord in _likely_cords(place, force)]
            tried.sort(key=lambda cord: float(np.sum(unexplained(cord) ** 2)))
            refined = [
                least_squares(unexplained, cord, slopes, max_nfev=_STEPS, x_scale="jac", ftol=_ROUGHLY, xtol=_ROUGHLY)
                for cord in tried[:_REFINED]
            ]
            refined.sort(key=lambda each: float(each.cost))
            middle = place.mean(axis=0)
            near = [each.x for each in refined if float(np.linalg.norm(each.x[:3] - middle)) < _FARTHEST]
            yield from (_cord(cord, on_base) for cord in (*near, tried[0])[:_KEPT])

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        return _line(recorded, nonlinear).wrench[:, :, None]

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        del recorded
        return {"damping": (values["stiffness"] * values["damping_time"], "N s/m")}

    def renewed(self, values: Values) -> Values:
        """Models of earlier versions state the damping instead of its share of the stiffness."""
        if "damping" not in values or "damping_time" in values:
            return values
        return {**values, "damping_time": values["damping"] / max(values["stiffness"], 1e-9)}

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


@dataclass(frozen=True, eq=False)
class _Line:
    """A cord of stiffness 1 N/m at every sample.

    Args:
        hook: (3,) in the sensor.
        rotation_frame_sensor: (N, 3, 3); the frame is that of the anchor.
        toward_in_frame: (N, 3) unit vectors from the hook to the anchor.
        length, tension: (N,) m, N.
        taut, share: (N,) whether it is taut, and how much of the sample.
        speed: (N,) m/s, of the length.
        damping_time: s.
    """

    hook: Array
    rotation_frame_sensor: Array
    toward_in_frame: Array
    length: Array
    tension: Array
    taut: Mask
    share: Array
    speed: Array
    damping_time: float

    @property
    def wrench(self) -> Array:
        """(N, 6) N and N m, on the sensor."""
        return forces_at(self.hook, self.tension[:, None] * self.toward_in_sensor)

    @cached_property
    def toward_in_sensor(self) -> Array:
        """(N, 3) unit vectors from the hook to the anchor."""
        return np.asarray(np.einsum("nji,nj->ni", self.rotation_frame_sensor, self.toward_in_frame))

    def slopes(self, recorded: RecordedMotion, signs: Array) -> Array:
        """(N, 6, 8) derivative of the wrench by the values of `_CORD`; the share that is taut counts as constant.

        Args:
            recorded: the motion.
            signs: (2,) of the search's rest length and damping time.
        """
        toward, pulls = self.toward_in_sensor, self.tension > 0.0
        # By anchor and hook: how the way between them changes, and the cord's length.
        ways = np.concatenate(
            [self.rotation_frame_sensor.swapaxes(1, 2), np.broadcast_to(-np.eye(3), (len(toward), 3, 3))], axis=2
        )
        longer = np.concatenate([self.toward_in_frame, -toward], axis=1)
        rate = np.gradient(longer, recorded.seconds, axis=0) * self.share[:, None]
        tighter = (self.taut[:, None] * longer + self.damping_time * rate) * pulls[:, None]
        turning = (self.tension / np.maximum(self.length, 1e-6))[:, None]
        found = np.empty((len(toward), 6, len(_CORD)))
        moved = toward[:, :, None] * (tighter - turning * longer)[:, None] + turning[:, None] * ways
        found[:, :3, :3], found[:, :3, 4:7] = moved[:, :, :3], moved[:, :, 3:]
        found[:, :3, 3] = toward * (-signs[0] * (self.taut & pulls))[:, None]
        found[:, :3, 7] = toward * (signs[1] * self.share * self.speed * pulls)[:, None]
        found[:, 3:] = cross(self.hook[:, None], found[:, :3], axis=-2)
        found[:, 3:, 4:7] += cross(np.eye(3), (self.tension[:, None] * toward)[:, :, None], axis=-2)
        return found


def _line(recorded: RecordedMotion, values: Values) -> _Line:
    """A cord with these non-linear values."""
    place, rotation = _hook(recorded, values)
    away = np.array([values[name] for name in _ANCHOR]) - place
    length = lengths(away)
    taut = length > values["rest_length"]
    stretch = np.where(taut, length - values["rest_length"], 0.0)
    speed = np.gradient(length, recorded.seconds)
    # The sample in which the cord goes taut counts in part: the response is then smooth in the length.
    share = (length - values["rest_length"]) / (np.abs(speed) * recorded.period + 1e-9) + 0.5
    share = np.clip(share, 0.0, 1.0)
    tension = np.maximum(stretch + values["damping_time"] * share * speed, 0.0)  # a cord cannot push
    hook = np.array([values[name] for name in _HOOK])
    toward = away / np.maximum(length, 1e-6)[:, None]
    return _Line(hook, rotation, toward, length, tension, taut, share, speed, values["damping_time"])


def _hook(recorded: RecordedMotion, values: Values) -> tuple[Array, Array]:
    """(N, 3) the hook, in the world or in the base's frame, and rotation (N, 3, 3) from the sensor to that frame."""
    hook = np.array([values[name] for name in _HOOK])
    rotation, place = recorded.rotation_world_sensor, recorded.position_in_world
    if values["on_base"] > 0.5 and recorded.base is not None:
        turn = recorded.base.rotation_world_base
        rotation = np.einsum("nji,njk->nik", turn, rotation)
        place = np.einsum("nji,nj->ni", turn, place - recorded.base.position_in_world)
    return place + rotation @ hook, rotation


def _cord(numbers: Array, on_base: float) -> dict[str, float]:
    """The non-linear values of a cord."""
    values = dict(zip(_CORD, numbers.tolist(), strict=True))
    damping_time = float(np.clip(abs(values["damping_time"]), _UNDAMPED, _MOST))
    return {"on_base": on_base, **values, "rest_length": abs(values["rest_length"]), "damping_time": damping_time}


def _likely_cords(place: Array, force: Array) -> list[Array]:
    """(4,) anchors and rest lengths of cords from places (N, 3) that may explain forces (N, 3)."""
    middle, pull = place.mean(axis=0), force.mean(axis=0)
    along = pull / max(float(np.linalg.norm(pull)), 1e-9)
    found = []
    for anchor in (_meeting(place, force), *(middle + distance * along for distance in _DISTANCES)):
        length = np.linalg.norm(anchor - place, axis=1)
        rests = np.quantile(length, _SLACK) - _TAUT * np.equal(_SLACK, 0.0) * float(np.ptp(length))
        found += [np.append(anchor, max(float(rest), 0.0)) for rest in rests]
    return found


def _meeting(place: Array, force: Array) -> Array:
    """(3,) the point nearest to the lines of all forces by their squares: sum (|f|^2 1 - f f^T) (x - p) = 0."""
    square = np.einsum("ni,ni->n", force, force)
    across = square[:, None, None] * np.eye(3) - force[:, :, None] * force[:, None, :]
    loose = 1e-3 * float(square.sum()) / 3
    normal = across.sum(axis=0) + (loose + 1e-9) * np.eye(3)
    return np.linalg.solve(normal, np.einsum("nij,nj->i", across, place) + loose * place.mean(axis=0))
