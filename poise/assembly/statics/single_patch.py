"""Model `patch` for one body on one interface: its wrench is known, so collapse is a root, for all loads at once."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from poise.assembly.contact import Interface
from poise.assembly.statics.friction_surface import PatchFriction, patch_friction
from poise.assembly.statics.load_factor import UNLIMITED
from poise.geometry import cross, move_wrench
from poise.kernels import COMPILED, first_slips
from poise.types import Array, Indices, Mask

# Steps in which the way to collapse is looked through for the first violation, and then closed in on.
_COARSE, _FINE = 8, 9
_FEW = 50
"""Loads up to which all steps are one array operation; of more, those after the first violation are left out."""
_OVER, _ROOT, _FAR = 1e-9, 1e-14, 0.99
"""What is more than this, in weights, is a violation; one nearer than this is found. A load is far from one where a
simple bound of the friction it needs is below this share of what there is: the table of friction errs by less."""


@dataclass(frozen=True, eq=False)
class PatchCollapse:
    """Load factors at which one body on one interface slips or topples.

    Args:
        factor: (Q,) of each load; inf where it never does.
        slips: (Q,) whether friction collapses, not the balance about an edge.
    """

    factor: Array
    slips: Mask


class SinglePatch:
    """One body on one interface: its wrench follows from balance, so the factor is the root of a scalar function.

    The centre of pressure p must stay in the convex hull of the patch, and the friction force with the moment about
    p inside the limit surface of uniform pressure (thesis eq. 4.35 with the yaw branch mu N |v|, for all axes at
    once). Taken about p, because that is where friction acts when the whole patch slides one way.
    """

    def __init__(self, interface: Interface, faces_body: bool, resting: Array) -> None:
        """Take an interface whose normal points into the body (or not), and (6,) the body's load at rest, N, N m."""
        self._friction: PatchFriction = patch_friction(interface)
        self._mu = interface.friction
        self._normal = interface.normal if faces_body else -interface.normal
        self._axes = self._friction.axes
        # 1 when (u, v, normal into the body) is right-handed.
        self._handed = 1.0 if faces_body else -1.0
        self._edges = hull_edges((interface.points - self._friction.centroid) @ self._axes.T)
        self._rest = self._demand(resting)
        self._weight = float(np.linalg.norm(resting)) or 1.0

    def _demand(self, wrench: Array) -> Array:
        """(..., 6) what the interface must supply against a wrench about the world's origin.

        Normal force N; N times the centre of pressure (2); friction (2); moment about the normal, at the centroid.
        """
        about = -move_wrench(wrench, self._friction.centroid)
        force, moment = about[..., :3], about[..., 3:]
        # A force N n at x has the moment x x N n, so n x moment = N x.
        pressure = cross(self._normal, moment) @ self._axes.T
        normal = (force @ self._normal)[..., None]
        return np.concatenate([normal, pressure, force @ self._axes.T, (moment @ self._normal)[..., None]], axis=-1)

    @cached_property
    def _demands(self) -> Array:
        """(6, 6) the columns that `_demand` makes of unit wrenches."""
        return self._demand(np.eye(6)).T

    def collapse(self, loads: Array) -> PatchCollapse:
        """Factors of loads (Q, 6), N and N m about the world's origin, on top of the load at rest."""
        demand = self._demands @ loads.T
        size = np.sqrt(np.einsum("ij,ij->j", demand, demand))
        demand *= self._weight / np.where(size > 0, size, 1.0)
        # Along rest (1 - t) + demand t the factor runs from 0 at t = 0 to infinity at t = 1.
        top = self._topple(demand)
        end = self._first_slip(demand, top)
        slips = end < top
        with np.errstate(divide="ignore"):
            factor = end / (1 - end) * np.where(size > 0, self._weight / size, np.inf)
        factor[size == 0] = np.inf
        return PatchCollapse(factor, slips)

    def allowed_by_limit(self, loads: Array, factor: Array) -> Mask:
        """(Q,) whether limit analysis surely holds loads (Q, 6) at these factors (Q,); a sufficient test.

        Two distributions that limit analysis may choose from, both with the given centre of pressure: uniform pressure
        on the patch shrunk towards that centre until it is its centroid, and two points on a line along the nearest
        edge, at equal distances from it.
        """
        large = np.where(np.isfinite(factor), factor, 1e9) * (1 - 1e-9)
        supply = self._demands @ loads.T
        supply *= large
        supply += self._rest[:, None]
        normal = np.maximum(supply[0], 1e-12 * self._weight)
        inward, offset = self._edges
        slack = inward @ (supply[1:3] / normal) - offset[:, None]  # (E, Q), as all that is looked through by edge
        moment = self._moment(supply, normal)
        with np.errstate(divide="ignore", invalid="ignore"):
            shrunk = np.fmin.reduce(slack / -offset[:, None])
            u, v = inward.T.take(slack.argmin(axis=0), axis=1)  # across the nearest edge
            rates = np.abs(inward[:, 1:] * u - inward[:, :1] * v)
            reach = np.where(rates > 1e-9, slack / rates, np.inf).min(axis=0)
            couple = np.where(moment == 0, 0.0, np.abs(moment) * self._friction.size / reach)
        spread = self._friction.surface.normal_force_needed(supply[3:5].T, moment / np.maximum(shrunk, 1e-9))
        along, across = supply[4] * u - supply[3] * v, supply[3] * u + supply[4] * v
        paired = np.hypot(along, np.abs(across) + couple)
        most = self._mu * normal * (1 + 1e-6)
        return np.asarray((shrunk >= 0) & ((spread <= most) | (paired <= most)))

    def _moment(self, supply: Array, normal: Array) -> Array:
        """(Q,) moment about the centre of pressure that friction must supply (6, Q), per size of the patch."""
        lever = self._handed * (supply[1] * supply[4] - supply[2] * supply[3]) / normal
        return np.asarray(self._handed * (supply[5] - lever) / self._friction.size)

    def _topple(self, demand: Array) -> Array:
        """(Q,) t at which the centre of pressure reaches the edge; 1 where it never does; demand (6, Q)."""
        inward, offset = self._edges
        start = np.maximum(self._rest[1:3] @ inward.T - self._rest[0] * offset, 1e-15 * self._weight)
        # How fast each edge is neared, per how far off it is at rest: the fastest is reached first.
        rates = np.vstack([-offset, inward.T]) / -start
        fastest = (rates.T @ demand[:3]).max(axis=0)
        return np.where(fastest > UNLIMITED, 1 / (1 + np.maximum(fastest, 0.0)), 1.0)

    def _excess(self, way: Array, t: Array) -> Array:
        """(Q,) normal force wanting for friction, in weights, at rest + way t; way (6, Q)."""
        supply = self._supply(way, t)
        normal = np.maximum(supply[0], 1e-12 * self._weight)
        needed = self._friction.surface.normal_force_needed(supply[3:5].T, self._moment(supply, normal))
        return np.asarray((needed - self._mu * normal) / self._weight)

    def _first_slip(self, demand: Array, top: Array) -> Array:
        """(Q,) the first t up to `top` at which friction is exhausted; `top` where there is none; demand (6, Q)."""
        end, way = top.copy(), demand - self._rest[:, None]
        if COMPILED and len(top) > _FEW:
            return first_slips(way, top, self._rest, *self._friction.surface.for_kernel, self._numbers)
        found = self._bracketed if len(top) > _FEW else self._bracketed_at_once
        rows, low, high, f_high = found(way, top)
        if len(rows):
            some = way.take(rows, axis=1)
            end[rows] = self._root(some, low, self._excess(some, low), high, f_high)
        return end

    @cached_property
    def _numbers(self) -> tuple[float, ...]:
        """As the kernel takes them."""
        friction = self._friction
        return friction.surface.radius, friction.size, self._handed, self._mu, self._weight

    def _bracketed_at_once(self, way: Array, top: Array) -> tuple[Indices, Array, Array, Array]:
        """As `_bracketed`, of few loads: all steps in one array operation."""
        steps = np.linspace(0, 1, _COARSE + 1)[1:, None] * top
        steps[-1] = _just_inside(top)
        found = self._excess(np.tile(way, len(steps)), steps.ravel()).reshape(steps.shape)
        over = found > _OVER
        rows = np.flatnonzero(over.any(axis=0))
        first = over.argmax(axis=0)[rows]
        low = np.where(first > 0, steps[first - 1, rows], 0.0)
        return rows, low, steps[first, rows], found[first, rows]

    def _bracketed(self, way: Array, top: Array) -> tuple[Indices, Array, Array, Array]:
        """Between which steps (R,) friction is exhausted first, and the excess at the second, of those loads (R,)."""
        rows, low, found = np.arange(len(top)), np.zeros(len(top)), []
        for share in np.linspace(0, 1, _COARSE + 1)[1:].tolist():
            t = share * top if share < 1 else _just_inside(top)
            near = np.flatnonzero(self._near_slip(way, t))
            excess = self._excess(way.take(near, axis=1), t.take(near))
            over = excess > _OVER
            hit = near[over]
            found.append((rows[hit], low[hit], t[hit], excess[over]))
            left = np.ones(len(rows), dtype=bool)
            left[hit] = False
            rows, low, top, way = rows[left], t[left], top[left], way.compress(left, axis=1)
            if not len(rows):
                break
        rows, low, high, f_high = (np.concatenate(each) for each in zip(*found, strict=True))
        return rows, low, high, f_high

    def _supply(self, way: Array, t: Array) -> Array:
        supply = way * t
        supply += self._rest[:, None]
        return supply

    def _near_slip(self, way: Array, t: Array) -> Mask:
        """(Q,) whether `_excess` may be above 0: friction for the force and for the moment, one by one, is too much."""
        supply = self._supply(way, t)
        normal = np.maximum(supply[0], 1e-12 * self._weight)
        turning = np.abs(self._moment(supply, normal)) / self._friction.surface.radius
        flat = np.sqrt(supply[3] * supply[3] + supply[4] * supply[4])
        return np.asarray(flat + turning > _FAR * self._mu * normal)

    def _root(self, way: Array, low: Array, f_low: Array, high: Array, f_high: Array) -> Array:
        """(Q,) the last t found with no `_excess`, between one (Q,) without and one with it."""
        end, rows = low.copy(), np.arange(len(low))
        for _ in range(_FINE):  # Illinois regula falsi
            middle = low - f_low * (high - low) / np.where(f_high > f_low, f_high - f_low, 1.0)
            middle = np.clip(middle, low, high)
            f_middle = self._excess(way.take(rows, axis=1), middle)
            above = f_middle > 0
            f_low = np.where(above, f_low / 2, f_middle)
            f_high = np.where(above, f_middle, f_high / 2)
            low, high = np.where(above, low, middle), np.where(above, middle, high)
            end[rows] = low
            left = above | (f_middle < -_ROOT)
            if not left.any():
                break
            rows = rows[left]
            low, high, f_low, f_high = (each[left] for each in (low, high, f_low, f_high))
        return end

    def mechanism(self, load: Array, factor: float, slips: bool) -> Array:
        """(6,) velocity at the world's origin and angular velocity of the body as it collapses to one load (6,)."""
        supply = self._rest + factor * self._demand(load)
        pressure = supply[1:3] / max(supply[0], 1e-12 * self._weight)
        if slips:
            turn = supply[5] - self._handed * (pressure[0] * supply[4] - pressure[1] * supply[3])
            motion = self._friction.surface.motion(supply[3:5], self._handed * turn / self._friction.size)
            velocity = -motion[:2] @ self._axes
            angular = -self._handed * motion[2] / self._friction.size * self._normal
            pivot = self._friction.centroid + pressure @ self._axes
        else:
            inward, offset = self._edges
            edge = int((pressure @ inward.T - offset).argmin())
            # Turning about the edge lifts what is inside of it.
            angular = cross(inward[edge] @ self._axes, self._normal)
            velocity = np.zeros(3)
            pivot = self._friction.centroid + offset[edge] * inward[edge] @ self._axes
        return np.concatenate([velocity - cross(angular, pivot), angular])


def _just_inside(top: Array) -> Array:
    """(Q,) the last t that is looked at: at the edge the normal force may be 0."""
    return np.where(top < 1, top * (1 - 1e-9), 1.0)


def hull_edges(points: Array) -> tuple[Array, Array]:
    """Inward normals (E, 2) and offsets (E,), n . x >= offset inside, of a polygon, a line or a point (P, 2)."""
    if len(points) == 1:
        inward = np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1]])
        return inward, inward @ points[0]
    if len(points) == 2:
        along = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
        across = np.array([-along[1], along[0]])
        inward = np.stack([along, -along, across, -across])
        return inward, np.array(
            [inward[0] @ points[0], inward[1] @ points[1], inward[2] @ points[0], inward[3] @ points[0]]
        )
    runs = np.roll(points, -1, axis=0) - points
    keep = np.linalg.norm(runs, axis=1) > 1e-12
    runs, points = runs[keep], points[keep]
    inward = np.stack([-runs[:, 1], runs[:, 0]], axis=1) / np.linalg.norm(runs, axis=1)[:, None]
    if np.mean((points.mean(axis=0) - points) * inward) < 0:
        inward = -inward
    return inward, np.einsum("ij,ij->i", inward, points)
