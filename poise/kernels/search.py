"""The rounds of one estimate: hypotheses about a payload, their delays, the noise, and the blocks that they explain."""

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.types import Array, Indices, Mask

_INT, _DOUBLE, _POINTER = ctypes.c_int64, ctypes.c_double, ctypes.c_void_p
_MODEL = ("moments", "shares", "guess", "root", "unrooted", "flat", "products")
_COUNTS = ("blocks", "lags", "hypotheses", "cases", "fine")
_NUMBERS = ("first_lag", "lag_step", "about", "prior_spread", "linear", "angular")
_GIVEN: dict[str, tuple[str | int, ...]] = {
    "moments": ("blocks", "lags", 19, 19),
    "counts": ("blocks", "lags"),
    "sizes": ("blocks",),
    "start": ("blocks",),
    "end": ("blocks",),
    "free": ("blocks",),
    "smooth": ("fine", "lags"),
    "beyond": ("fine",),
    "variances": (6,),
    "entries": (6, 16, 13),
    "to_sensor": (10, 10),
    "starts": ("cases", "states"),
    "first_phi": (10,),
    "state_variances": ("hypotheses", "states"),
    "bias_variances": ("cases", 6),
    "log_probability": ("hypotheses",),
    "bias_case": ("hypotheses",),
    "twins": ("hypotheses",),
    "scouts": ("cases",),
}
_FOUND: dict[str, tuple[str | int, ...]] = {
    "states": ("hypotheses", "states"),
    "left": ("hypotheses",),
    "log_weights": ("hypotheses",),
    "unknowns": (16,),
    "covariance": (16, 16),
    "keep": ("blocks",),
    "sample": (2,),
    "slow": (2,),
    "delays": ("cases", 3),
    "drifts": ("cases", 16),
    "shares": ("cases",),
    "at_delay": ("lags",),
    "total": ("lags", 19, 19),
    "residual": (6, 6),
    "information": (16, 16),
    "vector": (16,),
    "surprise": ("blocks",),
    "variance_ratio": ("blocks", 2),
    "mean_ratio": ("blocks", 2),
    "squares": ("blocks", 2),
    "means": ("blocks", 6),
}
_TYPES: dict[str, Any] = dict.fromkeys(("sizes", "start", "end", "bias_case", "twins", "scouts", "left"), np.int64)
_TYPES |= {"free": np.uint8, "keep": np.uint8}
_CHOICES = {"bias_case": "cases", "twins": "hypotheses", "scouts": "hypotheses"}


class _Model(ctypes.Structure):
    """Layout of `struct mass_model` in kernels/mass.h."""

    _fields_ = [
        *((name, _INT) for name in ("parts", "states", "halvings")),
        *((name, _DOUBLE) for name in ("scale", "any_mass")),
        *((name, _POINTER) for name in _MODEL),
    ]


class _Search(ctypes.Structure):
    """Layout of `struct search` in kernels/search.h."""

    _fields_ = [
        *((name, _INT) for name in _COUNTS),
        *((name, _DOUBLE) for name in _NUMBERS),
        ("model", _POINTER),
        *((name, _POINTER) for name in _GIVEN),
        ("remaining", _INT),
        *((f"found_{name}", _POINTER) for name in _FOUND),
    ]


@dataclass(frozen=True, eq=False)
class SearchAnswer:
    """What `PosteriorSearch.run` arrives at, for B blocks, L lags, C cases of the bias and H hypotheses that are left.

    Args:
        states: (H, n). left: (H,) which hypotheses these are. log_weights: (H,).
        unknowns, covariance: (16,) and (16, 16), of phi and bias in the sensor frame.
        keep: (B,). sample, slow: (2,) factors on the variances of force and torque.
        delays: (C, 3) mean, standard deviation and log integral. drifts: (C, 16). shares: (C,).
        at_delay: (L,) weights of the lags. total: (L, 19, 19) sums over the blocks that are kept.
        residual: (6, 6) covariance of a sample. information, vector: (16, 16) and (16,) normal equations.
        surprise, variance_ratio, mean_ratio, squares, means: of blocks, see `poise.inertia.bayes.outliers.Residuals`.
    """

    states: Array
    left: Indices
    log_weights: Array
    unknowns: Array
    covariance: Array
    keep: Mask
    sample: Array
    slow: Array
    delays: Array
    drifts: Array
    shares: Array
    at_delay: Array
    total: Array
    residual: Array
    information: Array
    vector: Array
    surprise: Array
    variance_ratio: Array
    mean_ratio: Array
    squares: Array
    means: Array


class CompiledSearch:
    """Rounds of estimates with one mass model; needs `COMPILED`. See `poise.inertia.bayes.search`, which does the same.

    Args:
        moments: (K, 16) pseudo-inertia of each part at 1 kg. shares: (K,) of the volume.
        guess: (n,) middle of the prior, n = K + 9. halvings: of large deformations.
        root: (K, K) axes of the correlation of the densities of parts, in columns; None: the unit matrix.
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
            for name in _MODEL
        }
        pointers = {name: address(array) for name, array in self._kept.items()}
        self._model = _Model(parts=parts, states=self._n, halvings=halvings, scale=scale, any_mass=any_mass, **pointers)

    def run(self, states: Array, arrays: dict[str, NDArray[Any]], numbers: dict[str, float]) -> SearchAnswer:
        """Go round until nothing moves any more.

        Args:
            states: (H, n) to begin with.
            arrays: what `struct search` in kernels/search.h is given. numbers: the same, first_lag to angular.

        Raises:
            IndexError: a case that there is not.
            numpy.linalg.LinAlgError: a system is singular, or the samples are not finite.
        """
        sizes: dict[str | int, int] = {"states": self._n, "blocks": len(arrays["sizes"])}
        sizes |= {"lags": arrays["counts"].shape[-1], "fine": len(arrays["beyond"])}
        sizes |= {"hypotheses": len(arrays["bias_case"]), "cases": len(arrays["scouts"])}
        given = {name: _laid_out(name, arrays[name], _shape(dims, sizes)) for name, dims in _GIVEN.items()}
        for name, among in _CHOICES.items():
            _check_choice(name, given[name], sizes[among])
        found = {name: np.empty(_shape(dims, sizes), _TYPES.get(name, np.float64)) for name, dims in _FOUND.items()}
        found["states"][:] = contiguous(states, *found["states"].shape, what="states")
        counts = {name: sizes[name] for name in _COUNTS}
        pointers = {name: address(array) for name, array in given.items()}
        pointers |= {f"found_{name}": address(array) for name, array in found.items()}
        search = _Search(**counts, **numbers, model=ctypes.addressof(self._model), **pointers)
        check(library.poise_search(ctypes.byref(search)))
        left = found["left"] = found["left"][: search.remaining]
        found["states"], found["log_weights"] = found["states"][left], found["log_weights"][: len(left)]
        return SearchAnswer(**(found | {"keep": found["keep"].astype(bool)}))


def _shape(dims: tuple[str | int, ...], sizes: dict[str | int, int]) -> tuple[int, ...]:
    return tuple([dim if isinstance(dim, int) else sizes[dim] for dim in dims])


def _laid_out(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """As the library reads it."""
    kind = _TYPES.get(name)
    if kind is None:
        return contiguous(array, *shape, what=name)
    if array.shape != shape:
        contiguous(array, *shape, what=name)  # says what is wrong
    return np.ascontiguousarray(array, dtype=kind)


def _check_choice(name: str, which: NDArray[Any], most: int) -> None:
    """The library does not check that there are such cases."""
    if len(which) and not (which.min() >= 0 and which.max() < most):
        raise IndexError(f"{name}: {which} chooses among {most}")
