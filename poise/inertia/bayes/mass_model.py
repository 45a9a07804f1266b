"""How mass may be spread over an object of roughly known shape: a few numbers in, a body that can exist out."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from poise.inertia.model import UPPER, phi_of_pseudo_inertia, pseudo_inertia
from poise.kernels import CompiledSearch
from poise.types import Array

N_DEFORMATIONS = 9
"""Six ways to stretch, three to shift."""

_HALVINGS = 2
"""The deformation of a body of unknown shape is the 4th power of a quarter of itself."""

_CORE = 0.15
"""Relative error of a radius of gyration of a part with a core that has 0.2 to 0.6 of its cross-section, for densities
of wood, plastics, aluminium and steel."""

_LAYER = 0.3
"""Shift of a centroid, in radii of gyration, of a part of which 0.25 to 0.75 are of another material."""


def _generators() -> Array:
    """(9, 4, 4) stretches xx xy xz yy yz zz, each of unit norm, then shifts along x y z."""
    matrices = np.zeros((N_DEFORMATIONS, 4, 4))
    for k, (i, j) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
        matrices[k, i, j] = matrices[k, j, i] = 1.0 if i == j else np.sqrt(0.5)
    for axis in range(3):
        matrices[6 + axis, axis, 3] = 1.0
    return matrices


_GENERATORS = _generators()
_ONE = np.eye(4)
# (9, 9 * 16) symmetrised products of two generators: the derivative of Y^2/2.
_PRODUCTS = np.array([[(a @ b + b @ a) / 2 for b in _GENERATORS] for a in _GENERATORS]).reshape(N_DEFORMATIONS, -1)
# phi as a linear map of the 16 entries of a symmetric pseudo-inertia, and back.
_PHI = np.stack([phi_of_pseudo_inertia((unit + unit.T) / 2) for unit in np.eye(16).reshape(16, 4, 4)], axis=1)
_MOMENTS = np.stack([pseudo_inertia(unit).ravel() for unit in np.eye(10)], axis=1)


@dataclass(frozen=True, eq=False)
class MassModel:
    """phi as a function of a state: log masses of parts if of equal density (K), then a small deformation (9).

    The pseudo-inertia is J = E (sum_k share_k exp(x_k) J_k) E^T: parts of positive mass, then the slack of an affine
    map E near the identity. A sum of bodies and an affine image of a body are bodies: every state is physically
    consistent, so nothing has to be enforced.

    Everything is in the normalised frame of the object, along the homogeneous body's principal axes, in which it has
    its centroid at the origin and unit second moments: there a relative error of the shape looks the same in all
    directions, however long and thin the object.

    Args:
        unit_moments: (K, 4, 4) pseudo-inertia of each part at 1 kg, normalised.
        shares: (K,) of the volume.
        to_sensor: (10, 10) takes phi from the normalised to the sensor frame.
        radii: (3,) m, of gyration along the axes of the normalised frame.
        halvings: of large deformations, see `_deformation`.
        likeness: (K, K) correlation of the log masses beforehand, positive definite; None: nothing in common.
        volume: m3, of the whole.
    """

    unit_moments: Array
    shares: Array
    to_sensor: Array
    radii: Array
    halvings: int = 0
    likeness: Array | None = None
    volume: float = 1.0

    @classmethod
    def of_parts(cls, unit_phi: Array, volumes: Array, likeness: Array | None = None) -> "MassModel":
        """From parts in the sensor frame, see `poise.inertia.model.Parts`."""
        shares = volumes / volumes.sum()
        moments = (_MOMENTS @ unit_phi).T.reshape(-1, 4, 4)
        whole = (shares @ moments.reshape(-1, 16)).reshape(4, 4)
        centroid = whole[:3, 3]
        squares, axes = np.linalg.eigh(whole[:3, :3] - np.outer(centroid, centroid))
        radii = np.sqrt(squares)
        inverse = np.linalg.inv(frame := _frame(axes * radii, centroid))
        to_sensor = _PHI @ _squared(frame) @ _MOMENTS
        volume = float(volumes.sum())
        return cls(inverse @ moments @ inverse.T, shares, to_sensor, radii, likeness=likeness, volume=volume)

    @classmethod
    def of_blob(cls, centre: Array, radius: float) -> "MassModel":
        """A body of unknown shape: one part about `centre` (3,) m, with a radius of gyration in m along each axis."""
        frame = _frame(radius * np.eye(3), centre)
        to_sensor = _PHI @ _squared(frame) @ _MOMENTS
        return cls(np.eye(4)[None], np.ones(1), to_sensor, np.full(3, radius), _HALVINGS)

    def roughness(self, resolution: float) -> Array:
        """(9,) variances of deformations when every length may be off by `resolution` m, however short it is."""
        by_axis = (resolution / self.radii) ** 2
        stretches = (by_axis[UPPER[0]] + by_axis[UPPER[1]]) / 4
        return np.concatenate([stretches, by_axis])

    def long_extents(self, least: float) -> Array:
        """(9,) factors of the variances of deformations when long extents are known to a smaller share than thin ones.

        The error of a stretch falls with the product of the radii of gyration of its two axes, from 1 for the thinnest
        axis to `least` for one that is much longer. Those of shifts stay.
        """
        thinness = self.radii.min() / self.radii
        stretches = least**2 + (1 - least**2) * thinness[UPPER[0]] * thinness[UPPER[1]]
        return np.concatenate([stretches, np.ones(3)])

    @property
    def unevenness(self) -> Array:
        """(2, 9) variances of deformations when each part may have a core of another material, and when layers.

        What lies between the parts, their densities describe; what lies within them is their share of the second
        moments along each axis.
        """
        centroids = self.unit_moments[:, :3, 3]
        inside = self.unit_moments[:, range(3), range(3)] - centroids**2
        within = (self.shares @ inside).clip(0.0, 1.0)
        products = within[UPPER[0]] * within[UPPER[1]]
        core = np.append(_CORE**2 * products, np.zeros(3))
        return np.stack([core, core + np.append(np.zeros(6), _LAYER**2 * within)])

    @cached_property
    def likeness_axes(self) -> tuple[Array, Array]:
        """(K,) variances of the densities along the axes of the likeness, and (K, K) these axes, in columns."""
        if self.likeness is None:
            return np.ones(self.n_parts), np.eye(self.n_parts)
        variances, axes = np.linalg.eigh(self.likeness)
        return variances, axes

    @property
    def n_parts(self) -> int:
        """K."""
        return len(self.shares)

    @property
    def n_states(self) -> int:
        """K + 9."""
        return self.n_parts + N_DEFORMATIONS

    def evaluate(self, states: Array) -> tuple[Array, Array]:
        """(H, 10) phi and its derivative (H, 10, K + 9) at states (H, K + 9), in the normalised frame."""
        n_parts, count = self.n_parts, len(states)
        masses = self.shares * np.exp(states[:, :n_parts])
        deformation, slopes = _deformation(states[:, n_parts:], self.halvings)
        # Entries of E J E^T are products of entries of E with entries of J: a 16x16 matrix for each state.
        squared = deformation[:, :, None, :, None] * deformation[:, None, :, None, :]
        parts = self.unit_moments.reshape(n_parts, 16).T
        jacobian = np.empty((count, self.n_states, 10))
        by_part = (squared.reshape(count, 16, 16) @ parts).swapaxes(1, 2) * masses[:, :, None]
        jacobian[:, :n_parts] = by_part @ _PHI.T
        whole = (masses @ parts.T).reshape(count, 4, 4)
        half = slopes.reshape(count, -1, 4) @ (whole @ deformation.swapaxes(1, 2))
        # dE J E^T and its transpose give the same phi.
        jacobian[:, n_parts:] = half.reshape(count, N_DEFORMATIONS, 16) @ (2 * _PHI.T)
        return jacobian[:, :n_parts].sum(axis=1), jacobian.swapaxes(1, 2)


def compiled_search(
    model: MassModel, guess: Array, root: Array, unrooted: Array, scale: float, any_mass: float
) -> CompiledSearch:
    """The kernel for a model; see `ModelAverage` for the prior that the other arguments describe."""
    parts = slice(model.n_parts)
    return CompiledSearch(
        halvings=model.halvings,
        scale=scale,
        any_mass=any_mass,
        moments=model.unit_moments.reshape(-1, 16),
        shares=model.shares,
        guess=guess,
        root=None if model.likeness is None else root[parts, parts],
        unrooted=unrooted,
        flat=_GENERATORS.reshape(N_DEFORMATIONS, 16),
        products=_PRODUCTS,
    )


def _squared(matrix: Array) -> Array:
    """(16, 16) Kronecker product of a matrix (4, 4) with itself."""
    return np.asarray((matrix[:, None, :, None] * matrix[None, :, None, :]).reshape(16, 16))


def _frame(axes: Array, origin: Array) -> Array:
    """(4, 4) affine map with these columns."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes, origin
    return matrix


def _deformation(coordinates: Array, halvings: int) -> tuple[Array, Array]:
    """(H, 4, 4) E and its derivative (H, 9, 4, 4), for coordinates (H, 9) of the generators.

    E = (1 + Y + Y^2/2)^(2^h) with Y the generator's sum, halved h times: the exponential to second order or better,
    and never singular, for 1 + y + y^2/2 > 0 for every real y.
    """
    share = 0.5**halvings
    flat = _GENERATORS.reshape(N_DEFORMATIONS, 16)
    slopes = flat + (share * coordinates @ _PRODUCTS).reshape(-1, N_DEFORMATIONS, 16)
    # Y (1 + Y) is the sum of what the coordinates do along their slopes, so this is 1 + Y + Y^2/2.
    result = _ONE + (share / 2 * (coordinates[:, None] @ (flat + slopes))[:, 0]).reshape(-1, 4, 4)
    slopes = share * slopes.reshape(-1, N_DEFORMATIONS, 4, 4)
    for _ in range(halvings):
        slopes = slopes @ result[:, None] + result[:, None] @ slopes
        result = result @ result
    return result, slopes
