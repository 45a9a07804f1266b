"""Contact interfaces as the thesis takes them: some sampled points each, and forces there (section 4.5.1)."""

from dataclasses import dataclass, replace

import numpy as np

from poise.assembly.contact import FIXED_NODE, ContactBlock, Interface, Structure, triangle_areas
from poise.assembly.statics import BlockGeometry, Loads, block_geometry, contact_forces
from poise.errors import ErrorCode, InputError
from poise.types import Array, Indices

_POINTS = 20
"""Per interface, as in the thesis' experiments."""
_CANDIDATES = 10
_SEED = 4


@dataclass(frozen=True, eq=False)
class SampledContacts:
    """Sampled contact points of a whole assembly, and the forces there at rest.

    Args:
        points: (K, 3) m.
        frames: (K, 3, 3) rows: normal from the first into the second body, two tangents.
        friction: (K,) coefficients.
        bodies: (K, 2) places in `Assembly.objects` of the first and second body, FIXED_NODE for fixed ones.
        starts: (I,) where the points of each interface start.
        forces: (K, 3) that the first body exerts on the second, in these frames, N.
    """

    points: Array
    frames: Array
    friction: Array
    bodies: Indices
    starts: Indices
    forces: Array

    @property
    def pairs(self) -> Indices:
        """(I, 2) bodies of each interface."""
        return self.bodies[self.starts]


def whole_geometry(structure: Structure) -> BlockGeometry:
    """The whole assembly as one block, `_POINTS` sampled points per interface."""
    rng = np.random.default_rng(_SEED)
    sampled = tuple(replace(interface, points=sample_points(interface, rng)) for interface in structure.interfaces)
    body_of = {place: body for body, place in enumerate(structure.movable)}
    sides = tuple(
        (body_of.get(interface.first, FIXED_NODE), body_of.get(interface.second, FIXED_NODE)) for interface in sampled
    )
    block = ContactBlock(tuple((place,) for place in structure.movable), tuple(range(len(sampled))), sides)
    return block_geometry(replace(structure, interfaces=sampled), block)


def sampled_contacts(structure: Structure) -> SampledContacts:
    """Sampled points with the contact forces of thesis eq. 4.12-4.15 (exact friction circles).

    Raises:
        NoAnswerError: UNSTABLE when no forces keep the objects at rest; SOLVER_FAILED.
    """
    geometry = whole_geometry(structure)
    places = np.array([*structure.movable, FIXED_NODE])  # FIXED_NODE, -1, finds the last
    return SampledContacts(
        points=geometry.points * geometry.units.length + geometry.units.origin,
        frames=geometry.frames,
        friction=geometry.friction,
        bodies=places[geometry.bodies],
        starts=np.flatnonzero(np.diff(geometry.interface, prepend=-1)),
        forces=contact_forces(geometry) * geometry.units.weight,
    )


def sample_points(interface: Interface, rng: np.random.Generator) -> Array:
    """(20, 3) points by approximate farthest point sampling: of ten random ones the farthest from those taken.

    The two or one corners of lines and points are taken as they are.
    """
    if not interface.area:
        return interface.points
    areas = triangle_areas(interface.triangles)
    which = rng.choice(len(areas), size=(_POINTS, _CANDIDATES), p=areas / areas.sum())
    u, v = rng.random((2, _POINTS, _CANDIDATES, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = np.moveaxis(interface.triangles[which], 2, 0)
    candidates = a + u * (b - a) + v * (c - a)
    taken = candidates[0, :1]
    for drawn in candidates[1:]:
        nearest = np.linalg.norm(drawn[:, None] - taken[None], axis=2).min(axis=1)
        taken = np.concatenate([taken, drawn[nearest.argmax()][None]])
    return np.asarray(taken)


def single_pushes(loads: Loads, model: str) -> Loads:
    """The loads, for a model that knows one force at a time.

    Raises:
        InputError: BAD_INPUT for several forces at once.
    """
    if len(loads.question) != loads.count:
        raise InputError(ErrorCode.BAD_INPUT, f"model {model} takes one push at a time; use default or limit")
    return loads
