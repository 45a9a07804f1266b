"""What follows from the causes: findings of an estimate, a number that is withheld, and the repair of a wrench."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from poise.errors import ErrorCode
from poise.geometry import STANDARD_GRAVITY, nearest_rotation
from poise.inertia import PARAMETER_NAMES, InertialEstimate, InertialParameters
from poise.inertia.bayes import EXTERNAL_CONTACT
from poise.inertia.model import EstimateFinding
from poise.inertia.verdict import FitSamples
from poise.recording import WrenchStream
from poise.types import Array, Mask, Stamps
from poise.weighing.causes import Cause, chances, inertial_mass, possible_causes
from poise.weighing.fitting import impossible_payload
from poise.weighing.gravity import weight_columns
from poise.weighing.reading import Repair

_SIGMAS = 3.0
_CLEARLY, _FIXED_CLEARLY = 15.0, 5.0
"""Nats that a cause has to gain where the fit passes its tests; less where it has nothing to fit. A wrong unit changes
the number by a factor, and may show in nothing but the small forces of fast turns."""
_LEAST_SHARE, _LEVER = 0.003, 0.1
"""Share of the mass, and m, by which an answer has to change."""
_LACKS = (ErrorCode.TOO_FEW_SAMPLES, ErrorCode.TOPIC_MISSING)
"""Findings of what a recording lacks for a method: any cause may seem to explain what the method leaves then."""
_RIVAL = 10.0
"""Nats: causes this close to the likeliest are named as well."""
_MOST = 3
_ON_EARTH = (9.75, 9.84)
"""m/s2."""
_PLACES = 0.002
"""Relative standard deviation of gravity over the places of the Earth."""
_EMPTY = 0.02
"""kg; a smaller mass may be a compensated one."""
_LARGEST_GAP = 0.2
"""s across which attitudes are interpolated."""

_ACCELERATIONS = 0.05
"""Relative error of a mass that accelerations show; those of joints at 100 Hz are up to this much too small."""


def causes_of(estimate: InertialEstimate) -> tuple[Cause, ...]:
    """The causes of a poor fit or of an impossible payload; of a fit that passes, those that change the answer."""
    return named_and_possible(estimate)[0]


def named_and_possible(estimate: InertialEstimate) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    """`causes_of` an estimate; and where no cause is shown, those that the samples speak for.

    The tests of a fit judge the size of its residual. A cause is more specific, and also explains a small one.
    """
    if estimate.samples is None or any(each.code in _LACKS for each in estimate.findings):
        return (), ()
    pushed = [span for span in estimate.rejected if span.reason == EXTERNAL_CONTACT]
    tried = possible_causes(estimate.samples, float(np.nan_to_num(estimate.delay)), pushed)
    causes = tuple(cause for cause in tried if cause.shown)
    if not causes:
        return (), tuple(cause for cause in tried if not (cause.partial or cause.besides))
    if causes[0].partial and _only_contact(estimate):
        return (), ()
    if estimate.fit.passed and not _impossible(estimate) and not _is_material(estimate, causes[0]):
        return (), ()
    return causes, ()


def _only_contact(estimate: InertialEstimate) -> bool:
    """The estimator found the contact and left it out; the fit of the other samples passes its tests."""
    known = any(finding.code is ErrorCode.IN_CONTACT for finding in estimate.findings)
    return known and all(test.name == "rejected" for test in estimate.fit.failed)


def _is_material(estimate: InertialEstimate, cause: Cause) -> bool:
    """The cause is clear, and with it mass or centre of mass are, or may be, others than in the estimate."""
    found, mass = cause.explanation, float(estimate.phi[0])
    if cause.gain < (_FIXED_CLEARLY if cause.fixed else _CLEARLY) or cause.partial:
        return False
    step = np.abs(cause.phi[:4] - np.nan_to_num(estimate.phi[:4]))
    step[0] = max(step[0], cause.open_pull / STANDARD_GRAVITY)
    spread = np.sqrt(np.diag(found.covariance)[:4] + np.nan_to_num(np.diag(estimate.covariance)[:4]))
    least = _LEAST_SHARE * abs(mass) * np.array([1.0, _LEVER, _LEVER, _LEVER])
    return bool(np.any(step > _SIGMAS * spread + least))


def with_causes(
    estimate: InertialEstimate, causes: Sequence[Cause], possible: Sequence[Cause] = ()
) -> InertialEstimate:
    """The estimate with the likeliest cause, and its rivals, as findings before the others.

    The covariance contains the payloads of these causes; those of `possible` ones by their probability.
    """
    found = findings_of(causes)
    why = _impossible(estimate)
    if why and not found:
        found = [EstimateFinding(ErrorCode.POOR_FIT, f"{why}: check the units and the axes of the wrench")]
    strange = None if any(each.code is ErrorCode.GRAVITY_WRONG for each in found) else _strange_gravity(estimate)
    more = [each for each in (None if found else _maybe_compensated(estimate), strange) if each is not None]
    weighed = [(cause, 1.0) for cause in _named(causes)]
    weighed += zip(possible, chances(possible).tolist(), strict=True)
    covariance = estimate.covariance + _left_open(estimate, weighed)
    return replace(estimate, covariance=covariance, findings=(*found, *more, *estimate.findings))


def findings_of(causes: Sequence[Cause]) -> list[EstimateFinding]:
    """The likeliest cause, and those that explain the samples nearly as well."""
    return [cause.finding for cause in _named(causes)]


def _named(causes: Sequence[Cause]) -> list[Cause]:
    rivals = [cause for cause in causes[:_MOST] if not cause.besides and causes[0].gain - cause.gain < _RIVAL]
    return rivals + [cause for cause in causes if cause.besides]


def _left_open(estimate: InertialEstimate, causes: Sequence[tuple[Cause, float]]) -> Array:
    """(10, 10) by how much payloads of causes differ significantly from an estimate, and their pull.

    Args:
        estimate: without them. causes: with the probability of each.
    """
    phi = np.nan_to_num(estimate.phi)
    by_gravity = _gravity_step(estimate) * phi
    reach = float(np.linalg.norm(phi[1:4])) / max(abs(float(phi[0])), _EMPTY)
    open_part, pull = np.outer(by_gravity, by_gravity), np.zeros(10)
    for cause, chance in causes:
        step = cause.phi - phi
        variance = np.diag(cause.explanation.covariance)[:10] + np.nan_to_num(np.diag(estimate.covariance))
        seen = np.clip(1.0 - variance / np.maximum(step**2, 1e-30), 0.0, 1.0)
        step = np.where(np.isfinite(variance), step * np.sqrt(seen), 0.0)
        open_part += chance * np.outer(step, step)
        point = float(np.linalg.norm([cause.evidence.get(f"point_{axis}", 0.0) for axis in "xyz"]))
        lever = max(reach, point)  # a pull looks like a mass where it acts
        size = np.sqrt(chance) * cause.open_pull / STANDARD_GRAVITY
        pull = np.maximum(pull, size * np.array([1.0] + [lever] * 3 + [lever**2] * 6))
    return np.asarray(open_part + np.diag(pull**2))


def _gravity_step(estimate: InertialEstimate) -> float:
    """Share of the payload that is open because gravity was given as one that the Earth does not have."""
    size = _unearthly_gravity(estimate)
    return 0.0 if size is None else STANDARD_GRAVITY / max(size, 1e-3) - 1.0


def _unearthly_gravity(estimate: InertialEstimate) -> float | None:
    """m/s2 that were given, where no place on Earth has them."""
    size = STANDARD_GRAVITY if estimate.samples is None else float(np.linalg.norm(estimate.samples.gravity))
    return None if _ON_EARTH[0] < size < _ON_EARTH[1] else size


def is_withheld(estimate: InertialEstimate, causes: Sequence[Cause]) -> bool:
    """The numbers mean nothing, or contradict the likeliest cause or a second error by more than their uncertainty."""
    if estimate.fit.is_hopeless or _impossible(estimate) or _is_unseen(estimate):
        return True
    return any(_contradicts(estimate, cause) for cause in causes if cause is causes[0] or cause.besides)


def _contradicts(estimate: InertialEstimate, cause: Cause) -> bool:
    spread = np.hypot(estimate.mass_std, cause.explanation.mass_std)
    return bool(abs(cause.phi[0] - estimate.phi[0]) > _SIGMAS * spread)


def _impossible(estimate: InertialEstimate) -> str:
    return impossible_payload(np.nan_to_num(estimate.phi), np.nan_to_num(estimate.covariance, nan=np.inf))


def _is_unseen(estimate: InertialEstimate) -> bool:
    """A mass of nearly zero that inertial forces alone do not confirm: nothing is held, or it is compensated."""
    found = any(finding.code is ErrorCode.NOT_IDENTIFIABLE for finding in estimate.findings)
    if estimate.samples is None or not (found or _maybe_compensated(estimate) is not None):
        return False
    mass, deviation = inertial_mass(estimate.samples, float(np.nan_to_num(estimate.delay)))
    apart = abs(mass - float(estimate.phi[0]))
    return not (mass > _SIGMAS * deviation and apart < _SIGMAS * np.hypot(deviation, estimate.mass_std))


def _maybe_compensated(estimate: InertialEstimate) -> EstimateFinding | None:
    """A mass of nearly zero: a controller that compensates the payload cannot be excluded."""
    mass = float(estimate.phi[0])
    known = any(each.code in (ErrorCode.NOT_IDENTIFIABLE, ErrorCode.TOPIC_MISSING) for each in estimate.findings)
    if estimate.samples is None or known or not abs(mass) < max(_EMPTY, _SIGMAS * estimate.mass_std):
        return None
    largest = float(np.linalg.norm(estimate.samples.acceleration_in_sensor, axis=1).max(initial=0.0))
    return EstimateFinding(
        ErrorCode.NOT_IDENTIFIABLE,
        f"the weight is that of {mass:.4f} +- {estimate.mass_std:.4f} kg: nothing is held, or the robot's controller"
        f" compensates the payload, which accelerations of up to {largest:.2g} m/s2 do not exclude: switch its"
        " compensation off, or move faster",
        {"mass": mass, "mass_std": estimate.mass_std, "largest_acceleration": largest},
    )


def without_numbers(estimate: InertialEstimate) -> InertialEstimate:
    """The estimate with NaN for the payload: its numbers would be wrong."""
    unknown, spread = np.full(10, np.nan), np.full((10, 10), np.nan)
    parameters = InertialParameters(np.nan, np.full(3, np.nan), np.full((3, 3), np.nan))
    return replace(estimate, parameters=parameters, phi=unknown, covariance=spread, unidentified=PARAMETER_NAMES)


def _strange_gravity(estimate: InertialEstimate) -> EstimateFinding | None:
    """Slow motion does not show the size of gravity: the mass follows from what was given."""
    size = _unearthly_gravity(estimate)
    if size is None:
        return None
    return EstimateFinding(
        ErrorCode.GRAVITY_WRONG,
        f"gravity was given as {size:.4g} m/s2, and is 9.76 to 9.83 m/s2 on Earth; the mass is in proportion to it:"
        " give the --gravity of the place",
        {"gravity": size},
    )


# -- repair ----------------------------------------------------------------------------------------------------------


def repaired_wrench(wrench: WrenchStream, samples: FitSamples, repair: Repair) -> WrenchStream:
    """What the sensor would have read without the cause.

    Args:
        wrench: as recorded.
        samples: of the weighing, for the attitudes of the sensor.
        repair: of the cause. Its factor of gravity is not applied here.
    """
    values, keep = wrench.wrench_in_sensor, np.ones(len(wrench), dtype=bool)
    if repair.limits is not None:
        near = 1e-6 * np.ptp(values, axis=0)
        keep = np.asarray(((values > repair.limits[0] + near) & (values < repair.limits[1] - near)).all(axis=1))
    if repair.base_axes or repair.compensated is not None:
        rotation, known = _attitudes(samples, wrench.stamps)
        keep &= known
        if repair.base_axes:
            parts = values.reshape(-1, 2, 3)
            values = np.einsum("nji,nkj->nki", rotation, parts).reshape(-1, 6)
        if repair.compensated is not None:
            down = np.einsum("nji,j->ni", rotation, samples.gravity)
            values = values + weight_columns(down) @ repair.compensated
    values = values @ repair.wrench.T
    stamps = wrench.stamps - round(1e9 * repair.delay)
    return WrenchStream(stamps[keep], values[keep], wrench.frame_id)


def _attitudes(samples: FitSamples, stamps: Stamps) -> tuple[Array, Mask]:
    """(N, 3, 3) at some stamps, and (N,) where they are known."""
    then, known = (stamps - samples.stamps[0]) * 1e-9, samples.seconds
    turned = samples.rotation_world_sensor.reshape(-1, 9)
    rotation = np.stack([np.interp(then, known, column) for column in turned.T], axis=1).reshape(-1, 3, 3)
    after = np.clip(np.searchsorted(known, then), 1, len(known) - 1)
    gap = known[after] - known[after - 1]
    nearest = np.minimum(np.abs(then - known[after - 1]), np.abs(then - known[after]))
    return nearest_rotation(rotation), np.asarray(
        (nearest < 0.02) | ((gap < _LARGEST_GAP) & (then > 0) & (then < known[-1]))
    )


def after_repair(estimate: InertialEstimate, cause: Cause) -> InertialEstimate:
    """The estimate of a repaired wrench, with the uncertainty of the repair, and with the cause as a finding."""
    finding = replace(cause.finding, message=f"repaired: {cause.sentence}")
    covariance = estimate.covariance + _of_values(cause)
    return replace(estimate, covariance=covariance, findings=(finding, *estimate.findings))


def _of_values(cause: Cause) -> Array:
    """(10, 10) what the uncertainty of a cause's own parameters adds to the covariance of phi."""
    found = cause.explanation
    if cause.repair is not None and cause.repair.compensated is not None:
        # The weight that was added has the mass of this fit, which errors of the accelerations make too small.
        scale = _ACCELERATIONS * np.abs(found.phi[:10])
        return np.asarray(found.covariance[:10, :10] + np.outer(scale, scale))
    if cause.repair is not None and cause.repair.gravity != 1.0:
        is_fitted = cause.repair.gravity == float(np.exp(found.values[0]))  # else it is the standard one
        share = float(np.hypot(_ACCELERATIONS, found.value_stds[0])) if is_fitted else _PLACES
        return np.asarray(share**2 * np.outer(found.phi[:10], found.phi[:10]))
    own = np.arange(16, len(found.covariance))
    across = found.covariance[:10][:, own]
    if not len(own) or not np.isfinite(across).all():
        return np.zeros((10, 10))
    return np.asarray(across @ np.linalg.pinv(found.covariance[np.ix_(own, own)]) @ across.T)
