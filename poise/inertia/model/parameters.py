"""Inertial parameters of a rigid body: mass, centre of mass and inertia, and the 10-vector in which they are linear."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.types import Array

PARAMETER_NAMES = ("m", "cx", "cy", "cz", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")
"""Names of the ten parameters, in the order of phi."""

# Rows and columns of the six free entries of a symmetric 3x3 matrix, in the order of phi.
UPPER = (np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2]))


@dataclass(frozen=True, eq=False)
class InertialParameters:
    """How a body's mass is spread, in one frame. NaN marks what is not known.

    Args:
        mass: kg.
        com: (3,) centre of mass, m.
        inertia: (3, 3) about the centre of mass, in the axes of the frame, kg m2.

    Raises:
        InputError: TYPE_MISMATCH for other shapes, BAD_INPUT when the inertia is not symmetric.
    """

    mass: float
    com: Array
    inertia: Array

    @np.errstate(over="ignore", invalid="ignore")
    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", float(self.mass))
        for name, shape in (("com", (3,)), ("inertia", (3, 3))):
            value = np.array(getattr(self, name), dtype=np.float64)
            if value.shape != shape:
                raise InputError(
                    ErrorCode.TYPE_MISMATCH, f"inertial parameters: {name} has shape {value.shape}, expected {shape}"
                )
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        rounding = 1e-9 * np.abs(self.inertia).max()  # relative: off-diagonal entries may be far smaller
        if np.any(np.abs(self.inertia - self.inertia.T) > rounding):
            raise InputError(
                ErrorCode.BAD_INPUT, "inertial parameters: the inertia matrix is not symmetric; check its order"
            )

    @classmethod
    @np.errstate(over="ignore", invalid="ignore")  # numbers that are too large become infinite
    def from_phi(cls, phi: ArrayLike) -> "InertialParameters":
        """Read (m, m c, I about the frame's origin), (10,), in the order of `PARAMETER_NAMES` (thesis eq. 3.1).

        A NaN makes NaN of exactly what depends on it; a massless body has no centre of mass (NaN).
        """
        values = np.asarray(phi, dtype=np.float64)
        if values.shape != (10,):
            raise InputError(ErrorCode.TYPE_MISMATCH, f"phi has shape {values.shape}, expected (10,)")
        mass, first_moment = float(values[0]), values[1:4]
        com = first_moment / mass if mass != 0 else np.full(3, np.nan)
        return cls(mass, com, symmetric(values[4:]) - mass * _parallel_axis(com))

    @property
    @np.errstate(over="ignore", invalid="ignore")
    def phi(self) -> Array:
        """(10,) m, m c, and the inertia about the frame's origin, in which the wrench is linear (thesis eq. 3.1)."""
        about_origin = self.inertia + self.mass * _parallel_axis(self.com)
        return np.concatenate([[self.mass], self.mass * self.com, about_origin[UPPER]])

    @property
    def inertia_vector(self) -> Array:
        """(6,) ixx ixy ixz iyy iyz izz about the centre of mass, kg m2."""
        return np.asarray(self.inertia[UPPER])

    @property
    def pseudo_inertia(self) -> Array:
        """(4, 4) see `pseudo_inertia`."""
        return pseudo_inertia(self.phi)

    @property
    def is_consistent(self) -> bool:
        """A body like this can exist: its pseudo-inertia is positive definite (Wensing et al. 2017).

        Where the inertia is not known in full, only the mass decides: any mass and centre of mass have a body.
        """
        if not np.all(np.isfinite(self.phi[:4])) or np.any(np.isinf(self.inertia)):
            return False
        if not np.all(np.isfinite(self.inertia)):
            return self.mass > 0
        # About the centre of mass the pseudo-inertia is block diagonal, (tr(I)/2 E - I, m): the triangle inequalities.
        principal = np.linalg.eigvalsh(self.inertia)
        rounding = 8 * np.finfo(np.float64).eps * principal[2]
        return self.mass > 0 and bool(principal[0] + principal[1] - principal[2] > rounding)

    def in_frame(self, rotation_new_old: ArrayLike, translation_new_old: ArrayLike) -> "InertialParameters":
        """The same body seen from another frame, x_new = rotation_new_old @ x_old + translation_new_old."""
        rotation = np.asarray(rotation_new_old, dtype=np.float64)
        inertia = rotation @ self.inertia @ rotation.T
        com = rotation @ self.com + np.asarray(translation_new_old, dtype=np.float64)
        return InertialParameters(self.mass, com, (inertia + inertia.T) / 2)

    def __add__(self, other: "InertialParameters") -> "InertialParameters":
        """Two bodies fixed to each other, both given in the same frame."""
        return InertialParameters.from_phi(self.phi + other.phi)

    def __sub__(self, other: "InertialParameters") -> "InertialParameters":
        """What is left when a part (a gripper, say) is taken away, both given in the same frame."""
        return InertialParameters.from_phi(self.phi - other.phi)


def symmetric(entries: ArrayLike) -> Array:
    """Symmetric (3, 3) matrix of its six entries xx xy xz yy yz zz."""
    matrix = np.empty((3, 3))
    matrix[UPPER] = entries
    matrix.T[UPPER] = entries
    return matrix


def pseudo_inertia(phi: ArrayLike) -> Array:
    """(4, 4) pseudo-inertia of a 10-vector: the second moments of mass of the points (x, y, z, 1).

    [[tr(I)/2 E - I, m c], [m c^T, m]] with I about the frame's origin (Wensing et al. 2017, "Linear Matrix
    Inequalities for Physically-Consistent Inertial Parameter Identification"). Linear in phi.
    """
    values = np.asarray(phi, dtype=np.float64)
    inertia = symmetric(values[4:])
    matrix = np.empty((4, 4))
    matrix[:3, :3] = np.trace(inertia) / 2 * np.eye(3) - inertia
    matrix[:3, 3] = matrix[3, :3] = values[1:4]
    matrix[3, 3] = values[0]
    return matrix


def phi_of_pseudo_inertia(matrix: ArrayLike) -> Array:
    """(10,) the inverse of `pseudo_inertia`."""
    values = np.asarray(matrix, dtype=np.float64)
    second_moments = values[:3, :3]
    inertia = np.trace(second_moments) * np.eye(3) - second_moments
    return np.concatenate([[values[3, 3]], values[:3, 3], inertia[UPPER]])


def frame_change(rotation_new_old: ArrayLike, translation_new_old: ArrayLike) -> Array:
    """(10, 10) X with phi_in_new = X phi_in_old, for x_new = rotation_new_old @ x_old + translation_new_old.

    Homogeneous points transform by T, so the pseudo-inertia does by T J T^T. A covariance becomes X C X^T.
    """
    transform = np.eye(4)
    transform[:3, :3] = rotation_new_old
    transform[:3, 3] = translation_new_old
    columns = [phi_of_pseudo_inertia(transform @ pseudo_inertia(unit) @ transform.T) for unit in np.eye(10)]
    return np.stack(columns, axis=1)


def about_com_jacobian(phi: ArrayLike) -> Array:
    """(9, 10) derivative of (com, inertia about it as xx xy xz yy yz zz) by phi.

    From c = h / m and I_c = I - (h.h E - h h^T) / m with the first moment h = m c.
    """
    values = np.asarray(phi, dtype=np.float64)
    mass, com = values[0], values[1:4] / values[0]
    jacobian = np.zeros((9, 10))
    jacobian[:3, 0] = -com / mass
    jacobian[:3, 1:4] = np.eye(3) / mass
    jacobian[3:, 0] = _parallel_axis(com)[UPPER]
    x, y, z = com
    # The derivative of c.c E - c c^T.
    jacobian[3:, 1:4] = -np.array(
        [[0, 2 * y, 2 * z], [-y, -x, 0], [-z, 0, -x], [2 * x, 0, 2 * z], [0, -z, -y], [2 * x, 2 * y, 0]]
    )
    jacobian[3:, 4:] = np.eye(6)
    return jacobian


def _parallel_axis(point: Array) -> Array:
    """(3, 3) inertia about the origin of a unit mass at a point; each entry from the coordinates it needs alone."""
    x, y, z = point
    return symmetric([y * y + z * z, -x * y, -x * z, x * x + z * z, -y * z, x * x + y * y])
