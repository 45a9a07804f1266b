"""What paired samples go into, by method: sums for least squares, Poise's own recursion, a window for the rest."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Protocol

import numpy as np

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import GRAVITY_IN_WORLD
from poise.inertia.bayes import (
    LAG_STEP,
    LONGEST_DELAY,
    SHAPE_ACCURACY,
    ContinuousEstimator,
    PayloadChange,
    PoiseEstimator,
)
from poise.inertia.estimators.information import InformationAccumulator
from poise.inertia.estimators.least_squares import solve
from poise.inertia.estimators.registry import OWN_METHOD, method, method_names
from poise.inertia.model import IdentificationProblem, InertialSolution, NoiseLevels, Parts, regressor
from poise.robot import SensorMotion
from poise.types import Array

STATIC, OLS, AUTO = "static", "ols", "auto"
LEAST_SQUARES = (AUTO, STATIC, OLS)
"""Say what poses and joints show, live and of a recording alike; an IMU is not asked."""
METHODS = (AUTO, STATIC, OLS, *(name for name in method_names() if name != OLS))
"""`auto` chooses between `static` and `ols`; all but these and `poise` work on a window."""

WATCH = "watch"
"""The run that looks for changes; no method."""

NOTHING = 0.02
"""kg, of an empty hand."""

WINDOW_SAMPLES = 400
"""A window is thinned out evenly to so many: some methods take time with the square of it."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known before a sample is seen.

    Args:
        parts: of the object, in the sensor frame; None when nothing is known of its shape.
        accuracy: relative error of lengths in that shape.
        noise: of samples, and how large a bias to expect.
        gravity: (3,) m/s2 in the world.
        window: s of samples, for methods that work on a window.
        tare: (6,) what the sensor is known to read with nothing on it; `noise` says how well. N and N m.
        since: ns; earlier samples belong to another payload. None: they do not.
        longest_delay, lag_step: s, see `PoiseEstimator`.
    """

    parts: Parts | None = None
    accuracy: float = SHAPE_ACCURACY
    noise: NoiseLevels = field(default_factory=NoiseLevels)
    gravity: Array = field(default_factory=lambda: np.array(GRAVITY_IN_WORLD))
    window: float = 10.0
    tare: Array = field(default_factory=lambda: np.zeros(6))
    since: int | None = None
    longest_delay: float = LONGEST_DELAY
    lag_step: float = LAG_STEP

    @property
    def options(self) -> dict[str, Any]:
        """Of a `PoiseEstimator`."""
        names = {"gravity": self.gravity, "shape_accuracy": self.accuracy}
        return names | {"longest_delay": self.longest_delay, "lag_step": self.lag_step}


class StreamingEstimator(Protocol):
    """Takes samples, and says what they weigh."""

    @property
    def n_samples(self) -> int:
        """Taken so far."""

    def add(self, motion: SensorMotion, wrench: Array) -> None:
        """Take samples in the order of time: a motion and the wrench (N, 6) at its stamps."""

    def solve(self) -> InertialSolution:
        """Estimate from all samples so far.

        Raises:
            NoAnswerError: TOO_FEW_SAMPLES or NOT_IDENTIFIABLE.
        """


def weigher(name: str, prior: Prior) -> StreamingEstimator:
    """That of a method other than `auto`.

    Raises:
        InputError: BAD_INPUT for a name that is no method.
    """
    if name in (STATIC, OLS):
        return LeastSquares(prior)
    return Recursive(prior) if name == OWN_METHOD else Windowed(name, prior)


class LeastSquares:
    """`static` and `ols`: sums that do not grow."""

    def __init__(self, prior: Prior) -> None:
        self._gravity = prior.gravity
        self._information = InformationAccumulator()

    @property
    def n_samples(self) -> int:
        return self._information.n_samples

    def add(self, motion: SensorMotion, wrench: Array) -> None:
        self._information.add(model_matrix(motion, self._gravity), wrench)

    def solve(self) -> InertialSolution:
        return solve(self._information)


class Recursive:
    """`poise`: sums that hardly grow."""

    def __init__(self, prior: Prior) -> None:
        self._estimator = PoiseEstimator(prior.parts, prior.noise, **prior.options)
        self._tare = prior.tare
        self._n_samples = 0

    @property
    def n_samples(self) -> int:
        return self._n_samples

    def add(self, motion: SensorMotion, wrench: Array) -> None:
        self._estimator.add_motion(motion, wrench - self._tare)
        self._n_samples += len(wrench)

    def solve(self) -> InertialSolution:
        solution = self._estimator.solve()
        return replace(solution, bias=solution.bias + self._tare)


class Continuous:
    """`poise` on ordinary work: notices when the payload has changed, and begins anew."""

    def __init__(self, prior: Prior) -> None:
        self._told = prior
        self._estimator = ContinuousEstimator(prior.parts, prior.noise, **prior.options)
        self._parts = prior.parts
        self._n_samples = self._n_changes = 0

    def new_changes(self) -> list[PayloadChange]:
        """Those since the last call."""
        new = self._estimator.changes[self._n_changes :]
        self._n_changes += len(new)
        if new:
            self._parts = None
        return new

    @property
    def is_empty(self) -> bool:
        """Nothing is held, as far as is known."""
        mass = self._estimator.mass
        return mass is not None and mass < NOTHING

    def hold(self, parts: Parts) -> None:
        """Say of what shape the payload is; soon after a change."""
        self._parts = parts
        self._estimator.hold(parts)

    @property
    def prior(self) -> Prior:
        """What is known before the first sample of the payload held now."""
        known = self._estimator
        return replace(self._told, parts=self._parts, noise=known.noise, tare=known.tare, since=known.since)

    @property
    def n_samples(self) -> int:
        return self._n_samples

    def add(self, motion: SensorMotion, wrench: Array) -> None:
        if len(wrench):
            self._estimator.add_motion(motion, wrench)
            self._n_samples += len(wrench)

    def solve(self) -> InertialSolution:
        return self._estimator.solve()


class Windowed:
    """Any other method, on the newest samples."""

    def __init__(self, name: str, prior: Prior) -> None:
        self._prior, self._method = prior, method(name)
        self._portions: deque[tuple[SensorMotion, Array]] = deque()

    @property
    def n_samples(self) -> int:
        return sum(len(wrench) for _, wrench in self._portions)

    def add(self, motion: SensorMotion, wrench: Array) -> None:
        if not len(wrench):
            return
        self._portions.append((motion, wrench))
        oldest = motion.stamps[-1] - round(self._prior.window * 1e9)
        while self._portions[0][0].stamps[-1] < oldest:
            self._portions.popleft()

    def solve(self) -> InertialSolution:
        motions, wrenches = zip(*self._portions, strict=True) if self._portions else ((), ())
        if not motions:
            raise NoAnswerError(ErrorCode.TOO_FEW_SAMPLES, "no wrench sample can be used yet", n_samples=0)
        motion, wrench, prior = joined(motions), np.concatenate(wrenches), self._prior
        # Stamps of real sensors repeat at times; a problem wants them to increase.
        later = np.flatnonzero(np.diff(motion.stamps, prepend=motion.stamps[0] - 1) > 0)
        some = later[np.unique(np.linspace(0, len(later) - 1, WINDOW_SAMPLES).astype(int))]
        known = {}
        if prior.parts is not None:
            known = {"unit_parts": prior.parts.unit_phi, "part_volumes": prior.parts.volumes}
            known["shape_points"] = prior.parts.points
        problem = IdentificationProblem.from_motion(
            motion.select(some), wrench[some] - prior.tare, prior.gravity, noise=prior.noise, **known
        )
        solution = self._method(problem)
        return replace(solution, bias=solution.bias + prior.tare)


def joined(motions: Sequence[SensorMotion]) -> SensorMotion:
    """Motions one after the other."""
    names = [each.name for each in fields(SensorMotion)]
    return SensorMotion(*(np.concatenate([getattr(motion, name) for motion in motions]) for name in names))


def model_matrix(motion: SensorMotion, gravity: Array) -> Array:
    """(N, 6, 10) regressor of a motion, for a gravity vector (3,) in the world."""
    return regressor(
        motion.gravity_in_sensor(gravity) - motion.linear_acceleration_in_sensor,
        motion.angular_velocity_in_sensor,
        motion.angular_acceleration_in_sensor,
    )


def check_method(name: str) -> None:
    """Refuse a name that is no method.

    Raises:
        InputError: BAD_INPUT.
    """
    if name not in METHODS:
        raise InputError(ErrorCode.BAD_INPUT, f"there is no method '{name}'; choose one of {', '.join(METHODS)}")
