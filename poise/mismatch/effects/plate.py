"""A plate in the world that the tool presses on: the law of a contact whose place explains when and how it pushes.

The force grows with the depth of a point of the tool behind the surface (Hertz: with its power 1.5; a spring: 1), is
larger while the depth grows (Hunt and Crossley 1975, "Coefficient of restitution interpreted as damping in
vibroimpact"), and rubs against the sliding.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, nnls

from poise.geometry import applied, cross, cross_matrix, sphere_directions
from poise.mismatch.effects.base import EffectParameter, Values
from poise.mismatch.effects.part_wrench import coarsely, payload_centre
from poise.mismatch.effects.recorded_channels import RecordedChannels
from poise.mismatch.effects.starts import spans
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_POINT = ("x", "y", "z")
_SURFACE = ("surface_x", "surface_y", "surface_z")
REFINED = ("tilt_u", "tilt_v", "height", *_POINT)
"""What a search refines."""
PUSHES = ("press", "damping", "rub")
"""Sizes of the force of a smooth plate, of its growth with the speed, and of the force of the roughest plate."""
_ROUGHEST = 1.0
"""Coefficient of friction of the roughest plate: the sizes are positive, so that the force stays in its cone."""
PLATE = ("face", *_SURFACE, "tilt_u", "tilt_v", "height", "exponent", *PUSHES)
"""Parameters of a plate, beside the point of the tool."""
_UNIT, _FAST, _SLOW = 0.01, 0.1, 0.005
"""m and m/s at which `press` and `damping` are the force; m/s below which sliding friction falls."""
_HERTZ = 1.5
_REACH, _STEEPEST, _HIGHEST, _FARTHEST = 0.5, 3.0, 0.5, 100.0
"""m of the point of the tool from the sensor along each axis; tangent of the normal against the nearest axis of the
world; m of the surface from the point that it is measured from, and of that point from the world's origin."""
_SAMPLES = 500
"""In which plates are searched, at the least."""
_AROUND, _SHARES = 100, (0.01, 0.03, 0.08, 0.2)
"""Directions of the normals, and shares of the samples in which the tool touches, from which a search begins."""
_TRIED, _STEPS, _WIDER = 3, 15, 0.02
"""Plates that are refined, and steps of each; m above a surface from which on samples count."""
_LEAST = 30.0
"""Squares in units of the residual that a first guess must explain: noise gives less."""
_APPROX = 1e-3
"""Relative changes of plate and error that end a search."""
_DISTINCT = 0.85
"""Cosine between normals that are searched from separately."""
_DEEPEST, _LONGEST, _PULL = 0.1, 0.35, 0.4
"""m that a tool can press into what it touches; share of the samples in which it touches; force against the push,
relative to the largest."""


def plate_parameters() -> tuple[EffectParameter, ...]:
    """Of a plate beside the point of the tool, the linear ones last."""

    def chosen(name: str, unit: str, low: float, high: float) -> EffectParameter:
        return EffectParameter(name, unit, low=low, high=high, linear=False, choice=True, hidden=True)

    def shaped(name: str, unit: str, low: float, high: float) -> EffectParameter:
        return EffectParameter(name, unit, low=low, high=high, linear=False, hidden=True)

    return (
        chosen("face", "", 0.0, 5.0),
        *(chosen(name, "m", -_FARTHEST, _FARTHEST) for name in _SURFACE),
        *(shaped(name, "", -_STEEPEST, _STEEPEST) for name in ("tilt_u", "tilt_v")),
        shaped("height", "m", -_HIGHEST, _HIGHEST),
        shaped("exponent", "", 1.0, 2.0),
        *(EffectParameter(name, "N", 5.0, positive=True, hidden=True) for name in PUSHES),
    )


def depth_inside(recorded: RecordedMotion, values: Values) -> Array:
    """(N,) m of the point of the tool behind the surface; negative in front of it."""
    hook = np.array([values[name] for name in _POINT])
    place = recorded.position_in_world + applied(recorded.rotation_world_sensor, hook)
    surface = np.array([values[name] for name in _SURFACE])
    return np.asarray((place - surface) @ inward(values) - values["height"])


def inward(values: Values) -> Array:
    """(3,) the normal of the surface into the plate, in the world: one of six axes, tilted."""
    along, back = divmod(round(values["face"]), 2)
    axis = np.array([-1.0 if back else 1.0, values["tilt_u"], values["tilt_v"]])
    return np.asarray(np.roll(axis, along) / np.linalg.norm(axis))


def plate_wrenches(recorded: RecordedMotion, values: Values) -> Array:
    """(N, 6, 3) on the sensor by one unit of each of press, damping and rub."""
    out = np.zeros((len(recorded), 6, len(PUSHES)))
    rows, pushes = _pushes(recorded, values)
    hook = np.array([values[name] for name in _POINT])
    out[rows, :3] = pushes
    out[rows, 3:] = cross_matrix(hook) @ pushes
    return out


def _pushes(recorded: RecordedMotion, values: Values) -> tuple[NDArray[np.intp], Array]:
    """Samples (R,) inside the plate, and the forces (R, 3, 3) there by one unit of each push, in the sensor."""
    depth, normal = depth_inside(recorded, values), inward(values)
    rows = np.flatnonzero(depth > 0.0)
    turn, hook = recorded.rotation_world_sensor[rows], np.array([values[name] for name in _POINT])
    turning = np.einsum("nij,nj->ni", turn, cross(recorded.angular_velocity[rows], hook))
    velocity = recorded.velocity_in_world[rows] + turning
    closing = velocity @ normal
    level = velocity - closing[:, None] * normal
    slip = level / np.sqrt(np.sum(level**2, axis=1, keepdims=True) + _SLOW**2)
    along = np.broadcast_to(normal, slip.shape)
    pressure = (depth[rows] / _UNIT) ** values["exponent"]
    rough = along + _ROUGHEST * slip
    forces = -pressure[:, None, None] * np.stack([along, along * (closing / _FAST)[:, None], rough], axis=2)
    return rows, np.asarray(np.swapaxes(turn, 1, 2) @ forces)


def friction(values: Values) -> float:
    """Coefficient of friction of a plate."""
    return _ROUGHEST * values["rub"] / max(values["press"] + values["rub"], 1e-9)


def touches(recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
    """When the tool is inside the plate, as (start, end), s."""
    inside = depth_inside(recorded, values) > 0.0
    return tuple(spans(recorded.seconds, inside, 0.5 * recorded.period))


def no_plate(recorded: RecordedMotion, values: Values) -> str:
    """Why nothing acts like this plate, as a clause; "" where something can."""
    depth = depth_inside(recorded, values)
    share, deepest = float(np.mean(depth > 0.0)), float(depth.max())
    if share == 0.0 or share > _LONGEST:
        return f"the tool would touch it for {100 * share:.0f} % of the time"
    if deepest > _DEEPEST:
        return f"it would give way by {100 * deepest:.0f} cm"
    rows, pushes = _pushes(recorded, values)
    outward = -np.einsum("nji,j->ni", recorded.rotation_world_sensor[rows], inward(values))
    pressed = np.einsum("ni,nik->nk", outward, pushes) @ [values[name] for name in PUSHES]
    return "what it presses it would also pull" if -pressed.min() > _PULL * pressed.max() else ""


def peak_on_plate(recorded: RecordedMotion, values: Values) -> Array:
    """(3,) N, the largest force on the tool, in the world."""
    rows, pushes = _pushes(recorded, values)
    forces = pushes @ [values[name] for name in PUSHES]
    if not len(rows):
        return np.zeros(3)
    most = int(np.argmax(np.linalg.norm(forces, axis=1)))
    return np.asarray(recorded.rotation_world_sensor[rows[most]] @ forces[most])


def plate_starts(recorded: RecordedMotion, residual: Array) -> Iterator[dict[str, float]]:
    """The plate that explains the residual (N, 6) best, if one does: many are tried, and the likely ones refined."""
    few, left = coarsely(recorded, residual, recorded.period * (len(recorded) / _SAMPLES - 1.0))
    search = _PlateSearch.of(few, left)
    found = [search.refined(start) for start in search.likely()]
    possible = [each for each in found if each[0] > _LEAST and not no_plate(few, each[1])]
    if possible:
        best = max(possible, key=lambda each: each[0])[1]
        yield {name: value for name, value in best.items() if name not in PUSHES}


class _PlateSearch(RecordedChannels):
    """A residual in which plates are searched."""

    def likely(self) -> list[dict[str, float]]:
        """Plates that explain most of the residual, by their normal and the share of time in which the tool touches."""
        normals, turn = sphere_directions(_AROUND), self.few.rotation_world_sensor
        ways = np.swapaxes(normals @ turn, 1, 2)  # (N, 3, K) in the sensor
        found = []
        for hook in self._hooks():
            along = (self.few.position_in_world + turn @ hook) @ normals.T
            for share in _SHARES:
                level = np.quantile(along, 1.0 - share, axis=0)
                pull = -ways * (np.maximum((along - level) / _UNIT, 0.0) ** _HERTZ)[:, None]
                falls, places = self._explained(pull, hook)
                found += [(float(falls[k]), normals[k], share, hook, places[k]) for k in np.argsort(-falls)[:_TRIED]]
        kept: list[tuple[float, Array, float, Array, Array]] = []
        for each in sorted(found, key=lambda each: -each[0]):
            if each[0] < _LEAST or len(kept) == _TRIED:
                break
            if all(each[1] @ other[1] < _DISTINCT for other in kept):
                kept.append(each)
        # A place that torques say says little where they are noisy: the point that was tried may be better.
        starts = ([self._start(normal, share, hook) for hook in hooks] for _, normal, share, *hooks in kept)
        return [max(pair, key=self._explains) for pair in starts]

    def _start(self, normal: Array, share: float, hook: Array) -> dict[str, float]:
        """A plate inside which a point of the tool is for a share of the samples."""
        height = (self.few.position_in_world + applied(self.few.rotation_world_sensor, hook)) @ normal
        return _values(self.few, normal, hook, float(height.max() - np.quantile(height, 1.0 - share)))

    def _explains(self, values: Values) -> float:
        """How much of the square a plate explains."""
        near = self.near(values)
        target = near.wanted.ravel()
        return float(np.sum(target**2) - nnls(near.beside(plate_wrenches(near.few, values)), target)[1] ** 2)

    def _hooks(self) -> tuple[Array, ...]:
        """Points of the tool from which the search begins."""
        return np.zeros(3), 2.0 * payload_centre(self.few)

    def _explained(self, pull: Array, hook: Array) -> tuple[Array, Array]:
        """(K,) falls of the square by forces (N, 3, K), and where (K, 3) their torques say that they act."""
        if self.shows is None:
            normal, right = self.by_size_and_place(pull.transpose(2, 1, 0))
            solved = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
            falls = np.einsum("kj,kj->k", solved, right) * (solved[:, 0] > 0.0)
            places = solved[:, 1:] / np.maximum(solved[:, :1], 1e-12)
            return falls, np.clip(places, -0.9 * _REACH, 0.9 * _REACH)
        by_force = self.shows[:, :, :3] + self.shows[:, :, 3:] @ cross_matrix(hook)
        columns = np.moveaxis((by_force @ pull) * self.weight[:, None], 2, 0)  # (K, N, C)
        besides = self.errors.T @ columns
        square = np.sum(columns**2, axis=(1, 2)) - np.sum(besides**2, axis=(1, 2))
        along = np.einsum("knc,nc->k", columns, self.wanted)
        return np.maximum(along, 0.0) ** 2 / np.maximum(square, 1e-12), np.broadcast_to(hook, (len(along), 3))

    def near(self, start: Values) -> "_PlateSearch":
        """The samples near a plate."""
        return self.at(depth_inside(self.few, start) > -_WIDER)

    def refined(self, start: Values) -> tuple[float, dict[str, float]]:
        """How much of the square a plate explains near a starting point, and its values."""
        near = self.near(start)
        target = near.wanted.ravel()

        def parted(shape: Array) -> tuple[dict[str, float], Array, Array]:
            """The values, the pushes (R, 3) beside errors, and their best sizes."""
            values = {**start, **dict(zip(REFINED, shape.tolist(), strict=True))}
            columns = near.beside(plate_wrenches(near.few, values))
            return values, columns, nnls(columns, target)[0]

        def unexplained(shape: Array) -> Array:
            _, columns, sizes = parted(shape)
            return np.asarray(target - columns @ sizes)

        def slopes(shape: Array) -> Array:
            """Of `unexplained`, whose sizes follow the shape (variable projection; Kaufman 1975)."""
            values, columns, sizes = parted(shape)
            flat = near.beside(plate_slopes(near.few, values, sizes))
            held = columns[:, sizes > 0.0]
            basis = np.asarray(np.linalg.qr(held)[0])
            return np.asarray(basis @ (basis.T @ flat) - flat)

        first = np.array([start[name] for name in REFINED])
        found = least_squares(unexplained, first, slopes, max_nfev=_STEPS, x_scale="jac", ftol=_APPROX, xtol=_APPROX)
        values, _, sizes = parted(found.x)
        deepest, hook = float(depth_inside(self.few, values).max()), np.array([values[name] for name in _POINT])
        fall = float(np.sum(target**2) - 2.0 * found.cost)
        plate = _values(self.few, inward(values), np.clip(hook, -0.9 * _REACH, 0.9 * _REACH), deepest)
        return fall, plate | dict(zip(PUSHES, sizes.tolist(), strict=True))


def plate_slopes(recorded: RecordedMotion, values: Values, sizes: Array) -> Array:
    """(N, 6, 6) derivative of the wrench by `REFINED`; the direction of sliding counts as constant."""
    depth, normal = depth_inside(recorded, values), inward(values)
    rows, pushes = _pushes(recorded, values)
    turn, hook = recorded.rotation_world_sensor[rows], np.array([values[name] for name in _POINT])
    place = recorded.position_in_world[rows] + turn @ hook - [values[name] for name in _SURFACE]
    tilts = _tilts(values)
    deeper = np.concatenate([place @ tilts, -np.ones((len(rows), 1)), np.einsum("i,nij->nj", normal, turn)], axis=1)
    force = pushes @ sizes
    forces = force[:, :, None] * (values["exponent"] * deeper / depth[rows, None])[:, None]
    # The part along the normal turns with it.
    along = np.einsum("nij,i,nj->n", turn, normal, force)
    forces[:, :, :2] += along[:, None, None] * (np.swapaxes(turn, 1, 2) @ tilts)
    out = np.zeros((len(recorded), 6, len(REFINED)))
    out[rows, :3] = forces
    out[rows, 3:] = cross_matrix(hook) @ forces
    out[rows, 3:, 3:] += cross(np.eye(3), force[:, :, None], axis=-2)
    return out


def _tilts(values: Values) -> Array:
    """(3, 2) derivative of the normal by its two tilts."""
    along, back = divmod(round(values["face"]), 2)
    axis = np.array([-1.0 if back else 1.0, values["tilt_u"], values["tilt_v"]])
    normal = axis / np.linalg.norm(axis)
    change = ((np.eye(3) - np.outer(normal, normal)) / np.linalg.norm(axis))[:, 1:]
    return np.asarray(np.roll(change, along, axis=0))


def _values(few: RecordedMotion, normal: Array, hook: Array, deepest: float) -> dict[str, float]:
    """The non-linear values of a plate with a normal (3,), which a point (3,) of the tool enters by some m at most."""
    along = int(np.argmax(np.abs(normal)))
    axis = np.roll(normal, -along) / abs(normal[along])
    path = few.position_in_world + applied(few.rotation_world_sensor, hook)
    surface = path[int(np.argmax(path @ normal))] - deepest * normal
    face = 2.0 * along + (normal[along] < 0.0)
    moved = dict(zip(("tilt_u", "tilt_v"), axis[1:].tolist(), strict=True))
    points = dict(zip((*_SURFACE, *_POINT), (*surface.tolist(), *hook.tolist()), strict=True))
    return {"face": face, "exponent": _HERTZ, "height": 0.0, **moved, **points}
