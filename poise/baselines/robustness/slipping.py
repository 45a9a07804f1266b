"""Robustness to slipping as the thesis has it (section 4.4.2): contact conditions and a maximum flow."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from poise.assembly.contact import FIXED_NODE, Structure
from poise.baselines.robustness.sampled import SampledContacts
from poise.types import Array

# The maximum flow of scipy counts in whole numbers of 32 bits: the largest capacity of a network becomes this.
_WHOLE = 1 << 28


def point_robustness(forces: Array, directions: Array, friction: Array) -> Array:
    """(..., K) force that each point withstands before it slips (thesis eq. 4.21-4.25).

    Errata: the normal here points out of the pushed body, because a push along it must press (the thesis' text has it
    inward, its eq. 4.27 outward); eq. 4.24 needs the sign of e_n, which its norms lose; without real roots, where
    eq. 4.22 is imaginary, the point never slips.

    Args:
        forces: (K, 3) that the pushed body exerts there (normal, two tangents), N.
        directions: (..., K, 3) of the push, unit, in the same frames.
        friction: (K,).
    """
    squared = friction**2
    normal, along = directions[..., 0], directions[..., 1:]
    d = squared * normal**2 - (along**2).sum(axis=-1)  # eq. 4.23
    b = (along * forces[:, 1:]).sum(axis=-1) - squared * forces[:, 0] * normal
    left = np.maximum(squared * forces[:, 0] ** 2 - (forces[:, 1:] ** 2).sum(axis=-1), 0.0)  # 0 on the cone
    n_squared = b**2 - d * left  # eq. 4.22
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.where(np.abs(d) > 1e-12, (b - np.sqrt(n_squared)) / d, left / (2 * b))  # eq. 4.21, 4.24
    never = ~(s >= 0) | (n_squared < 0) | ((left == 0) & (d >= 0) & (b <= 0) & (normal > 0))
    return np.asarray(np.where(never, np.inf, s))


def point_improvement(forces: Array, direction: Array, friction: Array, force: float) -> Array:
    """(K,) dc/ds, what a push adds to each contact condition per N (thesis eq. 4.27), at a force, N."""
    total = forces[:, 1:] + force * direction[:, 1:]
    size = np.linalg.norm(total, axis=1)
    lost = np.where(
        size > 0,
        (direction[:, 1:] * total).sum(axis=1) / np.where(size > 0, size, 1.0),
        np.linalg.norm(direction[:, 1:], axis=1),
    )
    return np.asarray(friction * direction[:, 0] - lost)


@dataclass(frozen=True, eq=False)
class Slipping:
    """Slipping of an assembly: every interface a pipe whose capacity is what its points bear (eq. 4.28, 4.29).

    The capacity depends on which side pushes, so that each pipe has two.
    """

    structure: Structure
    contacts: SampledContacts

    def capacities(self, directions: Array) -> tuple[Array, Array]:
        """(Q, I) N that each interface withstands when its first, or second, body is pushed along (Q, 3) (eq. 4.28)."""
        contacts = self.contacts
        local = np.einsum("kij,qj->qki", contacts.frames, directions)
        return tuple(  # type: ignore[return-value]
            np.add.reduceat(point_robustness(contacts.forces, side * local, contacts.friction), contacts.starts, axis=1)
            for side in (1.0, -1.0)
        )

    def robustness(self, place: int, first: Array, second: Array) -> tuple[float, tuple[int, ...]]:
        """Of one push on an object, N, and what slips: the minimum cut between it and the fixed bodies (eq. 4.29).

        Args:
            place: of the pushed object.
            first, second: (I,) `capacities` for its direction.
        """
        nodes = [*self.structure.movable, FIXED_NODE]
        number = {node: i for i, node in enumerate(nodes)}
        ends = np.array([[number[body] for body in pair] for pair in self.contacts.pairs.tolist()])
        network = np.zeros((len(nodes), len(nodes)))
        np.add.at(network, (ends[:, 0], ends[:, 1]), first)
        np.add.at(network, (ends[:, 1], ends[:, 0]), second)
        finite = network[np.isfinite(network)].sum() or 1.0
        whole = np.where(np.isfinite(network), np.round(network * (_WHOLE / finite)), 2 * _WHOLE).astype(np.int32)
        pipes = csr_array(whole)
        flow = maximum_flow(pipes, number[place], number[FIXED_NODE])
        if flow.flow_value > _WHOLE:
            return np.inf, ()
        left = whole - flow.flow.toarray()
        moving = breadth_first_order(csr_array(np.maximum(left, 0)), number[place], return_predecessors=False)
        return flow.flow_value * finite / _WHOLE, tuple(sorted(nodes[i] for i in moving))

    def improvement(self, place: int, direction: Array, force: float = 0.0) -> float:
        """RI of slipping: the change of all contact conditions on the way to the fixed bodies (eq. 4.30).

        Dimensionless: N of contact condition per N of push along a unit direction (3,), on top of a force, N.
        """
        contacts, total = self.contacts, 0.0
        counts = np.diff(np.append(contacts.starts, len(contacts.points)))
        for block in self.structure.blocks:
            if not any(place in members for members in block.members):
                continue
            # All edges of a block lie on simple paths through it; the side nearer to the push is the pushing one.
            heads = [members[0] for members in block.members if place in members]
            for number in block.interfaces:
                rows = slice(contacts.starts[number], contacts.starts[number] + counts[number])
                side = self._pushing_side(number, heads[0])
                local = side * contacts.frames[rows] @ direction
                total += float(point_improvement(contacts.forces[rows], local, contacts.friction[rows], force).sum())
        return total

    def _pushing_side(self, interface: int, source: int) -> float:
        """1 when the first body of an interface is fewer contacts away from the source, -1 otherwise."""
        distance, queue = {source: 0}, [source]
        for node in queue:
            for other in self.structure.neighbours[node]:
                if other not in distance and node != FIXED_NODE:
                    distance[other] = distance[node] + 1
                    queue.append(other)
        first, second = (distance.get(body, len(distance)) for body in self.contacts.pairs[interface].tolist())
        if FIXED_NODE in self.contacts.pairs[interface]:
            return 1.0 if self.contacts.pairs[interface][1] == FIXED_NODE else -1.0
        return 1.0 if first <= second else -1.0
