"""What in an assembly can roll: motions on round sides that no contact resists but by rolling resistance."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linprog

from poise.assembly.contact import FIXED_NODE, Interface
from poise.assembly.statics.analysis import Analysis, BlockAnalysis
from poise.assembly.statics.block import BlockGeometry, block_geometry
from poise.assembly.statics.deadline import NO_DEADLINE, Deadline
from poise.geometry import plane_axes, unit
from poise.types import Array, Indices, Mask

_FREE = 1e-7
"""Singular values, rates and motions below this, in the block's units, are 0."""
_MOVES = 1e-3
"""Share of the fastest body's motion below which another does not move."""
ROLLING_TOGETHER = 40
"""Bodies of a block that are asked together. In larger blocks these are the nearest ones to each round side: what rolls
only if more bodies move is not found."""
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


def rolling(analysis: Analysis, deadline: Deadline = NO_DEADLINE, only_known: bool = False) -> tuple[Rolling, ...]:
    """Everything that stands, but can roll.

    A motion counts when nothing slides or parts at an interface that presses at rest, nothing gets nearer at one that
    only touches, and something rolls: the first contact force that it meets is rolling resistance. So a cylinder
    between two chocks that touch it cannot roll; with one chock, or with gaps, it can.

    Args:
        analysis: of the assembly.
        deadline: what is found until then is returned.
        only_known: look only at what was found to stand so far; otherwise that is computed first.
    """
    return tuple(found for block in analysis.blocks for found in _of_block(block, deadline, only_known))


def _of_block(block: BlockAnalysis, deadline: Deadline, only_known: bool) -> Iterator[Rolling]:
    if all(interface.touch is None for interface in block.interfaces):
        return
    standing, known = block.solvers.standing(Deadline.after(0.0) if only_known else deadline)
    if not known or standing.margin <= 0:
        return
    objects, members = block.structure.assembly.objects, block.block.members
    groups: list[set[int]] = []
    for moved in _moved_bodies(block, deadline):
        joined = moved.union(*(group for group in groups if group & moved))
        groups = [group for group in groups if not group & moved] + [joined]
    for group in groups:
        names = tuple(objects[place].id for body in sorted(group) for place in members[body])
        supports = block.geometry.supports
        on = [i for i, sides in zip(block.interfaces, supports, strict=True) if i.touch and group & set(sides.tolist())]
        equilibrium, force = _on_one_side(block, on[0]) if len(block.interfaces) == 1 else ("neutral", np.nan)
        yield Rolling(names, equilibrium, force, min(interface.rolling for interface in on))


def _moved_bodies(block: BlockAnalysis, deadline: Deadline) -> Iterator[set[int]]:
    """Bodies of a block that move together in each way of rolling, as far as found before the deadline."""
    geometry = _without_resistance(block)
    pressed = np.ones(len(block.interfaces), dtype=bool)
    if not geometry.statically_determinate:
        pressed = block.solvers.coulomb.pressed_at_rest
    motions, seen = geometry.grasp.T.tocsr(), set[int]()
    sides = list(_round_sides(block, geometry, pressed))
    together = geometry.count <= ROLLING_TOGETHER
    near = _nearest(geometry.supports, geometry.count, {body for side in sides for body in side.bodies})
    for asked in [np.arange(geometry.count)] if together else near:
        rolls = sides if together else [side for side in sides if int(asked[0]) in side.bodies]
        if not rolls or (not together and int(asked[0]) in seen):
            continue
        if deadline.passed:
            return
        at = np.flatnonzero(np.isin(geometry.bodies, asked).any(axis=1))
        columns = motions[_places(3, at)][:, _places(6, asked)].toarray().reshape(len(at), 3, -1)
        presses = pressed[geometry.interface[at]]
        free = _null_space(columns[presses].reshape(-1, columns.shape[2]))
        parting = columns[~presses, 0] @ free
        for side in rolls:
            for way in (sign * way for way in side.rates(asked) @ free for sign in (1.0, -1.0)):
                if side.bodies & seen or float(np.linalg.norm(way)) < _FREE:
                    continue
                if deadline.passed:
                    return
                motion = _most(way, parting)
                if motion is not None:
                    speeds = np.linalg.norm((free @ motion).reshape(-1, 6), axis=1)
                    moved = set(asked[speeds > _MOVES * speeds.max()].tolist())
                    seen |= moved
                    yield moved


def _nearest(supports: Indices, count: int, bodies: set[int]) -> Iterator[Indices]:
    """For each of some bodies: itself, and the nearest ones to it along contacts, as many as are asked together."""
    touching: list[list[int]] = [[] for _ in range(count)]
    for first, second in supports.tolist():
        if FIXED_NODE not in (first, second):
            touching[first].append(second)
            touching[second].append(first)
    for body in sorted(bodies):
        found = [body]
        for each in found:
            found += [other for other in dict.fromkeys(touching[each]) if other not in found]
            if len(found) >= ROLLING_TOGETHER:
                break
        yield np.array(found[:ROLLING_TOGETHER])


def too_many_to_roll(analysis: Analysis) -> tuple[int, ...]:
    """Bodies of each block with round sides that is too large for all of it to be asked together."""
    return tuple(
        block.geometry.count
        for block in analysis.blocks
        if len(block.block.members) > ROLLING_TOGETHER and any(i.touch is not None for i in block.interfaces)
    )


def _places(each: int, numbers: Indices) -> Indices:
    """Rows of things (N,) that have so many rows each."""
    return np.asarray((each * numbers[:, None] + np.arange(each)).ravel())


def _without_resistance(block: BlockAnalysis) -> BlockGeometry:
    """The block with contacts on round sides at their lines and points alone."""
    interfaces = tuple(interface.with_friction(interface.friction, 0.0) for interface in block.structure.interfaces)
    return block_geometry(replace(block.structure, interfaces=interfaces), block.block)


def _null_space(rows: Array) -> Array:
    """(N, k) orthonormal motions that rows (R, N) do not notice."""
    rows = rows[np.any(rows != 0, axis=1)]
    if not len(rows):
        return np.eye(rows.shape[1])
    if len(rows) > rows.shape[1]:  # a full decomposition would have (R, R) numbers
        rows = np.linalg.qr(rows).R
    _, values, right = np.linalg.svd(rows, full_matrices=True)
    rank = int(np.count_nonzero(values > _FREE * max(float(values.max()), 1.0)))
    return np.asarray(right[rank:].T)


@dataclass(frozen=True, eq=False)
class _RoundSide:
    """A round side that presses.

    Args:
        first, second: bodies on both sides of it, or FIXED_NODE.
        axes: (1 or 2, 3) about which it rolls.
    """

    first: int
    second: int
    axes: Array

    @property
    def bodies(self) -> set[int]:
        return {self.first, self.second} - {FIXED_NODE}

    def rates(self, asked: Indices) -> Array:
        """(1 or 2, 6 n) rows of its rates of rolling when only these bodies (n,) move."""
        rates = np.zeros((len(self.axes), len(asked), 6))
        for body, sign in ((self.first, -1.0), (self.second, 1.0)):
            rates[:, asked == body, 3:] += sign * self.axes[:, None]
        return rates.reshape(len(rates), -1)


def _round_sides(block: BlockAnalysis, geometry: BlockGeometry, pressed: Mask) -> Iterator[_RoundSide]:
    for number in np.flatnonzero(pressed).tolist():
        interface = block.interfaces[number]
        if interface.touch is not None:
            across, normal = interface.touch.across, interface.normal
            axes = plane_axes(normal) if across is None else np.cross(normal, across)[None]
            first, second = geometry.supports[number].tolist()
            yield _RoundSide(first, second, axes)


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
    force = _starting_force(block, interface, com)
    if abs(height - radius) <= _NEUTRAL * radius:
        return "neutral", force
    return ("stable" if height < radius else "unstable"), force


def _starting_force(block: BlockAnalysis, interface: Interface, com: Array) -> float:
    """N along the surface at the centre of mass (3,), downhill if there is a slope, that starts what rests there.

    The line of the load through the centre of mass then meets the surface at the edge of the region in which rolling
    resistance lets the contact force act. On a slope it is nearer to that edge from the beginning.
    """
    touch, normal, gravity = interface.touch, interface.normal, np.asarray(block.structure.assembly.gravity)
    if touch is None or interface.rolling == 0:
        return 0.0
    down, middle = unit(gravity), touch.points.mean(axis=0)
    height, pressing = float((com - middle) @ normal), float(down @ normal)
    foot = com - height / pressing * down
    aside = foot - middle if touch.across is None else (foot - middle) @ touch.across * touch.across
    if np.linalg.norm(aside) > _FREE * touch.radii.mean():
        way = unit(aside)
    else:
        way = plane_axes(normal)[0] if touch.across is None else touch.across
    reach = _reach(interface.points, normal, foot, way)
    return block.geometry.units.weight * abs(pressing) * reach / abs(height) if height else np.inf


def _reach(corners: Array, normal: Array, start: Array, way: Array) -> float:
    """m from a point in a convex polygon (K, 3) along its plane to its edge; 0 for a point outside."""
    outwards = np.cross(np.roll(corners, -1, axis=0) - corners, normal)
    outwards *= np.sign(np.sum(outwards * (corners - corners.mean(axis=0)), axis=1))[:, None]
    ahead = outwards @ way
    met = ahead > _FREE * np.linalg.norm(outwards, axis=1)
    beyond = np.sum(outwards * (corners - start), axis=1)
    return max(0.0, float(np.min(beyond[met] / ahead[met])))
