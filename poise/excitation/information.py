"""The information of a motion about a payload, as one number, before the motion is executed."""

from dataclasses import dataclass

import numpy as np

from poise.inertia.model import ENTRIES, InertialParameters, NoiseLevels, Parts, frame_change, residual_covariance
from poise.types import Array

SENSOR = NoiseLevels(force_bias=5.0, torque_bias=0.25)
"""The noise of thesis table 3.2, moderate, on a sensor that was not zeroed."""

_SLACK = 0.2
"""Share of the mass whose place a known shape leaves open: parts are not of one density."""


@dataclass(frozen=True, eq=False)
class PayloadBelief:
    """What is thought of a payload before it is weighed.

    Args:
        phi: (10,) the likeliest, about the sensor's origin.
        covariance: (10, 10) of phi.
    """

    phi: Array
    covariance: Array

    @classmethod
    def ball(cls, centre: Array, radius: float, mass: float) -> "PayloadBelief":
        """Of unknown shape within `radius` m of `centre` (3,) m; a mass in kg of which only the size is known."""
        half = max(radius, 0.02) / 2
        inertia = np.eye(3) * mass * 0.4 * half**2
        at_origin = InertialParameters(mass, np.zeros(3), inertia).phi
        deviation = mass * np.array([1.0, *[half] * 3, *[half**2] * 6])
        move = frame_change(np.eye(3), centre)
        return cls(move @ at_origin, (move * deviation**2) @ move.T)

    @classmethod
    def of_parts(cls, parts: Parts, mass: float) -> "PayloadBelief":
        """Of a known shape: each part's density by itself, and some of the mass anywhere in the object."""
        shares = parts.volumes / parts.volumes.sum()
        columns = parts.unit_phi * (mass * shares)
        phi = columns.sum(axis=1)
        centre = phi[1:4] / phi[0]
        radius = float(np.linalg.norm(parts.points - centre, axis=1).max()) if len(parts.points) else 0.1
        return cls(phi, columns @ columns.T + _SLACK**2 * cls.ball(centre, radius, mass).covariance)


class Information:
    """The expected information of wrench samples about a payload, in nats, and its slope.

    With H the sum of [A, 1]^T W [A, 1] over samples, W the inverse covariance of a residual (force, torque and the
    noise that accelerations bring), and the belief's and the bias' own precision added, the number is

        log det (H_phi - H_phi,bias H_bias^-1 H_bias,phi + P) - log det P,  P = the belief's precision,

    twice what one learns about the ten parameters with the bias unknown (Ds-optimality; Chaloner and Verdinelli 1995,
    "Bayesian experimental design", section 2.2; Swevers et al. 1997 for robots).

    Args:
        belief: the payload.
        noise: of the sensor and of accelerations, per sample.
        rate: Hz of the sensor.
    """

    def __init__(self, belief: PayloadBelief, noise: NoiseLevels = SENSOR, rate: float = 100.0) -> None:
        self.rate = rate
        weight = np.linalg.inv(residual_covariance(belief.phi, noise))
        self._weighted = np.einsum("ij,jpc->ipc", weight, ENTRIES)
        bias = np.maximum(np.repeat([noise.force_bias, noise.torque_bias], 3), 1e-6)
        self._precision = np.zeros((16, 16))
        self._precision[:10, :10] = np.linalg.inv(belief.covariance)
        self._precision[10:, 10:] = np.diag(bias**-2.0)
        self._before = _log_det(self._precision[:10, :10])

    def covariance(self, signals: Array, seconds_each: float) -> Array:
        """(10, 10) of phi after samples with motion signals (N, 13), each standing for some seconds."""
        return np.asarray(np.linalg.inv(self._total(signals, seconds_each))[:10, :10])

    def value(self, signals: Array, seconds_each: float) -> float:
        """Nats that samples with motion signals (N, 13) give; each stands for so many seconds of the sensor's."""
        total = self._total(signals, seconds_each)
        return _log_det(total) - _log_det(total[10:, 10:]) - self._before

    def slope(self, signals: Array, seconds_each: float) -> tuple[float, Array]:
        """The value, and its derivative by the signals (N, 13)."""
        total = self._total(signals, seconds_each)
        inverse = np.linalg.inv(total)
        inverse[10:, 10:] -= np.linalg.inv(total[10:, 10:])
        by_moments = np.einsum("ipc,pr,ird->cd", ENTRIES, inverse, self._weighted, optimize=True)
        value = _log_det(total) - _log_det(total[10:, 10:]) - self._before
        scale = self.rate * seconds_each
        return value, scale * signals @ (by_moments + by_moments.T)

    def _total(self, signals: Array, seconds_each: float) -> Array:
        moments = signals.T @ signals * (self.rate * seconds_each)
        information = np.einsum("ipc,cd,ird->pr", ENTRIES, moments, self._weighted, optimize=True)
        return np.asarray(self._precision + (information + information.T) / 2)


def _log_det(matrix: Array) -> float:
    return float(np.linalg.slogdet(matrix)[1])
