"""Contact forces with the least sum of squares that balance a load: Newton steps on the motions of the bodies.

The forces are the projections of what a motion y makes of each contact point, G'y, onto its friction cone; y is the
minimum of half of their squares plus load @ y, which is convex. Where it has none, no forces balance the load.
"""

from dataclasses import dataclass

import numpy as np

from poise.assembly.contact import FIXED_NODE
from poise.assembly.statics.block import BlockGeometry
from poise.assembly.statics.body_stiffness import BodyStiffness
from poise.geometry import lengths
from poise.types import Array, Indices, Mask

_STEPS, _HALVINGS = 40, 20
_TRACE, _SUFFICIENT = 1e-9, 1e-4
"""Stiffness that holds bodies on which nothing presses; the share of the gain that the slope promises, at least."""
_BALANCED, _ACCEPTED = 1e-12, 1e-9
"""What the forces leave of the load, in the block's units, when steps end, and at most."""


def least_forces(geometry: BlockGeometry, load: Array) -> Array | None:
    """(K, 3) normal force and two tangential ones at each point, within their cones; None where none are found.

    Args:
        geometry: the block.
        load: (6 n,) in its units.
    """
    sides, starts = _sides(geometry), np.searchsorted(geometry.interface, np.arange(len(geometry.supports)))
    if not np.all(np.diff(np.append(starts, len(geometry.points))) > 0):
        return None
    stiffness = BodyStiffness(sides, geometry.count)
    y, moved = np.zeros_like(load), np.zeros((len(geometry.points), 3))
    forces, left, value = _Projected.of(moved, geometry.friction), load, 0.0
    derivative: Array = np.broadcast_to(np.eye(3), (len(moved), 3, 3))  # as if everything pressed and stuck
    for _ in range(_STEPS):
        pairs = np.einsum("pia,pib->pab", geometry.wrenches, derivative @ geometry.wrenches)
        matrix = stiffness.matrix(np.add.reduceat(pairs, starts), _TRACE)
        try:
            step = stiffness.solve(matrix, -left)
        except (np.linalg.LinAlgError, RuntimeError):
            return None
        by, slope = _motions(geometry, sides, step), float(left @ step)
        for _ in range(_HALVINGS):
            forces = _Projected.of(moved + by, geometry.friction)
            after = forces.half_square + float(load @ (y + step))
            if after <= value + _SUFFICIENT * slope + _BALANCED:
                break
            step, by, slope = step / 2, by / 2, slope / 2
        y, moved, value = y + step, moved + by, after
        left = _wrenches(geometry, sides, starts, forces.forces) + load
        if not np.isfinite(value) or np.abs(left).max() <= _BALANCED:
            break
        derivative = forces.derivative(geometry.friction)
    return forces.forces if np.isfinite(value) and np.abs(left).max() <= _ACCEPTED else None


def _sides(geometry: BlockGeometry) -> Indices:
    """(I, 2) bodies of each interface; their number stands for the ground."""
    return np.where(geometry.supports == FIXED_NODE, geometry.count, geometry.supports)


def _motions(geometry: BlockGeometry, sides: Indices, y: Array) -> Array:
    """(K, 3) motion of the second body relative to the first at each point."""
    bodies = np.zeros((geometry.count + 1, 6))
    bodies[:-1] = y.reshape(-1, 6)
    between = bodies[sides[:, 1]] - bodies[sides[:, 0]]
    return np.asarray(np.einsum("pij,pj->pi", geometry.wrenches, between[geometry.interface]))


def _wrenches(geometry: BlockGeometry, sides: Indices, starts: Indices, forces: Array) -> Array:
    """(6 n,) on the bodies, of contact forces (K, 3)."""
    between = np.add.reduceat(np.einsum("pij,pi->pj", geometry.wrenches, forces), starts)
    bodies = np.zeros((geometry.count + 1, 6))
    np.add.at(bodies, sides[:, 1], between)
    np.subtract.at(bodies, sides[:, 0], between)
    return bodies[:-1].ravel()


@dataclass(frozen=True, eq=False)
class _Projected:
    """Vectors (K, 3) projected onto friction cones.

    Args:
        forces: (K, 3) the nearest ones within the cones.
        slides: (K,) length of the tangential part of each vector.
        inside, edge: (K,) those that were within their cone, and those that are now on its edge but for its tip.
        tangents: (K, 2) direction of the tangential part.
    """

    forces: Array
    slides: Array
    inside: Mask
    edge: Mask
    tangents: Array

    @classmethod
    def of(cls, vectors: Array, friction: Array) -> "_Projected":
        """Project vectors of a normal and two tangential parts."""
        normal, slides = vectors[:, 0], lengths(vectors * [0.0, 1.0, 1.0])
        inside = slides <= friction * normal
        edge = ~inside & (friction * slides > -normal) & (slides > 0)
        pressed = np.where(edge, (normal + friction * slides) / (1 + friction**2), 0.0)
        tangents = vectors[:, 1:] / np.where(slides > 0, slides, 1.0)[:, None]
        forces = np.where(inside[:, None], vectors, 0.0)
        forces[edge, 0] = pressed[edge]
        forces[edge, 1:] = (friction * pressed)[edge, None] * tangents[edge]
        return cls(forces, slides, inside, edge, tangents)

    @property
    def half_square(self) -> float:
        return 0.5 * float(np.einsum("ij,ij->", self.forces, self.forces))

    def derivative(self, friction: Array) -> Array:
        """(K, 3, 3) of the forces with respect to the vectors, symmetric and positive semidefinite."""
        found = np.where(self.inside[:, None, None], np.eye(3), 0.0)
        mu, tangents = friction[self.edge], self.tangents[self.edge]
        along = np.concatenate([np.ones((len(mu), 1)), mu[:, None] * tangents], axis=1)
        on_edge = along[:, :, None] * along[:, None] / (1 + mu**2)[:, None, None]
        across = mu * self.forces[self.edge, 0] / self.slides[self.edge]
        on_edge[:, 1:, 1:] += across[:, None, None] * (np.eye(2) - tangents[:, :, None] * tangents[:, None])
        found[self.edge] = on_edge
        return found
