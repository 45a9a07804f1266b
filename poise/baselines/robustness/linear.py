"""Models `lp4` and `lp8`: one linear program per push (thesis eq. 4.44-4.48; Maeda et al. 2009, Chen et al. 2021)."""

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import block_diag, csr_array, hstack

from poise.assembly import Analysis
from poise.assembly.contact import Structure
from poise.assembly.robustness import LimitLoads, PlainMovement
from poise.assembly.statics import BlockGeometry, Deadline, Loads, polygon_rows
from poise.baselines.robustness.sampled import whole_geometry
from poise.errors import ErrorCode, NoAnswerError
from poise.types import Array

_MOST = 1e7
"""Weights of the assembly; larger load factors count as infinite."""
# Objects slower than this share of the fastest are at rest.
_STILL = 1e-4


def linear_model(sides: int, analysis: Analysis, loads: Loads, deadline: Deadline) -> LimitLoads:
    """Limit loads with friction circles as inscribed polygons with a number of sides."""
    geometry = whole_geometry(analysis.structure)
    body_of = {place: body for body, place in enumerate(analysis.structure.movable)}
    inside = csr_array(block_diag([polygon_rows(mu, sides) for mu in geometry.friction]))
    inside = csr_array(hstack([inside, csr_array((inside.shape[0], 1))]))
    limit_loads = LimitLoads.start(loads.count)
    for question in range(loads.count):
        if deadline.passed:
            limit_loads.give_up(np.arange(question, loads.count))
            break
        load = np.zeros((geometry.count, 6))
        for row in np.flatnonzero(loads.question == question).tolist():
            if int(loads.place[row]) in body_of:
                load[body_of[int(loads.place[row])]] += geometry.units.of_wrench(loads.wrench[row])
        if not load.any():
            continue
        value, twist = _largest(geometry, inside, load.ravel())
        if np.isfinite(value):
            limit_loads.limit_by(question, value, value, _movement(geometry, analysis.structure, twist))
    return limit_loads


def _largest(geometry: BlockGeometry, inside: csr_array, load: Array) -> tuple[float, Array]:
    """The largest factor on a load (6 n,) that contact forces balance, by HiGHS, and the multipliers of balance."""
    size = float(np.abs(load).max())
    balance = hstack([geometry.grasp, csr_array(load[:, None] / size)])
    unknowns = balance.shape[1]
    cost = np.zeros(unknowns)
    cost[-1] = -1.0
    bounds = np.full((unknowns, 2), (-np.inf, np.inf))
    bounds[-1] = 0.0, _MOST
    found = linprog(
        cost,
        A_ub=inside,
        b_ub=np.zeros(inside.shape[0]),
        A_eq=balance,
        b_eq=-geometry.gravity.ravel(),
        bounds=bounds,
        method="highs",
        options={"time_limit": 30.0},
    )
    if found.status == 2:  # infeasible: 0, as the thesis has it
        return 0.0, np.zeros(load.shape)
    if found.status != 0:
        raise NoAnswerError(ErrorCode.SOLVER_FAILED, f"the linear program stopped: {found.message}")
    value = -found.fun
    return (np.inf if value > 0.99 * _MOST else value / size), np.asarray(found.eqlin.marginals)


def _movement(geometry: BlockGeometry, structure: Structure, multipliers: Array) -> PlainMovement:
    """The collapse mechanism: the multipliers of balance, up to their sign."""
    twists = multipliers.reshape(-1, 6)
    speeds = np.abs(twists).max(axis=1)
    velocities = {}
    for place, speed, velocity in zip(structure.movable, speeds, geometry.units.velocity(twists), strict=True):
        if speed > _STILL * speeds.max():
            com = structure.assembly.objects[place].com_in_world
            velocities[place] = np.append(velocity[:3] + np.cross(velocity[3:], com), velocity[3:])
    return PlainMovement(velocities, "mixed")
