"""What in an assembly can roll: motions on round sides that no contact resists but by rolling resistance."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linprog

from poise.assembly.contact import FIXED_NODE, Interface
from poise.assembly.statics.analysis import Analysis, BlockAnalysis
from poise.assembly.statics.block import BlockGeometry, block_geometry
from poise.assembly.statics.deadline import NO_DEADLINE, Deadline
from poise.geometry import plane_axes
from poise.types import Array, Mask

_FREE = 1e-7
"""Singular values, rates and motions below this, in the block's units, are 0."""
_MOVES = 1e-3
"""Share of the fastest body's motion below which another does not move."""
_MANY = 40
"""Bodies of a block beyond which each is asked alone: what rolls together only is not found then."""
_NEUTRAL = 0.05
"""Of the radius: within it the centre of mass is as high as the centre of curvature, as far as facets say."""


@dataclass(frozen=True, eq=False)
class Rolling:
    """Objects that roll together as soon as something overcomes rolling resistance.

    Args:
        objects: ids of all that moves.
        equilibrium: neutral; stable (rocks and comes back) or unstable (goes on by itself), known for objects on one
            round side.
        force: N at the centre of mass that starts it, for objects on one round side; NaN otherwise.
        coefficient: of rolling resistance, the least where they roll.
    """

    objects: tuple[str, ...]
    equilibrium: str
    force: float
    coefficient: float


def rolling(analysis: Analysis, deadline: Deadline = NO_DEADLINE) -> tuple[Rolling, ...]:
    """Everything that stands, but can roll.

    A motion counts when nothing slides or parts at an interface that presses at rest, nothing gets nearer at one that
    only touches, and something rolls: the first contact force that it meets is rolling resistance. So a cylinder
    between two chocks that touch it cannot roll; with one chock, or with gaps, it can.
    """
    return tuple(found for block in analysis.blocks for found in _of_block(block, deadline))


def _of_block(block: BlockAnalysis, deadline: Deadline) -> Iterator[Rolling]:
    if all(interface.touch is None for interface in block.interfaces):
        return
    standing, known = block.solvers.standing(deadline)
    if not known or standing.margin <= 0:
        return
    objects, members = block.structure.assembly.objects, block.block.members
    groups: list[set[int]] = []
    for moved in _moved_bodies(block):
        joined = moved.union(*(group for group in groups if group & moved))
        groups = [group for group in groups if not group & moved] + [joined]
    for group in groups:
        names = tuple(objects[place].id for body in sorted(group) for place in members[body])
        supports = block.geometry.supports
        on = [i for i, sides in zip(block.interfaces, supports, strict=True) if i.touch and group & set(sides.tolist())]
        equilibrium, force = _on_one_side(block, on[0]) if len(block.interfaces) == 1 else ("neutral", np.nan)
        yield Rolling(names, equilibrium, force, min(interface.rolling for interface in on))


def _moved_bodies(block: BlockAnalysis) -> Iterator[set[int]]:
    """Bodies of a block that move together in each way of rolling."""
    geometry = _without_resistance(block)
    pressed = np.ones(len(block.interfaces), dtype=bool)
    if not geometry.statically_determinate:
        pressed = block.solvers.coulomb.pressed_at_rest
    moving = geometry.grasp.toarray().T.reshape(-1, 3, geometry.count, 6)
    presses, seen = pressed[geometry.interface], set[int]()
    rolling_rates = list(_rolling_rates(block, geometry, pressed))
    everything = np.arange(geometry.count)
    for asked in [everything] if geometry.count <= _MANY else everything[:, None]:
        columns = moving[:, :, asked].reshape(len(moving), 3, -1)
        free = _null_space(columns[presses].reshape(-1, columns.shape[2]))
        parting = columns[~presses, 0] @ free
        for bodies, rates in rolling_rates:
            ways = rates[:, asked].reshape(len(rates), -1) @ free
            for way in (sign * way for way in ways for sign in (1.0, -1.0)):
                if bodies & seen or float(np.linalg.norm(way)) < _FREE:
                    continue
                motion = _most(way, parting)
                if motion is not None:
                    speeds = np.linalg.norm((free @ motion).reshape(-1, 6), axis=1)
                    moved = set(asked[speeds > _MOVES * speeds.max()].tolist())
                    seen |= moved
                    yield moved


def _without_resistance(block: BlockAnalysis) -> BlockGeometry:
    """The block with contacts on round sides at their lines and points alone."""
    interfaces = tuple(interface.with_friction(interface.friction, 0.0) for interface in block.structure.interfaces)
    return block_geometry(replace(block.structure, interfaces=interfaces), block.block)


def _null_space(rows: Array) -> Array:
    """(N, k) orthonormal motions that rows (R, N) do not notice."""
    if not len(rows):
        return np.eye(rows.shape[1])
    _, values, right = np.linalg.svd(rows, full_matrices=True)
    rank = int(np.count_nonzero(values > _FREE * max(float(values.max()), 1.0)))
    return np.asarray(right[rank:].T)


def _rolling_rates(block: BlockAnalysis, geometry: BlockGeometry, pressed: Mask) -> Iterator[tuple[set[int], Array]]:
    """For each round side that presses, the bodies at it and the rows (1 or 2, n, 6) of its rates of rolling."""
    for number in np.flatnonzero(pressed).tolist():
        interface = block.interfaces[number]
        if interface.touch is None:
            continue
        across, normal = interface.touch.across, interface.normal
        axes = plane_axes(normal) if across is None else np.cross(normal, across)[None]
        rates = np.zeros((len(axes), geometry.count, 6))
        for side, sign in zip(geometry.supports[number].tolist(), (-1.0, 1.0), strict=True):
            if side != FIXED_NODE:
                rates[:, side, 3:] += sign * axes
        yield set(geometry.supports[number].tolist()) - {FIXED_NODE}, rates


def _most(rate: Array, parting: Array) -> Array | None:
    """(k,) the motion with the largest rate that moves nothing towards anything; None when there is none.

    Args:
        rate: (k,).
        parting: (R, k) at interfaces that only touch.
    """
    if not len(parting):
        return rate
    found = linprog(-rate, A_ub=-parting, b_ub=np.zeros(len(parting)), bounds=(-1, 1), method="highs")
    moves = found.status == 0 and -found.fun > 10 * _FREE
    return np.asarray(found.x) if moves else None


def _on_one_side(block: BlockAnalysis, interface: Interface) -> tuple[str, float]:
    """The kind of equilibrium of what rests on one round side, and the force, N, that starts it.

    The centre of mass rises on a circle about the centre of curvature: it comes back when it is lower than that
    (by radii, for two round sides, whose curvatures add up).
    """
    touch, objects = interface.touch, block.structure.assembly.objects
    masses = np.array([objects[place].mass for place in block.block.members[0]])
    com = masses @ np.array([objects[place].com_in_world for place in block.block.members[0]]) / masses.sum()
    if touch is None:
        return "neutral", np.nan
    height = abs(float((com - touch.points.mean(axis=0)) @ interface.normal))
    radius = float(touch.radii.mean())
    force = block.geometry.units.weight * interface.rolling * radius / height if height > 0 else np.inf
    if abs(height - radius) <= _NEUTRAL * radius:
        return "neutral", force
    return ("stable" if height < radius else "unstable"), force
