"""Of which materials the parts of a scanned object may be, and the body that they and the samples make most probable.

At rest, samples show the mass and the centre of mass: four numbers with noise, which several densities would follow.
The densities of made things are not any numbers: they are those of a few kinds of material, or of something else.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from poise.inertia.bayes.mass_model import N_DEFORMATIONS, MassModel
from poise.inertia.bayes.small_systems import apply, seen_through, solve
from poise.types import Array, Indices

_KINDS = np.array(
    [(1000.0, 0.3, 0.35), (2700.0, 0.06, 0.1), (7900.0, 0.07, 0.25), (2000.0, 1.3, 0.25), (20.0, 1.0, 0.05)]
)
"""kg/m3, spread of its logarithm, probability: wood, plastics and rubber; aluminium; steel and brass; anything else,
such as hollow, ceramic or composed parts; and nearly nothing, as foam, or what may be hollow of a scan."""

_ELSE = 3
"""The row of anything else."""

_ONE_KIND = 0.5
"""Probability that groups of parts that differ in colour are of one material."""

_LIKENESS, _OWN = 0.1, 0.02
"""Probabilities beside those above of densities as alike as the likeness says, and of one of its own for each part:
parts may be cut or painted so that one colour has two materials."""

_CUT = 0.03
"""Relative error of the volume of a part that is the whole; that of a smaller one grows with the root of its share."""

_VOLUME = 4.3
"""Relative error of the volume over the accuracy of lengths of a solid from a cloud (`cloud_accuracy`)."""

_MOST_GROUPS = 4
"""More groups have too many combinations."""

_SAME_GROUP = 0.5
"""Likeness from which on two parts are expected to have one density."""

_EXCLUDED = 4.0
"""Standard deviations of the mass from which on a solid is of nothing that exists: its unit may be wrong."""

_UNLIKELY = 8.0
"""Combinations whose mass alone is less probable by this, in nats, are left out."""

_ROUNDS, _SETTLED, _SHORTENING = 40, 0.01, 0.25
"""Of Gauss-Newton: most rounds, gain of the last one, and what a step for the worse is cut by."""

_LARGEST_FALL, _LARGEST_STEP = 0.8, 0.5
"""Share of its mass that a part may lose in a round, and change of a deformation."""

_Linearised = Callable[[Array], tuple[Array, Array]]
"""(H, 10) phi and (H, 10, n) its derivative at states (H, n)."""


@dataclass(frozen=True, eq=False)
class Materials:
    """C combinations of materials, as normal priors of the log masses of a `MassModel`.

    Args:
        means: (C, K) logarithms of the masses that the whole would have with the density of each part.
        covariances: (C, K, K).
        log_probability: (C,).
        starts: (C, K) log masses near which the most probable ones are.
    """

    means: Array
    covariances: Array
    log_probability: Array
    starts: Array

    @classmethod
    def of(cls, model: MassModel, accuracy: float) -> "Materials | None":
        """Of the parts of a solid from a cloud, whose thinnest lengths have a relative accuracy; None: nothing to say.

        A single part has the same centre of mass and shape of any material.
        """
        alike = np.eye(model.n_parts) if model.likeness is None else model.likeness
        group = _groups(alike)
        if model.n_parts == 1 or group.max() >= _MOST_GROUPS:
            return None
        several = 1 - _ONE_KIND if group.any() else 0.0
        density, spread, _ = _KINDS[_ELSE]
        anything = np.full((2, len(group)), density), spread**2 + np.stack([alike, np.eye(len(group))])
        cases = [
            *([_of_groups(group, several)] if several else []),
            _of_groups(np.zeros_like(group), 1 - several),
            (*anything, np.array([_LIKENESS, _OWN])),
        ]
        densities, covariances, chances = (np.concatenate(column) for column in zip(*cases, strict=True))
        volume = (_VOLUME * accuracy) ** 2 + np.diag(_CUT**2 / model.shares)
        means = np.log(densities * model.volume)
        return cls(means, covariances + volume, np.log(chances), means)

    def likely(self, shares: Array, mass: float) -> "Materials | None":
        """Those that a mass, kg, does not exclude, for parts with these shares (K,) of the volume; None: all are."""
        masses = shares * np.exp(self.means)
        off = np.log(mass / masses.sum(axis=1))
        weights = masses / masses.sum(axis=1, keepdims=True)
        variance = np.einsum("ck,ckl,cl->c", weights, self.covariances, weights)
        if np.min(off**2 / variance) > _EXCLUDED**2:
            return None
        log = self.log_probability - (off**2 / variance + np.log(variance)) / 2
        kept = log > log.max() - _UNLIKELY
        starts = self.means + off[:, None]
        return Materials(self.means[kept], self.covariances[kept], self.log_probability[kept], starts[kept])

    def bodies(self, linearised: _Linearised, samples: tuple[Array, Array], variances: Array) -> tuple[Array, Array]:
        """(C, 10) phi of the body that each combination and the samples make most probable, and (C,) its log evidence.

        Args:
            linearised: phi at states, which are log masses, then deformations.
            samples: (10, 10) information and (10,) vector of phi, the bias integrated out.
            variances: (9,) of the deformations.
        """
        (count, n_parts), (information, vector) = self.means.shape, samples
        mean = np.concatenate([self.means, np.zeros((count, N_DEFORMATIONS))], axis=1)
        root = np.zeros((count, mean.shape[1], mean.shape[1]))
        root[:, :n_parts, :n_parts] = np.linalg.cholesky(self.covariances)
        root[:, range(n_parts, mean.shape[1]), range(n_parts, mean.shape[1])] = np.sqrt(variances)
        states, best = mean.copy(), np.full(count, -np.inf)
        states[:, :n_parts] = self.starts
        step, length, moving = np.zeros_like(mean), np.ones(count), np.arange(count)
        for _ in range(_ROUNDS):
            trial = _moved(states[moving], length[moving, None] * step[moving], n_parts)
            phi, jacobian = linearised(trial)
            away = solve(root[moving], (trial - mean[moving])[..., None])[..., 0]
            log = phi @ vector - (np.sum(phi * (phi @ information), axis=1) + np.sum(away**2, axis=1)) / 2
            gain = log - best[moving]
            better = gain >= 0
            gained = moving[better]
            length[moving] = np.where(better, 1.0, _SHORTENING * length[moving])
            states[gained], best[gained] = trial[better], log[better]
            offset = (mean[moving] - trial)[better]
            step[gained] = _gauss_newton(phi[better], jacobian[better], root[gained], offset, samples)
            moving = moving[np.abs(gain) > _SETTLED]
            if not len(moving):
                break
        phi, jacobian = linearised(states)
        system, scale = seen_through(jacobian @ root, information)
        determinants = np.linalg.slogdet(system)[1] + 2 * np.log(scale).sum(axis=1)
        return phi, np.asarray(self.log_probability + best - determinants / 2)


def _gauss_newton(phi: Array, jacobian: Array, root: Array, offset: Array, samples: tuple[Array, Array]) -> Array:
    """(C, n) relative changes of masses and changes of deformations; offset (C, n) leads to the mean of the prior."""
    information, vector = samples
    seen = jacobian @ root
    gradient = vector - (phi + apply(jacobian, offset)) @ information
    system, scale = seen_through(seen, information)
    pull = apply(seen.swapaxes(1, 2), gradient) / scale
    return np.asarray(offset + apply(root, solve(system, pull[..., None])[..., 0] / scale))


def _moved(states: Array, step: Array, n_parts: int) -> Array:
    """States after their steps, which are shortened so that masses stay positive."""
    fall = -step[:, :n_parts].min(axis=1) / _LARGEST_FALL
    turn = np.abs(step[:, n_parts:]).max(axis=1) / _LARGEST_STEP
    taken = step / np.maximum(1.0, np.maximum(fall, turn))[:, None]
    taken[:, :n_parts] = np.log1p(taken[:, :n_parts])
    return np.asarray(states + taken)


def _of_groups(group: Indices, chance: float) -> tuple[Array, Array, Array]:
    """(C, K) densities, (C, K, K) covariances of their logarithms, (C,) probabilities: any kind for each group."""
    count = int(group.max()) + 1
    choices = np.indices((len(_KINDS),) * count).reshape(count, -1).T
    density, spread, share = np.moveaxis(_KINDS[choices], 2, 0)
    covariances = (group[:, None] == group) * spread[:, group, None] ** 2
    return density[:, group], covariances, chance * share.prod(axis=1)


def _groups(alike: Array) -> Indices:
    """(K,) group of each part, numbered from 0: that of the first part it is like, or a new one."""
    group = np.arange(len(alike))
    for part in range(len(alike)):
        group[part] = group[np.argmax(alike[part, : part + 1] > _SAME_GROUP)]
    return np.unique(group, return_inverse=True)[1]
