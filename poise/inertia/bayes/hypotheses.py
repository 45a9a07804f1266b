"""What may be true of an object and its sensor before the first sample: a few cases, each a Gaussian prior."""

import functools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from poise.inertia.bayes.mass_model import N_DEFORMATIONS, MassModel
from poise.inertia.bayes.materials import Materials
from poise.inertia.model import NoiseLevels
from poise.types import Array, Mask

_DENSITIES = ((0.03, 0.5), (1.0, 0.5))
"""(spread of the log densities of parts, probability): one material, or several (wood and steel differ by e^2.4)."""

_ALIKE = ((0.0, 0.01), (0.99, 0.7))
"""(how much closer to 1 the correlation of like densities is than the likeness says, probability), where several
densities are of parts of which some are alike: each part has its own; one density for each colour, within 2 %. What is
left is the likeness as given. Chosen on random objects with seeds 700 to 795 and on number 2025."""

_LEAST_ALIKE = 0.5
"""Correlation from which on parts are alike."""

_BALANCE = 0.1
"""Probability that parts of different density balance, so that the object looks like one of a single density.

Made things are symmetric, so a centre of mass where one density would have it is no proof of one density.
"""

_CUT_ACCURACY = 0.0045
"""Relative error of lengths from parts that are cut in not quite the right place, where densities differ."""

_SHAPE_ERRORS = ((1.0, 0.9895), (10.0, 0.01))
"""(error of the shape in units of its accuracy, probability): as stated, and bad.

The tail is thin because every case adds its square times its probability to the variance of an answer for which the
samples cannot distinguish the cases.
"""

_UNEVEN, _CUT_FROM = np.array([0.3, 0.5]), 0.005
"""Probabilities that parts have a core or layers of another material, where the parts are guesses: in a shape of this
accuracy or worse, from a cloud or a mesh of one body. The parts of an accurate shape are bodies of their own. With
these the covariance of random objects that have hidden layers is as good as it was before `_LONG`."""

_LONG = 0.5
"""Error of long extents of such a shape over that of its thinnest, at the least. What moves the surface changes every
extent by about the same length, which is a smaller share of a long one. On 320 clouds of random objects and 56 of
tools, stretches of the thinnest axis, the next and the longest were off by 1.04, 0.69 and 0.52 times the accuracy
(medians)."""

_ANSWER_UNEVEN = 0.1
"""The same probability, of both together, for the answer itself: a shape with even parts is preferred to noise that
bends it. The covariance about that answer keeps `_UNEVEN`. Chosen on random objects with seeds 600 to 647."""

_WRONG_SHAPE = (0.5, 0.0005)
"""(relative error of lengths, probability) of a shape that is not the object's."""

_SHIFT_PER_STRETCH = 0.7
"""A centroid errs by this much of the radius of gyration, when the radius errs by one."""

_BIASES = ((0.0, 0.5), (1.0, 0.4), (20.0, 0.1))
"""(spread of the sensor's bias in units of what is expected, probability): zeroed (at least `NoiseLevels.zeroed`), as
expected, never zeroed."""

_EXPECTED_BIAS = (0.5, 0.02)
"""N, N m: of a sensor that was zeroed some time ago; where nothing else is given."""

_UNKNOWN_BIAS = (100.0, 5.0)
"""N, N m: as good as infinite."""

_BLOB_STRETCH = 1.25
"""Spread of the logarithm of a radius of gyration when the shape is not known: hand tools are long or flat."""

_BLOB_SHIFT = 0.15
"""m, spread of the centre of mass about its first guess when the shape is not known."""


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """H cases.

    Args:
        state_variances: (H, K + 9) of a `MassModel` state, about parts of one density and the given shape; those of the
            densities along `MassModel.likeness_axes`. The common scale of the densities, the mass that is, is unknown
            in all cases.
        bias_case: (H,) row of `bias_variances`.
        bias_variances: (B, 6) N^2 and (N m)^2.
        log_probability: (H,).
        wrong_shape: (H,) bool, the case in which the shape is not that of the object.
        as_stated: (H,) bool, the cases in which the shape is as accurate as stated.
        uneven: (H,) bool, the cases in which parts have a core or layers.
        twins: (H,) of one density, the case with several where everything else is the same; of others, the case itself.
        scouts: (B,) the cases to begin with, one for each bias: free enough to follow the samples, and no freer.
        materials: of the parts of a scanned shape; None: nothing is expected of them.
    """

    state_variances: Array
    bias_case: NDArray[np.int64]
    bias_variances: Array
    log_probability: Array
    wrong_shape: Mask
    as_stated: Mask
    uneven: Mask
    twins: NDArray[np.int64]
    scouts: NDArray[np.int64]
    materials: Materials | None = None

    def __len__(self) -> int:
        return len(self.log_probability)

    def rougher(self, variances: Array) -> "Hypotheses":
        """The same with more uncertain deformations, by variances (9,)."""
        more = np.concatenate([np.zeros(self.state_variances.shape[1] - N_DEFORMATIONS), variances])
        return replace(self, state_variances=self.state_variances + more)

    def known_along(self, factors: Array) -> "Hypotheses":
        """The same with the variances of deformations times factors (9,), where the shape is that of the object."""
        scaled = self.state_variances.copy()
        scaled[~self.wrong_shape, -N_DEFORMATIONS:] *= factors
        return replace(self, state_variances=scaled)

    def with_uneven_parts(self, variances: Array, chances: Array) -> "Hypotheses":
        """The same, and the cases of a shape as accurate as stated once more for each way in which parts are uneven.

        Args:
            variances: (U, 9) of the deformations, that are added.
            chances: (U,) probabilities.
        """
        rows = np.flatnonzero(self.as_stated)
        twins = len(self) + np.arange(len(variances))[:, None] * len(rows) + np.searchsorted(rows, self.twins[rows])
        more = [self.rougher(each).state_variances[rows] for each in variances]
        log = self.log_probability + np.where(self.as_stated, np.log1p(-chances.sum()), 0.0)
        log_more = self.log_probability[rows] + np.log(chances)[:, None]
        repeated = np.concatenate([np.arange(len(self)), np.tile(rows, len(variances))])
        return Hypotheses(
            state_variances=np.concatenate([self.state_variances, *more]),
            bias_case=self.bias_case[repeated],
            bias_variances=self.bias_variances,
            log_probability=np.append(log, log_more),
            wrong_shape=self.wrong_shape[repeated],
            as_stated=self.as_stated[repeated],
            uneven=np.arange(len(repeated)) >= len(self),
            twins=np.append(self.twins, twins),
            scouts=twins[-1][-len(self.scouts) :],
        )

    def for_answer(self, left: NDArray[np.int64], log_weights: Array) -> Array:
        """Log weights (H,) of the cases `left` where uneven parts are as improbable as for the answer itself."""
        odds, for_answer = _UNEVEN.sum() / (1 - _UNEVEN.sum()), _ANSWER_UNEVEN / (1 - _ANSWER_UNEVEN)
        return log_weights + np.where(self.uneven[left], np.log(for_answer / odds), 0.0)

    @property
    def of_answer(self) -> list[tuple[Array, float]]:
        """(K + 9,) variances and probability, of a shape as stated with even parts, and of one with layers."""
        stated = np.flatnonzero(self.as_stated)
        variances, even = self.state_variances[stated], ~self.uneven[stated]
        if even.all():
            return [(variances[0], 1.0)]
        return [(variances[even][0], 1 - _ANSWER_UNEVEN), (variances[~even][-1], _ANSWER_UNEVEN)]

    def balanced(self, left: NDArray[np.int64], log_weights: Array) -> Array:
        """Weights (H,) of the cases `left` with the share of one density that may be several in `_BALANCE`."""
        row = np.full(len(self), -1)
        row[left] = np.arange(len(left))
        twin = row[self.twins[left]]
        shares = (twin >= 0) & (twin != np.arange(len(left)))
        result = log_weights.copy()
        giving = log_weights[shares] + np.log(_BALANCE)
        np.logaddexp.at(result, twin[shares], giving)
        result[shares] += np.log1p(-_BALANCE)
        return result


def hypotheses_for_shape(model: MassModel, shape_accuracy: float, resolution: float, noise: NoiseLevels) -> Hypotheses:
    """The cases for an object of known shape.

    Args:
        model: of its parts.
        shape_accuracy: relative error of lengths of the shape; of a shape whose parts are guesses, of the thinnest.
        resolution: m, to which no length is known better.
        noise: says which bias to expect.
    """
    cases, roughness = _cases(_densities(model), shape_accuracy, noise), model.roughness(resolution)
    if shape_accuracy < _CUT_FROM:
        return cases.rougher(roughness)
    known = cases.known_along(model.long_extents(_LONG)).rougher(roughness)
    cases = known.with_uneven_parts(model.unevenness, _UNEVEN)
    return replace(cases, materials=Materials.of(model, shape_accuracy))


def _densities(model: MassModel) -> tuple[tuple[tuple[float, ...], float], ...]:
    """((K,) variances of the log densities along `MassModel.likeness_axes`, probability): one material first, then
    several, the likeness as given last; a single part has no densities to differ."""
    if model.n_parts == 1:
        return (((0.0,), 1.0),)
    given, axes = model.likeness_axes
    alike = float(np.max((axes * given) @ axes.T - np.eye(len(given))))
    (one, chance), (several, left) = _DENSITIES
    kinds = [(one**2 * given, chance)]
    if alike > _LEAST_ALIKE:
        pattern = np.maximum(given - (1 - alike), 0.0) / alike  # of a likeness whose largest entry is 1
        for closer, share in _ALIKE:
            correlation = 1 - (1 - alike) * (1 - closer) if closer else 0.0
            kinds.append((several**2 * (correlation * pattern + 1 - correlation), left * share))
        left *= 1 - sum(share for _, share in _ALIKE)
    kinds.append((several**2 * given, left))
    return tuple((tuple(variances.tolist()), chance) for variances, chance in kinds)


@functools.lru_cache(maxsize=64)
def _cases(
    densities: tuple[tuple[tuple[float, ...], float], ...], shape_accuracy: float, noise: NoiseLevels
) -> Hypotheses:
    """All combinations of densities, `_BIASES` and errors of the shape, or of how it is cut.

    Args:
        densities: as of `_densities`.
        shape_accuracy: relative error of lengths of the shape.
        noise: says which bias to expect.
    """
    biases, n_parts = [probability for _, probability in _BIASES], len(densities[0][0])
    cases = [
        (spreads, error, bias, chance * share * biases[bias], rank)
        for number, (spreads, chance) in enumerate(densities)
        for rank, (error, share) in enumerate(_shapes(max(shape_accuracy, _CUT_ACCURACY if number else 0.0)))
        for bias in range(len(biases))
    ]
    variances = np.empty((len(cases), n_parts + N_DEFORMATIONS))
    for row, (spreads, error, *_) in zip(variances, cases, strict=True):
        row[:n_parts] = spreads
        row[n_parts : n_parts + 6] = error**2
        row[n_parts + 6 :] = (_SHIFT_PER_STRETCH * error) ** 2
    size, per_kind = len(cases), len(cases) // len(densities)
    return Hypotheses(
        state_variances=variances,
        bias_case=np.array([bias for _, _, bias, _, _ in cases]),
        bias_variances=bias_variances(noise),
        log_probability=np.log([probability for *_, probability, _ in cases]),
        wrong_shape=np.array([rank == len(_SHAPE_ERRORS) for *_, rank in cases]),
        as_stated=np.array([rank == 0 for *_, rank in cases]),
        uneven=np.zeros(size, dtype=bool),
        twins=np.where(np.arange(size) < per_kind, size - per_kind, 0) + np.arange(size),
        scouts=size - per_kind + np.arange(len(biases)),
    )


def _shapes(accuracy: float) -> list[tuple[float, float]]:
    """(relative error, probability) of a shape of some accuracy."""
    stated = [(min(factor * accuracy, _WRONG_SHAPE[0]), probability) for factor, probability in _SHAPE_ERRORS]
    return [*stated, _WRONG_SHAPE]


def hypotheses_for_blob(model: MassModel, noise: NoiseLevels) -> Hypotheses:
    """One wide prior for a body of unknown shape, for each bias."""
    biases = [probability for _, probability in _BIASES]
    variances = np.zeros((len(biases), model.n_states))
    variances[:, model.n_parts : model.n_parts + 6] = _BLOB_STRETCH**2
    variances[:, model.n_parts + 6 :] = (_BLOB_SHIFT / model.radii) ** 2
    return Hypotheses(
        state_variances=variances,
        bias_case=np.arange(len(biases)),
        bias_variances=bias_variances(noise),
        log_probability=np.log(biases),
        wrong_shape=np.zeros(len(biases), dtype=bool),
        as_stated=np.ones(len(biases), dtype=bool),
        uneven=np.zeros(len(biases), dtype=bool),
        twins=np.arange(len(biases)),
        scouts=np.arange(len(biases)),
    )


def bias_variances(noise: NoiseLevels) -> Array:
    """(B, 6) N^2 and (N m)^2, of the cases of the sensor's bias."""
    given = np.array([noise.force_bias, noise.torque_bias])
    expected = np.where(given > 0, np.minimum(given, _UNKNOWN_BIAS), _EXPECTED_BIAS)
    factors = [max(factor, noise.zeroed) for factor, _ in _BIASES]
    spreads = np.minimum(np.outer(factors, expected), _UNKNOWN_BIAS)
    return np.repeat(spreads**2, 3, axis=1)
