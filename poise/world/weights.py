"""The weight of an object that was not weighed: by its volume, or by the mass that was lifted, with covariance."""

from dataclasses import replace

import numpy as np

from poise.assembly import RigidObject
from poise.inertia.model import InertialParameters
from poise.types import Array

_DENSITY, _DENSITY_STD = 1000.0, 0.7
"""kg/m3, and its standard deviation as a share: what hands pick up is full, hollow or of metal."""
_UNEVEN = 0.1
"""m by which the centre of mass is off the centroid, as a share of the size: matter is not spread evenly."""
_INERTIA_STD = 0.5
"""Share of the inertia about the centre of mass, of matter that is not spread evenly."""


def assumed_weight(item: RigidObject) -> RigidObject:
    """The object with a mass by its volume and a typical density, evenly spread, and a covariance that says so."""
    mass = _DENSITY * item.shape.volume
    return _spread_evenly(item, mass, _DENSITY_STD * mass)


def lifted_weight(item: RigidObject, mass: float, mass_std: float) -> RigidObject:
    """The object with a mass that was measured at a lift; where it is in the object stays open.

    Args:
        item: the object.
        mass: kg, positive.
        mass_std: kg.
    """
    return _spread_evenly(item, mass, mass_std)


def _spread_evenly(item: RigidObject, mass: float, mass_std: float) -> RigidObject:
    """Mass evenly spread over the shape; the covariance is of (m, m c, I about the object frame's origin)."""
    shape = item.shape
    moments = mass * shape.inertia_per_mass
    phi = InertialParameters(mass, shape.centroid, moments).phi
    size = np.ptp(shape.polyhedron.vertices, axis=0)
    covariance = (mass_std / mass) ** 2 * np.outer(phi, phi)
    for axis in range(3):
        slope = _moved(mass, shape.centroid, moments, axis)
        covariance += (_UNEVEN * size[axis]) ** 2 * np.outer(slope, slope)
    own = np.concatenate([np.zeros(4), np.full(6, _INERTIA_STD * float(np.trace(moments)) / 3)])
    covariance += np.diag(own**2)
    return replace(item, mass=mass, com=None, inertia=None, covariance=(covariance + covariance.T) / 2)


def _moved(mass: float, com: Array, moments: Array, axis: int) -> Array:
    """(10,) derivative of phi by a coordinate of the centre of mass."""
    step = 1e-4 * np.eye(3)[axis]
    ahead, behind = (InertialParameters(mass, com + sign * step, moments).phi for sign in (1, -1))
    return np.asarray((ahead - behind) / 2e-4)
