"""The sensor's bias integrated out of the normal equations, and put back into the answer."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poise.inertia.model import N_UNKNOWNS, NormalEquations
from poise.types import Array


@dataclass(frozen=True, eq=False)
class WithoutBias:
    """Normal equations of phi alone, for B normal priors of the bias about zero.

    Args:
        information, vector: (B, 10, 10) and (B, 10).
        variances: (B, 6) of the prior.
        covariance: (B, 6, 6) of the bias when phi is known.
        mean: (B, 6) the bias for phi = 0, and
        slope: (B, 6, 10) its derivative.
        log_determinant: (B,) of how much the samples narrow the bias.
    """

    information: Array
    vector: Array
    variances: Array
    covariance: Array
    mean: Array
    slope: Array
    log_determinant: Array

    @classmethod
    def of(cls, normals: NormalEquations, variances: Array) -> "WithoutBias":
        """From normal equations (B, 16, 16), (B, 16) and prior variances (B, 6), which may be zero."""
        cross, own = normals.information[:, 10:, :10], normals.information[:, 10:, 10:]
        prior = variances[:, :, None] * np.eye(6)
        system = np.eye(6) + prior @ own
        covariance = np.asarray(np.linalg.solve(system, prior), dtype=np.float64)
        slope = -covariance @ cross
        mean = (covariance @ normals.vector[:, 10:, None])[..., 0]
        return cls(
            information=normals.information[:, :10, :10] + cross.swapaxes(1, 2) @ slope,
            vector=normals.vector[:, :10] - (cross.swapaxes(1, 2) @ mean[..., None])[..., 0],
            variances=variances,
            covariance=covariance,
            mean=mean,
            slope=slope,
            log_determinant=np.linalg.slogdet(system)[1],
        )

    def bias(self, case: NDArray[np.int64], phi: Array) -> Array:
        """(H, 6) the most probable bias for phi (H, 10) of bias cases (H,)."""
        return np.asarray(self.mean[case] + (self.slope[case] @ phi[..., None])[..., 0])

    def log_prior(self, case: NDArray[np.int64], bias: Array) -> Array:
        """(H,) of a bias (H, 6), integrated over its neighbourhood."""
        squares = bias**2 / np.maximum(self.variances[case], np.finfo(np.float64).tiny)
        return np.asarray(-(np.sum(squares, axis=1) + self.log_determinant[case]) / 2)

    def joint_covariance(self, case: NDArray[np.int64], covariance: Array) -> Array:
        """(H, 16, 16) of phi and bias, from that of phi (H, 10, 10)."""
        joint = np.empty((len(case), N_UNKNOWNS, N_UNKNOWNS))
        cross = self.slope[case] @ covariance
        joint[:, :10, :10] = covariance
        joint[:, 10:, :10], joint[:, :10, 10:] = cross, cross.swapaxes(1, 2)
        joint[:, 10:, 10:] = self.covariance[case] + cross @ self.slope[case].swapaxes(1, 2)
        return joint
