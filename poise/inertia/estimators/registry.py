"""All estimators by name, found by looking through this folder for files with an `ENTRY`."""

import importlib
import pkgutil
from functools import cache
from pathlib import Path

from poise.errors import ErrorCode, InputError
from poise.inertia.estimators.answer import Method
from poise.inertia.estimators.entry import EstimatorEntry

DEFAULT_METHOD = "poise"
AUTO = "auto"
"""Chooses between `STATIC` and `OLS`."""
STATIC, OLS = "static", "ols"


@cache
def all_estimators() -> dict[str, EstimatorEntry]:
    """Every estimator by name, the default first, then by name."""
    package = __name__.rpartition(".")[0]
    modules = (f"{package}.{found.name}" for found in pkgutil.iter_modules([str(Path(__file__).parent)]))
    found = (getattr(importlib.import_module(name), "ENTRY", None) for name in modules if name != __name__)
    entries = sorted((entry for entry in found if entry is not None), key=lambda entry: entry.name)
    return {entry.name: entry for entry in sorted(entries, key=lambda entry: entry.name != DEFAULT_METHOD)}


def method_choices() -> tuple[str, ...]:
    """The names that a user may choose from, the default first."""
    first, *others = all_estimators()
    return (first, AUTO, *others)


def method_names() -> tuple[str, ...]:
    """The names of estimators that have a batch form."""
    return tuple(name for name, entry in all_estimators().items() if entry.estimate is not None)


def estimator_named(name: str) -> EstimatorEntry:
    """The estimator of a name.

    Raises:
        InputError: BAD_INPUT for a name that is not known.
    """
    check_method(name)
    return all_estimators()[STATIC if name == AUTO else name]


def method(name: str) -> Method:
    """The batch form of an estimator, for all samples of a problem at once.

    Raises:
        InputError: BAD_INPUT for a name that is not known.
    """
    entry = all_estimators().get(name)
    if entry is None or entry.estimate is None:
        raise InputError(ErrorCode.BAD_INPUT, f"method {name!r} is not known; take one of {', '.join(method_names())}")
    return entry.estimate


def check_method(name: str) -> None:
    """Refuse a name that is no method.

    Raises:
        InputError: BAD_INPUT.
    """
    if name not in method_choices():
        choices = ", ".join(method_choices())
        raise InputError(ErrorCode.BAD_INPUT, f"there is no method '{name}'; choose one of {choices}")
