"""Weights, delay, outliers and noise depend on the answer and the answer on them: rounds until they agree."""

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.inertia.bayes.averaging import ModelAverage
from poise.inertia.bayes.blocks import MomentBlocks
from poise.inertia.bayes.consistent_part import ConsistentPart, MeanCheck, MomentMeans, consistent_part
from poise.inertia.bayes.delay import Delay, LagGrid
from poise.inertia.bayes.expectation import Expectation
from poise.inertia.bayes.lasting import (
    assumed_variances,
    averaged_out,
    gains,
    lasting_covariance,
    lasting_variances,
    neighbour_correlation,
    variance_of_sum,
)
from poise.inertia.bayes.outliers import UNLIKELY, Residuals, mean_excess, residuals, sample_excess, slow_excess
from poise.inertia.bayes.posterior import Posterior, SolverEffort
from poise.inertia.model import (
    ENTRIES,
    N_MOTION,
    NoiseLevels,
    NormalEquations,
    believable,
    log_likelihood,
    mixed,
    normal_equations,
    residual_covariance,
)
from poise.kernels import CompiledSearch
from poise.types import Array, Indices, Mask

_COARSE, _FINE = SolverEffort(0.1, 10, 0.0), SolverEffort(0.003, 25, 1e-4)
"""Of the first rounds, and of the last ones."""

_MAX_ROUNDS = 16

_IMPATIENT = 3
"""Rounds after which noise and blocks are judged by an answer that still moves: perhaps it does because of them."""

STILL = 0.3
"""Standard deviations; what moves less from round to round has arrived."""

_SAME_NOISE = 0.1
"""Relative change of a variance that does not matter while the search goes on."""

_SAME_RESIDUAL = 0.02
"""The same at the end: intervals are then 1 % too narrow."""

_MOST_REJECTED = 0.2
"""Share of the samples with which a bias is still that of the sensor; a press and an arm that is shaken give it."""


class PosteriorSearch:
    """The rounds of one estimate, and what they arrive at.

    A delay looks like a bias, and either explains part of the other; so every case of the bias has a delay of its own.

    Args:
        blocks: the samples.
        grid: their lags.
        noise: as given.
        average: the hypotheses.
        accuracy: share of the load by which sensor and kinematics may err for a second; 0 where the noise is all.
        free: (B,) the only blocks that may be used, because something else touched the payload in the others; None:
            all may.
    """

    posterior: Posterior
    _normal: NormalEquations

    def __init__(
        self,
        blocks: MomentBlocks,
        grid: LagGrid,
        noise: NoiseLevels,
        average: ModelAverage,
        accuracy: float = 0.0,
        free: Mask | None = None,
    ) -> None:
        self.blocks = blocks
        self.grid = grid
        total = mixed(grid.weights(grid.about), blocks.moments.sum(axis=0))[:N_MOTION, :N_MOTION]
        self.noise = believable(noise, total, int(blocks.sizes.sum()))
        self.average = average
        self._accuracy = accuracy
        self._free: Mask = np.ones(len(blocks), dtype=bool) if free is None else free
        self.keep: Mask = self._free
        """(B,) blocks that a payload explains."""
        self.slow = np.ones(2)
        """(2,) how many samples of force and of torque weigh as much as one, see `slow_excess`."""
        n_cases = len(average.hypotheses.bias_variances)
        self._delays, self._drifts = [Delay()] * n_cases, np.zeros((n_cases, 16))
        self._shares = np.full(n_cases, 1 / n_cases)  # probability of each case of the bias
        self._at_delay = grid.weights(grid.about)  # of the lags
        self._sample = np.ones(2)
        self._phi = average.first_phi

    def run(self) -> "PosteriorSearch":
        """Go round until nothing moves any more."""
        if self.average.kernel is not None:
            self._run_compiled(self.average.kernel)
        else:
            self._run_in_python()
        even = self.average.with_even_parts(self.posterior, self._normal)
        self.posterior = self.average.with_materials(even, self._normal)
        return self

    def _run_in_python(self) -> None:
        normals = self._normals()
        self._find_delays(normals, None)
        self.posterior = self._solve(normals, _COARSE)
        for number in range(_MAX_ROUNDS):
            before = self.posterior
            normals = self._normals()
            self._find_delays(normals, before)
            self.posterior = self._solve(normals, _FINE)
            moved = self._moved(before)
            if (number >= _IMPATIENT or not moved) and not self._judge() and not moved:
                break
        else:  # with the noise that the last judgement found
            self.posterior = self._solve(self._normals(), _FINE)
            self._compare()
        self._allow_for_residuals()
        self.posterior = self.average.with_curvature()

    @property
    def kernel_arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays that the compiled search is given."""
        names = ("moments", "counts", "sizes", "start", "end")
        given = {name: getattr(self.blocks, name) for name in names} | self.grid.arrays | self.average.arrays
        return given | {"free": self._free, "variances": self.noise.wrench**2, "entries": ENTRIES}

    @property
    def kernel_numbers(self) -> dict[str, float]:
        """The numbers that it is given."""
        noise = self.noise
        return self.grid.numbers | {"linear": noise.linear_acceleration, "angular": noise.angular_acceleration}

    def _run_compiled(self, kernel: CompiledSearch) -> None:
        """The same by the kernel."""
        answer = kernel.run(self.average.states, self.kernel_arrays, self.kernel_numbers)
        cases = self.average.hypotheses.bias_case[answer.left]
        found = answer.unknowns, answer.covariance, answer.states, answer.left, cases, answer.log_weights
        self.posterior, self._phi = Posterior(*found), answer.unknowns[:10]
        self._delays = [Delay(*map(float, delay)) for delay in answer.delays]
        self._drifts, self._shares, self._at_delay = answer.drifts, answer.shares, answer.at_delay
        self.keep, self._sample, self.slow = answer.keep, answer.sample, answer.slow
        self._total, self._residual_covariance = answer.total, answer.residual
        self._normal = NormalEquations(answer.information, answer.vector)
        ratios = answer.variance_ratio, answer.mean_ratio
        self.found = Residuals(answer.surprise, *ratios, answer.squares, answer.means)

    @property
    def delay(self) -> Delay:
        """Averaged over the cases of the bias."""
        means = np.array([delay.mean for delay in self._delays])
        squares = means**2 + np.array([delay.std for delay in self._delays]) ** 2
        mean = float(self._shares @ means)
        return Delay(mean, float(np.sqrt(max(self._shares @ squares - mean**2, 0.0))))

    @cached_property
    def covariance(self) -> Array:
        """(16, 16) of phi and bias, with the uncertainty of the delay and errors that last."""
        moved = self._drifts * np.array([delay.std for delay in self._delays])[:, None]
        known = np.asarray(self.posterior.covariance + (moved.T * self._shares) @ moved)
        judged = self.found.means, self.blocks, self.keep
        assumed = assumed_variances(self._phi, self.noise, *judged, self._accuracy)
        variances = np.maximum(lasting_variances(*judged), assumed)
        memory = self._memory
        if not variances.any() and not memory.any():
            return known
        used = self.blocks.select(self.keep)
        sums = np.tensordot(self._at_delay, used.moments[:, :, N_MOTION - 1, :N_MOTION], (0, 1))
        weight = np.asarray(np.linalg.inv(self._residual_covariance), dtype=np.float64)
        gain = gains(sums, self.posterior.covariance, weight)
        added = lasting_covariance(used, gain, variances)
        if memory.any():
            added -= averaged_out(used, gain, self.posterior.covariance, self._residual_covariance, memory)
        return np.asarray(known + added)

    @property
    def _memory(self) -> Array:
        """(2,) correlation of the errors of neighbouring blocks that `slow` allows for."""
        correlation = neighbour_correlation(self.found.means, self.blocks, self.keep)
        part = np.minimum(self.slow, variance_of_sum(correlation))
        return np.asarray((part - 1) / (part + 1))

    @property
    def expectation(self) -> Expectation:
        """What newer samples of the same payload are compared with, block by block."""
        rejected = int(self.blocks.sizes[~self.keep].sum())
        in_block = self._sample * self.slow / variance_of_sum(self._memory)
        return Expectation(
            stamp=int(self.blocks.end[-1]),
            seconds=float(self.blocks.end[-1] - self.blocks.start[0]) * 1e-9,
            unknowns=self.posterior.unknowns,
            covariance=self.covariance,
            noise=self.noise,
            inflation=in_block,
            residual=residual_covariance(self._phi, self.noise, in_block),
            lags=self._at_delay,
            touched=rejected > _MOST_REJECTED * self.blocks.sizes.sum(),
        )

    @cached_property
    def judged(self) -> MeanCheck:
        """The means of all blocks against the answer."""
        return MeanCheck(self.found.means, self.blocks.sizes, self.noise)

    @cached_property
    def distances(self) -> Array:
        """(B,) of these means from the answer, see `MeanCheck`."""
        return self.judged.distances(self.posterior.unknowns)

    def consistent_part(self) -> ConsistentPart | None:
        """The blocks that one payload explains, if the answer does not explain nearly all; see there."""
        check, unknowns, distances = self.judged, self.posterior.unknowns, self.distances
        if not check.doubted(distances):
            return None
        moments = self.blocks.mixed(self._at_delay)
        return consistent_part(MomentMeans.of(moments, check), unknowns, distances)

    @property
    def shown(self) -> Array:
        """(10, 10) what the motion alone says of phi."""
        return self.average.shown(self._normal, self.posterior)

    @property
    def bent(self) -> float:
        """By how much the shape had to be deformed, at most, in any hypothesis that is left."""
        return float(np.abs(self.posterior.states[:, self.average.model.n_parts :]).max())

    @property
    def condition_number(self) -> float:
        """Of the samples' information about phi, weighted by the noise of the sensor, columns scaled to one."""
        moments = mixed(self._at_delay, self._total)
        normal = normal_equations(moments, 0.0, np.diag(self.noise.wrench**2), self.noise)
        information = normal.information[:10, :10]
        scale = np.sqrt(np.diag(information).clip(min=0.0))
        scale[scale == 0] = 1.0
        eigenvalues = np.linalg.eigvalsh(information / np.outer(scale, scale))
        return float(eigenvalues[-1] / eigenvalues[0]) if eigenvalues[0] > 1e-13 else np.inf

    def _normals(self) -> NormalEquations:
        """At all lags, weighted by the last answer."""
        self._total = self.blocks.moments[self.keep].sum(axis=0)
        counts = self.blocks.counts[self.keep].sum(axis=0)
        self._residual_covariance = residual_covariance(self._phi, self.noise, self._sample * self.slow)
        return normal_equations(self._total, counts, self._residual_covariance, self.noise)

    def _find_delays(self, normals: NormalEquations, posterior: Posterior | None) -> None:
        """Compare the lags by the last answer."""
        if len(self.grid) == 1:
            return
        log_evidence, unknowns = self.average.along(normals, posterior)
        self._delays = [self.grid.estimate(log) for log in log_evidence]
        means = np.array([delay.mean for delay in self._delays])
        step = 0.25 * (self.grid.lags[1] - self.grid.lags[0])
        slopes = (self.grid.weights(means + step) - self.grid.weights(means - step)) / (2 * step)
        self._drifts = (slopes[:, None] @ unknowns)[:, 0]

    def _solve(self, normals: NormalEquations, effort: SolverEffort) -> Posterior:
        """Refine the answer."""
        weights = self.grid.weights(np.array([delay.mean for delay in self._delays]))
        totals = mixed(weights, self._total)
        by_delay = np.array([delay.log_integral for delay in self._delays])

        def likelihood(unknowns: Array, cases: Indices) -> Array:
            inflation = self._sample * self.slow
            samples = log_likelihood(totals[cases], unknowns, self.noise, inflation)
            return np.asarray(samples + by_delay[cases])

        posterior = self.average.refine(normals.mixed(weights), likelihood, effort)
        self._phi = posterior.phi
        chances, cases = posterior.weights, posterior.bias_cases
        self._shares = np.array([chances[cases == case].sum() for case in range(len(self._shares))])
        self._at_delay = self._shares @ weights
        self._normal = normals.mixed(self._at_delay)
        return posterior

    def _moved(self, before: Posterior) -> bool:
        """The answer has changed by something against its uncertainty."""
        deviation = np.sqrt(np.diag(self.posterior.covariance))[:10]
        return bool(np.any(np.abs(self.posterior.phi - before.phi) > STILL * deviation))

    def _compare(self) -> None:
        """What the answer leaves of each block."""
        unknowns = self.posterior.unknowns
        self.found = residuals(
            self.blocks.mixed(self._at_delay), self.blocks.sizes, unknowns, self._residual_covariance
        )

    def _allow_for_residuals(self) -> None:
        """Solve once more with the noise that the kept samples have, where that is more than assumed.

        The blocks are not judged again: with more noise, more of a contact would pass for it.
        """
        shown = mean_excess(self.found, self.blocks.sizes, self.keep)
        if _differ(shown, np.ones(2), _SAME_RESIDUAL):
            self._sample = self._sample * shown
            self.posterior = self._solve(self._normals(), _FINE)
            self._compare()

    def _judge(self) -> bool:
        """Judge blocks and noise by the answer; whether that changes anything."""
        self._compare()
        keep = self._free & (self.found.surprise < UNLIKELY)
        if not keep.any():
            keep = self.keep
        other_blocks = bool(np.any(keep != self.keep))
        before = self._sample, self.slow
        self._sample = np.maximum(self._sample * sample_excess(self.found, self.blocks.sizes, self._free), 1.0)
        other_noise = _differ(self._sample, before[0])
        if not other_blocks and not other_noise:
            correlation = neighbour_correlation(self.found.means, self.blocks, keep)
            self.slow = self.slow * slow_excess(self.found, keep, correlation)
            other_noise = _differ(self.slow, before[1])
        self.keep = keep
        if other_blocks or other_noise:  # a hypothesis that was dropped may have been dropped for noise
            self.average.consider()
        return other_blocks or other_noise


def _differ(one: Array, other: Array, notable: float = _SAME_NOISE) -> bool:
    return bool(np.abs(one / other - 1).max() > notable)
