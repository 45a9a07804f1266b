"""Poise's own estimator: part masses, slack, bias and delay from the sums over all samples, with honest covariance."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import GRAVITY_IN_WORLD, runs
from poise.inertia.bayes.averaging import ModelAverage
from poise.inertia.bayes.blocks import BLOCK, MomentBlocks
from poise.inertia.bayes.consistent_part import LIMIT, ConsistentPart, away_from_contact, in_contact
from poise.inertia.bayes.delay import LAG_STEP, LagGrid
from poise.inertia.bayes.expectation import Expectation
from poise.inertia.bayes.findings import (
    not_shown,
    nothing_held,
    outside,
    with_weak_mass,
    wrong_shape,
    zeroed_under_load,
)
from poise.inertia.bayes.first_guess import blob, states_of_shape
from poise.inertia.bayes.hypotheses import bias_variances, hypotheses_for_blob, hypotheses_for_shape
from poise.inertia.bayes.mass_model import MassModel
from poise.inertia.bayes.recorder import BlockRecorder
from poise.inertia.bayes.search import PosteriorSearch
from poise.inertia.bayes.single_samples import SingleSamples
from poise.inertia.model import (
    NOT_FINITE,
    OUT_OF_ORDER,
    IdentificationProblem,
    InertialParameters,
    InertialSolution,
    NoiseLevels,
    Parts,
    RejectedInterval,
    RejectionLog,
    SampleChecks,
    mixed,
    normal_equations,
    root_mean_square,
)
from poise.robot import USED
from poise.types import Array, Mask, Stamps

LONGEST_DELAY = 0.06
"""s, either way."""

SHAPE_ACCURACY = 0.0007
"""Relative error of lengths in a shape from CAD; one from a scan is good to 0.03, say."""

_SHAPE_RESOLUTION = 1e-5
"""m: no length is known better, however short."""

_BENT = 0.02
"""Deformation of the shape from which the centre of mass might be outside."""

EXTERNAL_CONTACT = "external_contact"

_MAX_INTERVALS = 1000
"""Rejected intervals that are remembered."""


@dataclass(frozen=True, eq=False)
class BayesSolution(InertialSolution):
    """What `PoiseEstimator` makes of the samples. phi and its covariance are whole: what the motion alone does not
    show (`unidentified`) is known from the shape, as well as the covariance says, and is not NaN.

    Args:
        stamp: of the newest sample used, ns.
        points: (P, 3) m whose hull is the object's; may be empty.
    """

    stamp: int = 0
    points: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def parameters(self) -> InertialParameters:
        """Mass, centre of mass, inertia about it."""
        return InertialParameters.from_phi(self.phi)

    @property
    def consistent(self) -> bool:
        """A body with these parameters can exist: the pseudo-inertia is positive definite."""
        return self.parameters.is_consistent

    @cached_property
    def com_in_hull(self) -> bool | None:
        """The centre of mass lies in the convex hull of the object; None when its outline is not known."""
        if len(self.points) < 4:
            return None
        try:
            faces = scipy.spatial.ConvexHull(self.points).equations
        except scipy.spatial.QhullError:  # a flat outline has no inside
            return None
        return bool(np.all(faces[:, :3] @ self.parameters.com + faces[:, 3] <= 1e-9))


class PoiseEstimator:
    """Recursive estimator of what a sensor holds. Samples are kept in sums, so that their portions do not matter.

    See docs/estimator.md for the mathematics.

    Args:
        parts: of the object, in the sensor frame; None when nothing is known of its shape.
        noise: of samples, and how large a bias to expect.
        gravity: (3,) m/s2 in the world.
        limits: (6,) |wrench| from which the sensor is saturated, N and N m.
        longest_delay: s between the clocks, either way; 0 when it is known to be `delay`.
        lag_step: s in which the motion hardly changes.
        delay: s, wrench stamps minus kinematics stamps, about which the delay is looked for.
        shape_accuracy: relative error of lengths in the shape; of one from a scan, of its thinnest extent.
        block: ns of samples that are kept, or left out, together.
        load_accuracy: share of the load by which sensor and kinematics may err for a second; 0 where the noise is all.
        averaged: use the average motion of each block only, because an accelerometer measures it.

    Raises:
        InputError: BAD_INPUT for noise levels or accuracies that are not positive.
    """

    def __init__(
        self,
        parts: Parts | None = None,
        noise: NoiseLevels | None = None,
        *,
        gravity: ArrayLike = GRAVITY_IN_WORLD,
        limits: ArrayLike = np.inf,
        longest_delay: float = LONGEST_DELAY,
        lag_step: float = LAG_STEP,
        delay: float = 0.0,
        shape_accuracy: float = SHAPE_ACCURACY,
        block: int = BLOCK,
        load_accuracy: float = 0.0,
        averaged: bool = False,
    ) -> None:
        self.parts = parts
        self.noise = noise or NoiseLevels()
        self.gravity = np.asarray(gravity, dtype=np.float64)
        if not (min(self.noise.force, self.noise.torque) > 0 and shape_accuracy > 0 and longest_delay >= 0):
            raise InputError(
                ErrorCode.BAD_INPUT,
                f"estimator: noise of {self.noise.force} N and {self.noise.torque} N m, shape accuracy"
                f" {shape_accuracy}, longest delay {longest_delay} s: the first three must be positive, and no sensor"
                " is without noise",
            )
        self.shape_accuracy = shape_accuracy
        self._load_accuracy, self._averaged = load_accuracy, averaged
        self._grid = LagGrid(longest_delay, lag_step, delay)
        self._recorder = BlockRecorder(self._grid, block)
        self._one = SingleSamples()
        self._checks, self._log = SampleChecks(limits), RejectionLog(_MAX_INTERVALS)
        self._search: PosteriorSearch | None = None
        self._model = None if parts is None else MassModel.of_parts(parts.unit_phi, parts.volumes, parts.likeness)

    def add(
        self,
        stamps: ArrayLike,
        gravity_in_sensor: ArrayLike,
        linear_acceleration: ArrayLike,
        angular_velocity: ArrayLike,
        angular_acceleration: ArrayLike,
        wrench: ArrayLike,
    ) -> None:
        """Check and add samples in the order of time, one or many.

        Args:
            stamps: (N,) ns.
            gravity_in_sensor, linear_acceleration: (N, 3) m/s2, in the sensor frame as all that follow.
            angular_velocity, angular_acceleration: (N, 3) rad/s and rad/s2.
            wrench: (N, 6) N and N m.

        Raises:
            InputError: TYPE_MISMATCH when the shapes do not belong together.
        """
        given = (gravity_in_sensor, linear_acceleration, angular_velocity, angular_acceleration, wrench)
        if not self._one.take(stamps, given):
            self._add_waiting()
            if not self._one.take(stamps, given):
                self._add_many(stamps, *given)

    def _add_waiting(self) -> None:
        """Check and sum the samples that came one by one."""
        if len(self._one):
            self._add_many(*self._one.taken())

    def _add_many(
        self,
        stamps: ArrayLike,
        gravity_in_sensor: ArrayLike,
        linear_acceleration: ArrayLike,
        angular_velocity: ArrayLike,
        angular_acceleration: ArrayLike,
        wrench: ArrayLike,
    ) -> None:
        when = np.asarray(stamps, dtype=np.int64).reshape(-1)
        specific = np.subtract(gravity_in_sensor, linear_acceleration)
        given = (specific, angular_velocity, angular_acceleration, wrench)
        columns = [np.asarray(value, dtype=np.float64).reshape(-1, 6 if value is wrench else 3) for value in given]
        if any(len(column) != len(when) for column in columns):
            raise InputError(
                ErrorCode.TYPE_MISMATCH,
                f"estimator: {len(when)} stamps came with {[len(column) for column in columns]} rows of"
                " g - a, omega, alpha and wrench; give one row per stamp",
            )
        rows = np.concatenate(columns, axis=1)
        known = np.isfinite(rows[:, :9]).all(axis=1)
        motion_reasons = np.where(known, USED, NOT_FINITE)
        reasons = self._checks.judge(when, columns[3], columns[1], motion_reasons)
        self._log.add(when, reasons)
        known &= reasons != OUT_OF_ORDER
        self._recorder.add(when[known], rows[known], reasons[known] == USED)

    def add_problem(self, problem: IdentificationProblem) -> None:
        """Add all samples of a problem."""
        self.add(
            problem.stamps,
            problem.gravity_in_sensor,
            problem.linear_acceleration,
            problem.angular_velocity,
            problem.angular_acceleration,
            problem.wrench,
        )

    def add_rows(self, stamps: Stamps, rows: Array) -> None:
        """Add samples that have been checked already, see `sample_rows`: (N,) ns, increasing, and (N, 15)."""
        self._add_waiting()
        self._recorder.add(stamps, rows, np.ones(len(stamps), dtype=bool))

    def solve(self, noise: NoiseLevels | None = None, *, use_shape: bool = True) -> BayesSolution:
        """Estimate from all samples so far.

        Args:
            noise: of samples from now on; None: as before.
            use_shape: False: as if nothing were known of the shape.

        Raises:
            NoAnswerError: TOO_FEW_SAMPLES when fewer than three samples can be used.
        """
        self.noise = noise or self.noise
        blocks = self.blocks
        if blocks.sizes.sum() < 3:
            counts = ", ".join(f"{count} {reason}" for reason, count in self._log.counts.items())
            raise NoAnswerError(
                ErrorCode.TOO_FEW_SAMPLES,
                f"{blocks.sizes.sum()} wrench samples can be used, and at least 3 are needed; rejected:"
                f" {counts or 'none'}",
                n_samples=int(blocks.sizes.sum()),
            )
        model = self._model if use_shape else None
        given = blocks, self._grid, self.noise
        self._search = PosteriorSearch(*given, self._prior(blocks, model), self._load_accuracy).run()
        part = self._search.consistent_part()
        if part is not None and part.free is not None:
            free = away_from_contact(part.free)
            prior = self._prior(blocks.select(free), model)
            self._search = PosteriorSearch(*given, prior, self._load_accuracy, free).run()
        return self._solution(self._search, None if model is None else self.parts, part)

    @property
    def blocks(self) -> MomentBlocks:
        """The samples so far; valid until more are added."""
        self._add_waiting()
        blocks = self._recorder.blocks
        return blocks.averaged() if self._averaged else blocks

    @property
    def expectation(self) -> Expectation | None:
        """What newer samples are compared with, by the last solution; None before there is one."""
        return None if self._search is None else self._search.expectation

    def _prior(self, blocks: MomentBlocks, mass_model: MassModel | None) -> ModelAverage:
        """What may be true of the object, and where to begin."""
        moments = mixed(self._grid.weights(self._grid.about), blocks.moments.sum(axis=0))
        normal = normal_equations(moments, blocks.sizes.sum(), np.diag(self.noise.wrench**2), self.noise)
        if mass_model is None:
            model, starts = blob(normal, bias_variances(self.noise))
            return ModelAverage(model, hypotheses_for_blob(model, self.noise), starts)
        hypotheses = hypotheses_for_shape(mass_model, self.shape_accuracy, _SHAPE_RESOLUTION, self.noise)
        starts = states_of_shape(mass_model, normal, hypotheses.bias_variances)
        return ModelAverage(mass_model, hypotheses, starts)

    def _solution(self, search: PosteriorSearch, parts: Parts | None, part: ConsistentPart | None) -> BayesSolution:
        posterior, blocks, keep = search.posterior, search.blocks, search.keep
        unknowns, covariance, delay = posterior.unknowns, search.covariance, search.delay
        if parts is None:
            covariance = with_weak_mass(covariance, unknowns[:10], search.shown)
        if part is not None:
            covariance = covariance + part.spread
        n = int(blocks.sizes[keep].sum())
        squares = search.found.squares[keep].sum(axis=0)
        doubt = float(posterior.weights @ search.average.hypotheses.wrong_shape[posterior.left])
        touched = ~keep & (search.distances > LIMIT)
        findings = [
            nothing_held(unknowns[0], float(np.sqrt(covariance[0, 0])), self.noise.force),
            wrong_shape(doubt),
            zeroed_under_load(unknowns, covariance, float(np.linalg.norm(self.gravity)), self.noise.wrench),
            in_contact(blocks.sizes, touched, float(unknowns[0]), None if part is None else part.rival),
        ]
        estimated = len(self._grid) > 1
        solution = BayesSolution(
            phi=unknowns[:10],
            covariance=covariance[:10, :10],
            bias=unknowns[10:],
            bias_covariance=covariance[10:, 10:],
            unidentified=not_shown(search.shown, unknowns[:10]),
            condition_number=search.condition_number,
            residual_force=root_mean_square(squares[0], n),
            residual_torque=root_mean_square(squares[1], n),
            n_samples=n,
            n_effective=float(n / search.slow.max()),
            stamp=int(blocks.end[keep][-1]),
            delay=delay.mean if estimated else np.nan,
            delay_std=delay.std if estimated else np.nan,
            rejected=tuple(sorted((*self._log.intervals, *pushed(blocks, keep)), key=lambda span: span.start)),
            points=np.zeros((0, 3)) if parts is None else parts.points,
        )
        # Parts lie inside the hull; only a shape that is bent to fit can leave it.
        if not findings[1] and search.bent > _BENT and solution.com_in_hull is False:
            findings.append(outside(solution.parameters.com))
        return replace(solution, findings=tuple(finding for finding in findings if finding is not None))


def pushed(blocks: MomentBlocks, keep: Mask) -> list[RejectedInterval]:
    """Stretches of blocks that were not kept."""
    spans: list[RejectedInterval] = []
    for first, last in runs(~keep):
        start, end = int(blocks.start[first]), int(blocks.end[last])
        spans.append(RejectedInterval(start, end, int(blocks.sizes[first : last + 1].sum()), EXTERNAL_CONTACT))
    return spans


def poise(problem: IdentificationProblem) -> BayesSolution:
    """`PoiseEstimator` on all samples of a problem at once; the calling form of all methods.

    Raises:
        NoAnswerError: TOO_FEW_SAMPLES.
    """
    parts = None
    if problem.unit_parts is not None:
        volumes = np.ones(problem.unit_parts.shape[1]) if problem.part_volumes is None else problem.part_volumes
        points = np.zeros((0, 3)) if problem.shape_points is None else problem.shape_points
        parts = Parts(problem.unit_parts, volumes, points)
    estimator = PoiseEstimator(parts, problem.noise)
    estimator.add_problem(problem)
    return estimator.solve()
