"""Cable: a hose or a cord pulls the tool towards a point, as a spring with damping."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from poise.geometry import applied, cross, lengths, sphere_directions
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_wrench import coarsely, likely_place
from poise.mismatch.effects.recorded_channels import RecordedChannels
from poise.mismatch.recorded import RecordedMotion, efforts_alone, forces_at, joint_torques
from poise.types import Array, Mask

_ANCHOR = ("anchor_x", "anchor_y", "anchor_z")
_HOOK = ("x", "y", "z")
_CORD = (*_ANCHOR, "rest_length", *_HOOK, "damping_time")
_LEAST_WAY = 0.02
"""m that the tool must travel to change a cable's length."""
_APART, _SAMPLES = 0.03, 600
"""s between the samples from which anchors are searched; their number where that gives more."""
_DISTANCES = (0.5, 1.0, 2.0)
"""m from the middle of the path to anchors from which the search begins."""
_AROUND = 24
"""Directions from there in which they lie."""
_SLACK, _TAUT = (0.0, 0.3, 0.6), 0.3
"""Shares of the samples in which the cord is slack; a cord that is always taut is shorter by a share of the way."""
_REACH = 0.4
"""m, of the hook from the sensor, along each axis."""
_REFINED, _STEPS, _ROUGHLY, _KEPT = 3, 40, 1e-3, 3
"""Cords that are refined, steps of each, relative changes of cord and error that end them, and starting points."""
_SAME = 0.05
"""m and rad, between cords that ended at the same place."""
_UNDAMPED, _MOST, _DAMPED = 1e-3, 100.0, (0.05, 1.0)
"""s, damping relative to stiffness: of a cord that is as good as undamped, of one that hardly has a stiffness, and of
those from which the search begins."""
_SELDOM, _BRIEFLY = 0.2, 0.1
"""Shares of the samples in which a cord is taut, below which a contact is as likely, and likelier: cords of other
recordings are taut for four tenths of them and more."""
_MOVES, _SEVERAL, _ALONE = 0.1, 2, 0.9
"""rad or m from which a joint moves; moving joints of which one alone is unlikely to show a cord; and its share."""
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
        path = recorded.position_in_world
        low, high = recorded.once("corners of the path", lambda: (path.min(axis=0) - 3.0, path.max(axis=0) + 3.0))
        anchors = (
            EffectParameter(name, "m", low=a, high=b, linear=False)
            for name, a, b in zip(_ANCHOR, low.tolist(), high.tolist(), strict=True)
        )
        hooks = (EffectParameter(name, "m", low=-_REACH, high=_REACH, linear=False) for name in _HOOK)
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
        seen = RecordedChannels.of(*coarsely(recorded, residual, apart))
        few, wanted = seen.few, seen.wanted.ravel()
        for on_base in (0.0, 1.0) if recorded.base is not None else (0.0,):

            def pulled(cord: Array, on_base: float = on_base) -> tuple[_Line, Array, float]:
                """A cord, its pull (N C,) beside errors, and its best stiffness."""
                line = _line(few, _cord(cord, on_base))
                pull = seen.beside(line.wrench[:, :, None])[:, 0]
                return line, pull, max(float(pull @ wanted), 0.0) / max(float(pull @ pull), 1e-12)

            def unexplained(cord: Array) -> Array:
                _, pull, stiffness = pulled(cord)
                return np.asarray(wanted - stiffness * pull)

            def slopes(cord: Array) -> Array:
                """(N C, 8) of `unexplained`, whose stiffness follows the cord (variable projection; Kaufman 1975)."""
                line, pull, stiffness = pulled(cord)
                flat = seen.beside(line.slopes(few, np.sign(cord[[3, 7]])))
                along = pull / max(float(np.linalg.norm(pull)), 1e-12)
                return np.asarray(-stiffness * (flat - np.outer(along, along @ flat)))

            tried = _likely_cords(seen, on_base)
            refined = [
                least_squares(unexplained, cord, slopes, max_nfev=_STEPS, x_scale="jac", ftol=_ROUGHLY, xtol=_ROUGHLY)
                for cord in tried
            ]
            refined.sort(key=lambda each: float(each.cost))
            middle = _hook(few, _cord(tried[-1], on_base))[0].mean(axis=0)
            near = [_nearer(each, middle) for each in _distinct([each.x for each in refined])[:_KEPT]]
            yield from (_cord(cord, on_base) for cord in (*near, tried[-1]))

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

    def twins(self, recorded: RecordedMotion, values: Values) -> tuple[str, ...]:
        """A cord that is hardly ever taut pulls as something that is touched pushes: its direction hardly changes.

        One that loads a single joint of several moving ones acts like something that bends with this joint.
        """
        seldom = ("contact",) if _taut(recorded, values) < _SELDOM else ()
        bends = efforts_alone(recorded) is not None and _on_one_joint(recorded, self.simulate(recorded, values))
        return (*seldom, "unknown:joint_position") if bends else seldom

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        taut = _taut(recorded, values)
        brief = f"it would be taut for {100 * taut:.0f} % of the time, as a contact" if taut < _BRIEFLY else ""
        return super().implausible(recorded, values) or brief

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


def _on_one_joint(recorded: RecordedMotion, wrench: Array) -> bool:
    """Whether one of several moving joints alone shows a wrench (N, 6), as a share of what the model leaves there."""
    track = recorded.effort
    if track is None or np.count_nonzero(np.ptp(track.position, axis=0) > _MOVES) < _SEVERAL:
        return False
    left = np.mean((track.measured - track.prediction) ** 2, axis=0)
    shares = np.mean(joint_torques(recorded, wrench[:, :, None])[:, :, 0] ** 2, axis=0) / np.maximum(left, 1e-300)
    return bool(shares.max() > _ALONE * shares.sum())


def _taut(recorded: RecordedMotion, values: Values) -> float:
    """Share of the samples in which a cord pulls."""
    return float(np.mean(_line(recorded, values).tension > 0.0))


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
    return place + applied(rotation, hook), rotation


def _cord(numbers: Array, on_base: float) -> dict[str, float]:
    """The non-linear values of a cord."""
    values = dict(zip(_CORD, numbers.tolist(), strict=True))
    damping_time = float(np.clip(abs(values["damping_time"]), _UNDAMPED, 0.5 * _MOST))
    return {"on_base": on_base, **values, "rest_length": abs(values["rest_length"]), "damping_time": damping_time}


def _distinct(cords: Sequence[Array]) -> list[Array]:
    """Cords without those that ended where an earlier one did."""
    found: list[Array] = []
    for cord in cords:
        if all(np.abs(cord - other).max() > _SAME for other in found):
            found.append(cord)
    return found


def _nearer(cord: Array, middle: Array) -> Array:
    """A cord (8,) with an anchor within reach of the middle (3,) of the path: a longer one hardly pulls otherwise."""
    way = cord[:3] - middle
    distance = float(np.linalg.norm(way))
    if distance <= _FARTHEST:
        return cord
    nearer = middle + way * (_FARTHEST / distance)
    return np.array([*nearer, max(abs(cord[3]) - distance + _FARTHEST, 0.0), *cord[4:]])


def _likely_cords(seen: RecordedChannels, on_base: float) -> list[Array]:
    """(8,) cords that explain most of a residual, of many anchors with the hook that suits each; last, a steady pull.

    The wrench of a cord is linear in its stiffness and in stiffness times hook, if the hook hardly changes its length.

    Args:
        seen: the residual.
        on_base: whether the anchor moves with the base.
    """
    few, left = seen.few, seen.left
    place, turn = _hook(few, dict.fromkeys(_HOOK, 0.0) | {"on_base": on_base})
    around = np.multiply.outer(_DISTANCES, sphere_directions(_AROUND)).reshape(-1, 3)
    anchors = np.vstack([_meeting(place, np.einsum("nij,nj->ni", turn, left[:, :3])), place.mean(axis=0) + around])
    away = anchors[:, None] - place
    length = lengths(away)  # (A, N)
    rests = np.quantile(length, _SLACK, axis=1) - np.outer(np.equal(_SLACK, 0.0), _TAUT * np.ptp(length, axis=1))
    stretch = length - np.maximum(rests, 0.0)[:, :, None]  # (S, A, N)
    speed = np.gradient(length, few.seconds, axis=1)
    tension = np.array([np.maximum(stretch + time * speed, 0.0) * (stretch > 0.0) for time in _DAMPED])
    toward = np.einsum("nji,anj->ain", turn, away / np.maximum(length, 1e-6)[:, :, None])
    pull = (tension[:, :, :, None] * toward).reshape(-1, 3, len(few))
    normal, right = seen.by_size_and_place(pull)
    solved = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
    # Joint efforts do not show the whole torque, and hooks from it may be anywhere.
    steady = np.concatenate([[1.0], likely_place(left[:, :3], left[:, 3:])])
    along, size = np.maximum(right @ steady, 0.0), np.einsum("i,kij,j->k", steady, normal, steady)
    steadily = (along / size)[:, None] * steady
    found: list[Array] = []
    for scaled in (solved, steadily):
        falls = np.einsum("kj,kj->k", scaled, right) * (scaled[:, 0] > 0.0)
        best: dict[int, Array] = {}
        for k in np.argsort(-falls)[: np.count_nonzero(falls > 0.0)]:
            time, slack, anchor = np.unravel_index(k, tension.shape[:3])
            hook = np.clip(scaled[k, 1:] / scaled[k, 0], -0.9 * _REACH, 0.9 * _REACH)
            rest = max(float(rests[slack, anchor]), 0.0)
            best.setdefault(int(anchor), np.array([*anchors[anchor], rest, *hook, _DAMPED[time]]))
            if len(best) == _REFINED:
                break
        found += best.values()
    # A force that hardly changes is an error of the bias, too: nothing of it is left beside errors.
    force = np.einsum("nij,nj->i", turn, left[:, :3])
    anchor = place.mean(axis=0) + force / max(float(np.linalg.norm(force)), 1e-9)
    return [*found, np.array([*anchor, 0.5, *steady[1:], _UNDAMPED])]


def _meeting(place: Array, force: Array) -> Array:
    """(3,) the point nearest to the lines of all forces by their squares: sum (|f|^2 1 - f f^T) (x - p) = 0."""
    square = np.einsum("ni,ni->n", force, force)
    across = square[:, None, None] * np.eye(3) - force[:, :, None] * force[:, None, :]
    loose = 1e-3 * float(square.sum()) / 3
    normal = across.sum(axis=0) + (loose + 1e-9) * np.eye(3)
    return np.linalg.solve(normal, np.einsum("nij,nj->i", across, place) + loose * place.mean(axis=0))
