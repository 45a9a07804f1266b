"""Hypotheses about a payload: their most probable states, their evidence and their covariance."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.types import Array

_INT, _DOUBLE, _POINTER = ctypes.c_int64, ctypes.c_double, ctypes.c_void_p
_ARRAYS = ("moments", "shares", "guess", "root", "unrooted", "flat", "products")
_PHI, _UNKNOWNS = 10, 16


class _Model(ctypes.Structure):
    """Layout of `struct mass_model` in kernels/mass.h."""

    _fields_ = [
        *((name, _INT) for name in ("parts", "states", "halvings")),
        *((name, _DOUBLE) for name in ("scale", "any_mass")),
        *((name, _POINTER) for name in _ARRAYS),
    ]


class CompiledHypotheses:
    """Hypotheses about one mass model; needs `COMPILED`. See `poise.inertia.bayes.averaging`, which does the same.

    Args:
        moments: (K, 16) pseudo-inertia of each part at 1 kg. shares: (K,) of the volume.
        guess: (n,) middle of the prior, n = K + 9. halvings: of large deformations.
        root: (K, K) of the correlation of the densities of parts; None: the unit matrix.
        unrooted: (K, K) the transposed inverse of the root.
        flat, products: (9, 16) generators of deformations, and (9, 9 * 16) products of two of them.
        scale: kg, unit of phi. any_mass: variance of the logarithm of the mass.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, here and in all methods.
    """

    def __init__(self, *, halvings: int, scale: float, any_mass: float, **arrays: Array | None) -> None:
        shares = contiguous(np.asarray(arrays["shares"]), -1, what="shares of parts")
        parts = len(shares)
        self._n = parts + 9
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("root", "unrooted"), (parts, parts))
        shapes |= {"moments": (parts, 16), "shares": (parts,), "guess": (self._n,)}
        shapes |= {"flat": (9, 16), "products": (9, 144)}
        self._kept = {
            name: None if (array := arrays[name]) is None else contiguous(array, *shapes[name], what=name)
            for name in _ARRAYS
        }
        pointers = {name: address(array) for name, array in self._kept.items()}
        self._model = _Model(parts=parts, states=self._n, halvings=halvings, scale=scale, any_mass=any_mass, **pointers)
        self._pointer = ctypes.addressof(self._model)

    def evaluate(self, states: Array) -> tuple[Array, Array]:
        """(H, 10) phi and (H, 10, n) its derivative at states (H, n), in units of the scale."""
        given = contiguous(states, -1, self._n, what="states")
        phi, jacobian = np.empty((len(given), _PHI)), np.empty((len(given), _PHI, self._n))
        library.poise_mass_at(self._pointer, len(given), *map(address, (given, phi, jacobian)))
        return phi, jacobian

    def climb(
        self,
        states: Array,
        variances: Array,
        cases: NDArray[np.int64],
        information: Array,
        vector: Array,
        tolerance: float,
        most: int,
    ) -> tuple[Array, Array, Array, Array]:
        """Gauss-Newton from states (H, n) under prior variances (H, n).

        Args:
            states, variances: of the hypotheses. cases: (H,) which of the B normal equations each one has.
            information, vector: (B, 10, 10) and (B, 10).
            tolerance: gain of log posterior of the last step. most: steps.

        Returns:
            (H, n) the most probable states, (H, 10) phi, (H,) minus the log of the prior, (H,) log |1 + C H| with the
            prior covariance C of phi.

        Raises:
            numpy.linalg.LinAlgError: a system is singular.
        """
        moved = np.array(states, dtype=np.float64, order="C")
        given = self._given(moved, variances, cases, information)
        pulls = contiguous(vector, len(given[3]), _PHI, what="vectors")
        count = len(moved)
        phi, penalty, determinant = np.empty((count, _PHI)), np.empty(count), np.empty(count)
        arrays = map(address, (*given, pulls))
        found = map(address, (phi, penalty, determinant))
        check(library.poise_climb(self._pointer, count, *arrays, tolerance, most, *found))
        return moved, phi, penalty, determinant

    def narrowed(self, states: Array, variances: Array, cases: NDArray[np.int64], information: Array) -> Array:
        """(H, 10, 10) posterior covariance of phi, to first order; LinAlgError when rounding makes it negative."""
        return self._covariance(library.poise_narrowed, states, variances, cases, information)

    def curved(self, states: Array, variances: Array, cases: NDArray[np.int64], information: Array) -> Array:
        """(H, 10, 10) posterior covariance of phi, by cubature."""
        return self._covariance(library.poise_curved, states, variances, cases, information)

    def _covariance(self, function: Any, *of: Any) -> Array:
        given = self._given(*of)
        covariance = np.empty((len(given[0]), _PHI, _PHI))
        check(function(self._pointer, len(covariance), *map(address, given), address(covariance)))
        return covariance

    def _given(self, states: Array, variances: Array, cases: NDArray[np.int64], information: Array) -> tuple[Any, ...]:
        at = contiguous(states, -1, self._n, what="states")
        spread = contiguous(variances, len(at), self._n, what="variances of states")
        squares = contiguous(information, -1, _PHI, _PHI, what="information")
        return at, spread, checked_cases(cases, len(at), len(squares)), squares


def checked_cases(cases: NDArray[np.int64], count: int, most: int) -> NDArray[np.int64]:
    """(H,) rows that there are; the library does not check.

    Raises:
        IndexError: another number of them, or one that there is not.
    """
    which = np.ascontiguousarray(cases, dtype=np.int64)
    if which.shape != (count,) or (count and not (which.min() >= 0 and which.max() < most)):
        raise IndexError(f"cases {which}: {count} hypotheses have one of {most} cases each")
    return which


def evidence(information: Array, vector: Array, priors: Array, means: Array) -> tuple[Array, Array]:
    """Log evidence (B, L) and most probable steps (B, L, 16) from means (B, 16) with prior covariances (B, 16, 16).

    Args:
        information, vector: normal equations (L, 16, 16) and (L, 16).
        priors, means: of the unknowns.

    Raises:
        numpy.linalg.LinAlgError: a system is singular.
    """
    squares = contiguous(information, -1, _UNKNOWNS, _UNKNOWNS, what="information")
    pulls = contiguous(vector, len(squares), _UNKNOWNS, what="vectors")
    spread = contiguous(priors, -1, _UNKNOWNS, _UNKNOWNS, what="prior covariances")
    middle = contiguous(means, len(spread), _UNKNOWNS, what="prior means")
    log, steps = np.empty((len(spread), len(squares))), np.empty((len(spread), len(squares), _UNKNOWNS))
    arrays = map(address, (squares, pulls, spread, middle, log, steps))
    check(library.poise_evidence(*log.shape, *arrays))
    return log, steps


def bias_taken_out(information: Array, vector: Array, variances: Array) -> tuple[Array, ...]:
    """Normal equations (B, 16, 16) and (B, 16) without the bias, whose prior has variances (B, 6).

    Returns:
        What `poise.inertia.bayes.WithoutBias` holds: information (B, 10, 10), vector (B, 10), covariance (B, 6, 6),
        mean (B, 6), slope (B, 6, 10) and log determinants (B,).

    Raises:
        numpy.linalg.LinAlgError: a system is singular.
    """
    squares = contiguous(information, -1, _UNKNOWNS, _UNKNOWNS, what="information")
    count = len(squares)
    pulls = contiguous(vector, count, _UNKNOWNS, what="vectors")
    spread = contiguous(variances, count, 6, what="variances of the bias")
    shapes = ((_PHI, _PHI), (_PHI,), (6, 6), (6,), (6, _PHI), ())
    found = tuple(np.empty((count, *shape)) for shape in shapes)
    check(library.poise_without_bias(count, *map(address, (squares, pulls, spread, *found))))
    return found


def sums_likelihood(
    moments: Array, cases: NDArray[np.int64], unknowns: Array, entries: Array, variances: Array, motion: Array
) -> Array:
    """(H,) log likelihood of unknowns (H, 16) by sums over samples (B, 19, 19); see `poise.inertia.model.signals`.

    Args:
        moments: sums. cases: (H,) which of them.
        unknowns: phi and bias. entries: (6, 16, 13) the design by signals.
        variances: (6,) of the sensor. motion: (2,) standard deviations of the accelerations, m/s2 and rad/s2.

    Raises:
        numpy.linalg.LinAlgError: a covariance is singular.
    """
    sums = contiguous(moments, -1, 19, 19, what="sums over samples")
    answers = contiguous(unknowns, -1, _UNKNOWNS, what="unknowns")
    which = checked_cases(cases, len(answers), len(sums))
    design = contiguous(entries, 6, _UNKNOWNS, 13, what="the design by signals")
    noise = contiguous(variances, 6, what="variances of the sensor"), contiguous(motion, 2, what="noise of the motion")
    log = np.empty(len(answers))
    check(library.poise_log_likelihood(len(log), *map(address, (sums, which, answers, design, *noise, log))))
    return log


def weighed_sums(
    moments: Array, counts: Array, covariance: Array, variance: float, entries: Array
) -> tuple[Array, Array]:
    """Normal equations (L, 16, 16) and (L, 16) of sums over samples; see `poise.inertia.model.normal_equations`.

    Args:
        moments, counts: (L, 19, 19) and (L,).
        covariance: (6, 6) of a residual.
        variance: (rad/s2)^2, noise of the angular accelerations.
        entries: (6, 16, 13) the design by signals.

    Raises:
        numpy.linalg.LinAlgError: the covariance is not positive definite.
    """
    sums = contiguous(moments, -1, 19, 19, what="sums over samples")
    numbers = contiguous(counts, len(sums), what="counts of samples")
    spread = contiguous(covariance, 6, 6, what="covariance of a residual")
    design = contiguous(entries, 6, _UNKNOWNS, 13, what="the design by signals")
    information, vector = np.empty((len(sums), _UNKNOWNS, _UNKNOWNS)), np.empty((len(sums), _UNKNOWNS))
    given = map(address, (sums, numbers, spread))
    found = map(address, (design, information, vector))
    check(library.poise_normal_equations(len(sums), *given, variance, *found))
    return information, vector
