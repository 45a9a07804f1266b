"""An identification for reports: uncertainties, residuals and reasons, as numbers and sentences."""

from dataclasses import dataclass

import numpy as np

from poise.inertia.model import PARAMETER_NAMES, UPPER, about_com_jacobian, symmetric
from poise.inertia.pipeline import Identification, InertialEstimate
from poise.types import Array
from poise.viewing.wording import NOT_IDENTIFIABLE, rounded

WHITENESS_LAGS = 20
# Of 20 autocorrelations of N samples of white noise one exceeds 3.5/sqrt(N) in 1 % of cases.
_WHITENESS_BOUND = 3.5
# Long recordings show correlations too weak to matter: below this one, sigma is off by a tenth at the most.
_WEAK_CORRELATION = 0.1
# Fewer residuals than this say nothing about whiteness.
_MIN_FOR_WHITENESS = 60


@dataclass(frozen=True)
class Whiteness:
    """How far a residual is from white noise.

    Args:
        rms: root mean square, in the residual's unit.
        mean: in the residual's unit.
        neighbour_correlation: autocorrelation at one sample, -1 to 1; NaN when there are too few samples.
        strongest_correlation: the largest magnitude among the first 20 autocorrelations; NaN likewise.
        verdict: white, not white, too few samples, all equal.
    """

    rms: float
    mean: float
    neighbour_correlation: float
    strongest_correlation: float
    verdict: str


@dataclass(frozen=True)
class ParameterRow:
    """One line of the answer's table; `value` and `sigma` are rounded, `exact` is not."""

    name: str
    symbol: str
    unit: str
    value: str
    sigma: str
    exact: float
    reason: str


_SYMBOLS = ("mass", "x", "y", "z", "xx", "xy", "xz", "yy", "yz", "zz")
UNITS = ("kg", *["mm"] * 3, *["10⁻³ kg m²"] * 6)
SCALES = np.array([1.0] + [1e3] * 9)
"""From SI to the units shown."""


def shown_parameters(estimate: InertialEstimate) -> Array:
    """(10,) mass, centre of mass, inertia about it, SI; NaN for what is named as unidentified."""
    parameters = estimate.parameters
    values = np.concatenate([[parameters.mass], parameters.com, parameters.inertia[UPPER]])
    values[[name in estimate.unidentified for name in PARAMETER_NAMES]] = np.nan
    return values


def shown_sigmas(estimate: InertialEstimate) -> Array:
    """(10,) standard deviations of `shown_parameters`, SI; NaN where unknown."""
    return np.concatenate([[estimate.mass_std], estimate.com_std, estimate.inertia_std])


def correlation(covariance: Array) -> Array:
    """(n, n) correlations, -1 to 1, of a covariance; NaN where a variance is unknown or zero."""
    variance = np.diag(covariance)
    sigma = np.sqrt(np.where(variance > 0, variance, np.nan))
    return np.asarray(covariance / np.outer(sigma, sigma))


def residual(identification: Identification) -> Array:
    """(N, 6) measured minus predicted wrench, N and N m, in the sensor frame."""
    return np.asarray(identification.wrench_measured - identification.wrench_predicted)


def finite_residual(identification: Identification) -> Array:
    """(M, 6) the residual without the samples that are not finite."""
    left_over = residual(identification)
    return np.asarray(left_over[np.isfinite(left_over).all(axis=1)])


def whiteness(series: Array) -> Whiteness:
    """Judge whether what is left over looks like noise or like forgotten physics.

    Not white is what has one of its first 20 autocorrelations beyond both 0.1 and 3.5/sqrt(N) (after Ljung 1999,
    System Identification, section 16.6). A hint, not a test: uneven sampling is taken as even.

    Args:
        series: (N,) finite residuals in order.
    """
    count = len(series)
    rms = float(np.sqrt(np.mean(series**2))) if count else np.nan
    mean = float(np.mean(series)) if count else np.nan
    centred = series - mean
    power = float(centred @ centred)
    if count < _MIN_FOR_WHITENESS or power == 0:
        return Whiteness(rms, mean, np.nan, np.nan, "too few samples" if power else "all equal")
    correlations = np.array([centred[:-lag] @ centred[lag:] for lag in range(1, WHITENESS_LAGS + 1)]) / power
    strongest = float(np.max(np.abs(correlations)))
    verdict = "not white" if strongest > max(_WEAK_CORRELATION, _WHITENESS_BOUND / np.sqrt(count)) else "white"
    return Whiteness(rms, mean, float(correlations[0]), strongest, verdict)


def parameter_rows(identification: Identification) -> list[ParameterRow]:
    """The ten parameters with their uncertainties, or why this motion does not show them."""
    values = shown_parameters(identification.estimate) * SCALES
    sigmas = shown_sigmas(identification.estimate) * SCALES
    rows = []
    for name, symbol, unit, value, sigma in zip(PARAMETER_NAMES, _SYMBOLS, UNITS, values, sigmas, strict=True):
        shown, spread = rounded(value, sigma)
        reason = why_unidentified(name, identification) if shown == NOT_IDENTIFIABLE else ""
        rows.append(ParameterRow(name, symbol, unit, shown, spread, float(value), reason))
    return rows


def why_unidentified(name: str, identification: Identification) -> str:
    """Say in one sentence, with the motion's own numbers, what kept a parameter from showing."""
    motion = identification.motion
    if name.startswith("i"):
        peaks = np.max(np.abs(motion.angular_acceleration_in_sensor), axis=0, initial=0.0)
        about = ", ".join(f"{peak:.2g}" for peak in peaks)
        return (
            "rotational inertia shows only about axes whose turning speeds up or slows down; "
            f"the greatest angular acceleration about x, y, z was {about} rad/s²"
        )
    down = -motion.rotation_world_sensor[:, 2, :]
    cosine = np.clip(down @ down[0], -1, 1) if len(down) else np.ones(1)
    turned = np.degrees(np.arccos(np.min(cosine)))
    if name == "m":
        return f"weight and force bias look alike until the sensor tilts; it tilted by at most {turned:.0f}°"
    return (
        "the centre of mass shows only across the direction of gravity, and its torque looks like bias until the "
        f"sensor tilts; it tilted by at most {turned:.0f}°"
    )


def covariance_ellipsoid(estimate: InertialEstimate) -> tuple[Array, Array]:
    """Half axes (3,), m, one sigma, and rotation_sensor_axes (3, 3) of the centre of mass's uncertainty.

    NaN half axes when it is not known.
    """
    covariance = com_covariance(estimate)
    if not np.all(np.isfinite(covariance)):
        return np.full(3, np.nan), np.eye(3)
    variances, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    return np.sqrt(np.maximum(variances, 0)), axes


def com_covariance(estimate: InertialEstimate) -> Array:
    """(3, 3) m2 covariance of the centre of mass in the sensor frame, to first order; NaN where unknown."""
    jacobian = about_com_jacobian(estimate.phi)[:3, :4]
    return np.asarray(jacobian @ estimate.covariance[:4, :4] @ jacobian.T)


def equivalent_ellipsoid(estimate: InertialEstimate) -> tuple[Array, Array]:
    """Half axes (3,), m, and rotation_sensor_axes (3, 3) of the homogeneous ellipsoid with this mass and inertia.

    Its second moments about the centre are m h_i^2 / 5. NaN half axes when no such body is known.
    """
    inertia = symmetric(shown_parameters(estimate)[4:])
    mass = estimate.parameters.mass
    if not (np.all(np.isfinite(inertia)) and mass > 0):
        return np.full(3, np.nan), np.eye(3)
    moments, axes = np.linalg.eigh(np.trace(inertia) / 2 * np.eye(3) - inertia)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    with np.errstate(invalid="ignore"):
        return np.sqrt(5 * moments / mass), axes
