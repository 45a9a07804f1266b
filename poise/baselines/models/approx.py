"""Model `approx`: each object by itself (thesis section 5.4; Nadeau and Kelly 2025), contact forces from a QR."""

import numpy as np

from poise.assembly import Analysis
from poise.assembly.robustness import LimitLoads, PlainMovement, RobustnessModel
from poise.assembly.statics import BlockGeometry, Deadline, Loads
from poise.baselines.robustness import (
    SampledContacts,
    point_robustness,
    single_pushes,
    topple,
    toppling_axes,
    whole_geometry,
)
from poise.types import Array, Indices


def approx(analysis: Analysis, loads: Loads, deadline: Deadline) -> LimitLoads:
    """Robustness of each object alone: all its interfaces resist together, and none carries anything else.

    Its own error: what rests on the object, and what the object rests on, is left out (30 % on the stack, 44 % on the
    table of the thesis' Table 4.1).

    Raises:
        InputError: BAD_INPUT for several forces at once.
    """
    loads = single_pushes(loads, "approx")
    structure = analysis.structure
    geometry = whole_geometry(structure)
    limit_loads = LimitLoads.start(loads.count)
    for body, place in enumerate(structure.movable):
        rows = np.flatnonzero(loads.place == place)
        if deadline.passed:
            limit_loads.give_up(np.flatnonzero(np.isin(loads.place, structure.movable[body:])))
            break
        if not len(rows):
            continue
        contacts = _alone(geometry, body, place)
        local = np.einsum("kij,qj->qki", contacts.frames, loads.wrench[rows, :3])
        slips = point_robustness(contacts.forces, local, contacts.friction).sum(axis=1)
        for row, value in zip(rows.tolist(), slips.tolist(), strict=True):
            if np.isfinite(value):
                motion = {place: np.append(loads.wrench[row, :3], np.zeros(3))}
                limit_loads.limit_by(row, value, value, PlainMovement(motion, "slip"))
        axes = toppling_axes(contacts, frozenset([place]), check_closure=False)
        if axes is not None:
            topple(limit_loads, structure, axes, loads, rows)
    return limit_loads


def _alone(geometry: BlockGeometry, body: int, place: int) -> SampledContacts:
    """The contacts of one object, which is the first body of all of them, with the forces that carry its weight."""
    rows = np.flatnonzero((geometry.bodies == body).any(axis=1))
    side = np.where(geometry.bodies[rows, 0] == body, 1.0, -1.0)
    frames = side[:, None, None] * geometry.frames[rows]
    bodies: Indices = np.stack([np.full(len(rows), place), np.full(len(rows), -1)], axis=1)
    return SampledContacts(
        points=geometry.points[rows] * geometry.units.length + geometry.units.origin,
        frames=frames,
        friction=geometry.friction[rows],
        bodies=bodies,
        starts=np.flatnonzero(np.diff(geometry.interface[rows], prepend=-1)),
        forces=qr_forces(geometry.points[rows], frames, geometry.gravity[body]) * geometry.units.weight,
    )


def qr_forces(points: Array, frames: Array, load: Array) -> Array:
    """(K, 3) least forces that a body presses with at points under a load (6,) (thesis eq. 5.6-5.8).

    Erratum: eq. 5.6 factors [B_1 ... B_K]; the forces of eq. 5.7 and 5.8 come from the QR of its transpose. Where
    these balance nothing (points in a line), the least squares are taken. Pulls are possible, as the thesis says.
    """
    wrenches = np.concatenate([frames, np.cross(points[:, None], frames)], axis=2).reshape(-1, 6)
    q, r = np.linalg.qr(wrenches)
    if wrenches.shape[0] < 6 or np.abs(np.diag(r)).min() < 1e-9 * np.abs(np.diag(r)).max():
        return np.asarray(np.linalg.lstsq(wrenches.T, load, rcond=1e-9)[0]).reshape(-1, 3)
    return np.asarray(q @ np.linalg.solve(r.T, load)).reshape(-1, 3)


entry = RobustnessModel(
    "approx", "each object alone, with the least contact forces (thesis section 5.4)", approx, several_forces=False
)
