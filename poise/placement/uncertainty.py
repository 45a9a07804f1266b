"""Placements that stay in spite of errors of pose, mass and friction."""

from dataclasses import dataclass, replace

import numpy as np

from poise.assembly import Analysis, RigidObject
from poise.geometry import plane_axes, rotation_about, unit
from poise.types import Array

_DIRECTIONS = 8


@dataclass(frozen=True)
class Uncertainty:
    """How far the truth may be from the plan.

    Args:
        position: m, of the object to place, in every horizontal direction.
        angle: rad, by which the object, or the whole scene, may lean.
        friction: relative; the coefficients may be smaller by this.
        mass: relative; of the object to place.
    """

    position: float = 2e-3
    angle: float = float(np.radians(2.0))
    friction: float = 0.2
    mass: float = 0.1


def stands_disturbed(analysis: Analysis, item: RigidObject, uncertainty: Uncertainty) -> bool:
    """Whether the assembly stands in the worst of a ring of errors.

    The contacts stay where they are planned, and the centre of mass moves instead of the object: for objects that rest
    on faces this is equivalent to first order. Leaning turns gravity. The errors of eight directions are checked one by
    one, with less friction, and with a heavier or lighter object in turn.
    """
    up = -unit(analysis.assembly.gravity)
    first = plane_axes(up)[0]
    for number in range(_DIRECTIONS):
        away = rotation_about(up, 2 * np.pi * number / _DIRECTIONS) @ first
        mass = item.mass * (1 + uncertainty.mass * (1 if number % 2 else -1))
        if _disturbed(analysis, item, uncertainty, away, mass).stability().margin <= 0:
            return False
    return True


def _disturbed(analysis: Analysis, item: RigidObject, uncertainty: Uncertainty, away: Array, mass: float) -> Analysis:
    """The same contacts with the centre of mass moved, gravity turned and less friction."""
    structure = analysis.structure
    assembly = structure.assembly
    com = item.pose.undo(item.com_in_world + uncertainty.position * away)
    gravity = assembly.gravity + np.linalg.norm(assembly.gravity) * np.tan(uncertainty.angle) * away
    moved = replace(item, com=com, mass=mass)
    keep = 1 - uncertainty.friction
    interfaces = tuple(replace(i, friction=i.friction * keep) for i in structure.interfaces)
    objects = tuple(moved if other.id == item.id else other for other in assembly.objects)
    return Analysis(
        replace(structure, assembly=replace(assembly, objects=objects, gravity=gravity), interfaces=interfaces)
    )
