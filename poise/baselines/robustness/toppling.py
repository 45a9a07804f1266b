"""Robustness to toppling as the thesis has it (section 4.4.3, Algorithm 2): cuts of the graph, axes to turn about."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from poise.assembly.contact import FIXED_NODE, Structure
from poise.assembly.robustness import LimitLoads, PlainMovement
from poise.assembly.statics import Loads
from poise.baselines.robustness.sampled import SampledContacts
from poise.types import Array, Indices

MOST_CUTS = 50_000
"""Connected sets of objects looked at; they grow exponentially with the objects."""
# Speeds of this share of the fastest are 0, directions and planes that differ by this are the same.
_SMALL = 1e-6


@dataclass(frozen=True, eq=False)
class TopplingAxes:
    """TopplingAxes about which a set of objects may topple, and what resists.

    Args:
        moving: places in `Assembly.objects`.
        origins, directions: (A, 3) a point of each, m, and its direction: the right-handed sense of turning.
        torques: (A,) that resist, N m (eq. 4.37); inf where a contact forbids the turn.
        yaw: (A,) the axis is normal to the interfaces.
    """

    moving: frozenset[int]
    origins: Array
    directions: Array
    torques: Array
    yaw: Array

    def robustness(self, wrenches: Array) -> tuple[Array, Array]:
        """(Q,) N, and the number of the axis, for pushes (Q, 6) of 1 N about the world's origin (eq. 4.38)."""
        moments = self.pushing(wrenches)
        with np.errstate(divide="ignore", invalid="ignore"):
            each = np.where(moments > 1e-9, np.maximum(self.torques, 0.0) / moments, np.inf)
        best = each.argmin(axis=1)
        return each[np.arange(len(each)), best], best

    def pushing(self, wrenches: Array) -> Array:
        """(Q, A) moment of pushes about each axis, N m."""
        about = wrenches[:, None, 3:] - np.cross(self.origins[None], wrenches[:, None, :3])
        return np.asarray(np.einsum("qai,ai->qa", about, self.directions))


def cuts(structure: Structure) -> Iterator[frozenset[int] | None]:
    """Sets of objects that may move together while all others stay: connected, and so is what is left.

    Yields None at the end when there were too many to look at.
    """
    neighbours = structure.neighbours
    seen = {frozenset([place]) for place in structure.movable}
    queue = list(seen)
    for moving in queue:
        if _rest_is_connected(structure, moving):
            yield moving
        for node in moving:
            for other in neighbours[node]:
                grown = moving | {other}
                if other != FIXED_NODE and other not in moving and grown not in seen:
                    if len(seen) >= MOST_CUTS:
                        yield None
                        return
                    seen.add(grown)
                    queue.append(grown)


def _rest_is_connected(structure: Structure, moving: frozenset[int]) -> bool:
    reached, queue = {FIXED_NODE}, [FIXED_NODE]
    while queue:
        for other in structure.neighbours[queue.pop()]:
            if other not in reached and other not in moving:
                reached.add(other)
                queue.append(other)
    return len(reached) + len(moving) == len(structure.neighbours)


def toppling_axes(contacts: SampledContacts, moving: frozenset[int], check_closure: bool = True) -> TopplingAxes | None:
    """The axes of a cut and their torques; None when it is closed by its contacts (eq. 4.31-4.33) or touches nothing.

    Args:
        contacts: of the assembly.
        moving: places of the objects that would topple.
        check_closure: leave out what is closed by form.
    """
    inside = np.isin(contacts.bodies, list(moving))
    cut = np.flatnonzero(inside[:, 0] != inside[:, 1])
    if not len(cut):
        return None
    # Normals into the moving side, and forces on it.
    side = np.where(inside[cut, 1], 1.0, -1.0)
    frames = side[:, None, None] * contacts.frames[cut]
    points, normal_forces = contacts.points[cut], contacts.forces[cut, 0]
    if check_closure and is_form_closed(points, frames):
        return None
    origins, directions = hull_axes(points)
    yaw = np.zeros(len(origins), dtype=bool)
    normals = frames[:, 0]
    friction_forces = contacts.friction[cut] * normal_forces
    if np.all(np.abs(normals @ normals[0]) > 1 - _SMALL) and friction_forces.sum() > 0:
        centre = friction_forces @ points / friction_forces.sum()
        origins = np.concatenate([origins, [centre, centre]])
        directions = np.concatenate([directions, [normals[0], -normals[0]]])
        yaw = np.append(yaw, [True, True])
    forces = np.einsum("ki,kij->kj", contacts.forces[cut], frames)
    torques = _torques(origins, directions, points, normals, forces, friction_forces)
    return TopplingAxes(moving, origins, directions, torques, yaw)


def _torques(
    origins: Array, directions: Array, points: Array, normals: Array, forces: Array, friction_forces: Array
) -> Array:
    """(A,) what contacts at rest resist about each axis (thesis eq. 4.34-4.37).

    Errata: the moment vector is v = a x p, not p x a (eq. 4.34); a point that slides resists by mu N |v| (eq. 4.35 has
    its force along the push, which cancels over an interface that turns in its plane).
    """
    v = np.cross(directions[:, None], points[None] - origins[:, None])  # eq. 4.34
    speed = np.linalg.norm(v, axis=2)
    parting = np.einsum("aki,ki->ak", v, normals)
    fastest = speed.max(axis=1, keepdims=True)
    torque = np.einsum("aki,ki->ak", v, forces) + np.where(
        np.abs(parting) <= _SMALL * fastest, friction_forces * speed, 0.0
    )
    return np.asarray(np.where(parting < -_SMALL * fastest, np.inf, torque).sum(axis=1))


def hull_axes(points: Array) -> tuple[Array, Array]:
    """(A, 3) points on and (A, 3) directions of the edges of the convex hull of points, each in both senses."""
    centred = points - points.mean(axis=0)
    _, sizes, basis = np.linalg.svd(centred, full_matrices=False)
    rank = int((sizes > _SMALL * max(float(sizes[0]), 1e-12)).sum()) if len(points) > 1 else 0
    if rank == 0:
        return np.zeros((0, 3)), np.zeros((0, 3))
    if rank == 1:
        along = centred @ basis[0]
        ends = np.array([[along.argmin(), along.argmax()]])
    elif rank == 2:
        corners = ConvexHull(centred @ basis[:2].T).vertices
        ends = np.stack([corners, np.roll(corners, -1)], axis=1)
    else:
        ends = _ridges(ConvexHull(points))
    starts, runs = points[ends[:, 0]], points[ends[:, 1]] - points[ends[:, 0]]
    runs = runs / np.linalg.norm(runs, axis=1)[:, None]
    return np.concatenate([starts, starts]), np.concatenate([runs, -runs])


def _ridges(hull: ConvexHull) -> Indices:
    """(E, 2) edges at which a hull's facets bend; those that only triangulate a facet are left out."""
    found = set()
    for facet, (corners, others) in enumerate(zip(hull.simplices, hull.neighbors, strict=True)):
        for corner, other in enumerate(others):
            if hull.equations[facet, :3] @ hull.equations[other, :3] < 1 - _SMALL:
                found.add(tuple(sorted(np.delete(corners, corner).tolist())))
    return np.array(sorted(found), dtype=np.int64).reshape(-1, 2)


def is_form_closed(points: Array, frames: Array) -> bool:
    """Whether contacts allow no motion, as if nothing slid (thesis eq. 4.31-4.33).

    Erratum: with tangential columns of both signs this is force closure under unlimited friction, not form closure: a
    cube between two walls counts as closed, though it slides up.

    Args:
        points: (K, 3) m.
        frames: (K, 3, 3) rows: normal into the moving side, two tangents.
    """
    axes = np.concatenate([frames, -frames[:, 1:]], axis=1).reshape(-1, 3)
    at = np.repeat(points - points.mean(axis=0), 5, axis=0)
    wrenches = np.concatenate([axes, np.cross(at, axes)], axis=1).T  # eq. 4.32
    if np.linalg.matrix_rank(wrenches) < 6:
        return False
    found = linprog(np.ones(wrenches.shape[1]), A_eq=wrenches, b_eq=np.zeros(6), bounds=(1, None), method="highs")
    return bool(found.status == 0)


def topple(limit_loads: LimitLoads, structure: Structure, axes: TopplingAxes, loads: Loads, rows: Indices) -> None:
    """Lower what some pushes (rows) bear to what topples about these axes (eq. 4.38)."""
    if not len(rows) or not len(axes.origins):
        return
    values, best = axes.robustness(loads.wrench[rows])
    for row, value, axis in zip(rows.tolist(), values.tolist(), best.tolist(), strict=True):
        if value < limit_loads.upper[row]:
            spin, origin = axes.directions[axis], axes.origins[axis]
            objects = structure.assembly.objects
            velocities = {
                place: np.append(np.cross(spin, objects[place].com_in_world - origin), spin)
                for place in sorted(axes.moving)
            }
            limit_loads.limit_by(row, value, value, PlainMovement(velocities, "slip" if axes.yaw[axis] else "topple"))
