"""What a reading is: another way to understand the same samples, as a design, and what it says when it fits."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from poise.errors import ErrorCode
from poise.inertia.model import signal_columns
from poise.inertia.verdict import FitSamples
from poise.types import Array, Mask
from poise.weighing.fitting import Explanation, ReadingDesign
from poise.weighing.fixed_errors import FixedError


@dataclass(frozen=True, eq=False)
class Repair:
    """How to make the recorded wrench what the sensor would have read without the cause.

    Args:
        wrench: (6, 6) factor of the wrench.
        base_axes: the wrench is first turned from the axes of the base to those of the sensor.
        delay: s that are subtracted from the stamps.
        gravity: factor of the size of gravity.
        limits: (2, 6) readings at or beyond which a sample is dropped; None: none.
        compensated: (4,) kg and kg m, m and m c whose weight is added.
    """

    wrench: Array = field(default_factory=lambda: np.eye(6))
    base_axes: bool = False
    delay: float = 0.0
    gravity: float = 1.0
    limits: Array | None = None
    compensated: Array | None = None


Says = Callable[[Explanation], tuple[str, Mapping[str, float]]]
"""The sentence and the numbers of a fit."""


def no_pull(found: Explanation) -> float:
    """Nothing of the weight is open."""
    del found
    return 0.0


def same_payload(found: Explanation) -> Array:
    """(10,) phi at the end of the recording, where the payload does not change."""
    return found.phi


def shows_payload(found: Explanation) -> bool:
    """Its mass is above zero by more than chance."""
    return bool(found.phi[0] > max(_SURELY * found.mass_std, _LIGHTEST))


_SURELY, _LIGHTEST = 3.0, 0.005
"""Standard deviations, and kg."""


@dataclass(frozen=True, eq=False)
class Reading:
    """One candidate for what is wrong.

    Args:
        code: what kind.
        design: of the measured wrench.
        says: the sentence and the numbers of a fit.
        starts: of the values.
        prior: log of how often it happens, relative to the others.
        usable: (N, 6) the readings that the fit uses; None: all.
        ignores: the readings that are not usable are not compared either.
        censored: (2, 6) limits at which the prediction is cut before it is compared; None: none.
        excluded: (B,) blocks that its design does not explain, each at the cost of two parameters; None: none.
        reduced: the residual (N, 6) that two parameters for each excluded block leave of a fit; None: nothing of it.
        holds: whether a fit is what the reading says; by default, that it shows a payload.
        repair: of a fit; None: the wrench cannot be repaired.
        open_pull: N of a constant vertical force that may pull as well, and cannot be distinguished from weight.
        last: phi (10,) at the end of the recording.
    """

    code: ErrorCode
    design: ReadingDesign
    says: Says
    starts: tuple[tuple[float, ...], ...] = ((),)
    prior: float = 0.0
    usable: Mask | None = None
    ignores: bool = False
    censored: Array | None = None
    excluded: Mask | None = None
    reduced: Callable[[Explanation], Array] | None = None
    holds: Callable[[Explanation], bool] = shows_payload
    repair: Callable[[Explanation], Repair] | None = None
    open_pull: Callable[[Explanation], float] = no_pull
    last: Callable[[Explanation], Array] = same_payload


Family = Callable[[FitSamples, Explanation], list[Reading]]
"""Candidates of one kind, for samples and their plain explanation."""


def fixed_reading(error: FixedError, measured: str = "", more: Mapping[str, float] = MappingProxyType({})) -> Reading:
    """The load's wrench seen through a fixed matrix; the bias is in the axes of the reading.

    Args:
        error: which.
        measured: what else the samples say about it, behind what it is.
        more: numbers behind that.
    """

    def design(samples: FitSamples, values: Array) -> Array:
        del values
        columns = signal_columns(samples.signals)
        columns[:, :, :10] = error.matrix @ columns[:, :, :10]
        return columns

    what, fix = error.sentence.split(": ", 1)
    said = (f"{what}{measured}: {fix}", {**error.evidence, **more})
    repair = Repair(wrench=np.asarray(np.linalg.inv(error.matrix)))
    return Reading(error.code, design, lambda found: said, prior=error.prior, repair=lambda found: repair)
