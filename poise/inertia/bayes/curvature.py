"""Covariance of a body whose mass distribution is uncertain by so much that a linearisation does not hold."""

from collections.abc import Callable

import numpy as np

from poise.types import Array

ANY_MASS = 100.0
"""Variance of the logarithm of the mass: it may be e^10 times the first guess, or e^-10."""

_UNSEEN, _PRECISION = 1e-6, 1e-12
"""An eigenvalue of 1 is that of a direction that the samples do not show. So much larger it may be, absolutely and in
units of the largest eigenvalue, by rounding."""

_DISTANCE = np.sqrt(3.0)
"""Standard deviations of the points from the mean: the fourth moment is then that of a normal distribution."""


def curved_covariance(
    evaluate: Callable[[Array], tuple[Array, Array]], n_parts: int, states: Array, to_states: Array, information: Array
) -> Array:
    """Posterior covariance of phi from cubature points of the states (Arasaratnam and Haykin 2009).

    Inertia is exponential in the deformations and, about a distant origin, hyperbolic in the mass. To first order, the
    covariance of a body of which the samples show little is far too small. What a point adds to the first order is
    weighed by the samples again, because the other states adapt to it.

    Args:
        evaluate: (H, n) states to (H, 10) phi and its derivative (H, 10, n).
        n_parts: K; the first states are the log masses of parts.
        states: (H, n).
        to_states: (H, n, n) root of the prior covariance of the states, without the mass that they have in common.
        information: (H, 10, 10) of the samples about phi.

    Returns:
        (H, 10, 10).
    """
    phi, jacobian = evaluate(states)
    mass = np.sqrt(ANY_MASS) * jacobian[:, :, :n_parts].sum(axis=2, keepdims=True)
    root = np.concatenate([jacobian @ to_states, mass], axis=2)  # (H, 10, n + 1)
    eigenvalues, vectors = np.linalg.eigh(np.eye(root.shape[2]) + root.swapaxes(1, 2) @ information @ root)
    vectors = vectors / np.sqrt(eigenvalues.clip(min=1.0))[:, None]
    for values, directions in zip(eigenvalues, vectors, strict=True):
        _settle(values, directions)
    first = (root @ vectors).swapaxes(1, 2)  # (H, n + 1, 10)
    moved = (to_states @ vectors[:, :-1]).swapaxes(1, 2)
    heavier = np.sqrt(ANY_MASS) * vectors[:, -1, :, None]  # phi is linear in the mass
    system = np.eye(10) + root @ root.swapaxes(1, 2) @ information
    total = np.zeros_like(system)
    for step in (_DISTANCE, -_DISTANCE):
        points = (states[:, None] + step * moved).reshape(-1, states.shape[1])
        there = evaluate(points)[0].reshape(first.shape) * (1 + step * heavier)
        beyond = there - phi[:, None] - step * first
        deviation = step * first + np.linalg.solve(system, beyond.swapaxes(1, 2)).swapaxes(1, 2)
        total += deviation.swapaxes(1, 2) @ deviation / (2 * _DISTANCE**2)
    return np.asarray((total + total.swapaxes(1, 2)) / 2)


def _settle(eigenvalues: Array, vectors: Array) -> None:
    """Choose a basis (w, w) among the directions that the samples do not show, in place.

    Their eigenvalues are equal but for rounding, so that rounding alone chose their eigenvectors, and cubature depends
    on the directions of its points. The new ones are the principal axes of these directions when the states are
    weighed by their number.
    """
    unseen = eigenvalues < 1 + _UNSEEN + _PRECISION * eigenvalues.max()
    some = vectors[:, unseen]
    vectors[:, unseen] = some @ np.linalg.eigh((some.T * np.arange(len(some))) @ some)[1]
