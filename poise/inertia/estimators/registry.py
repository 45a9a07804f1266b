"""All estimators by name, in one calling form, so that they can be chosen and compared."""

import importlib
import importlib.util

from poise.errors import ErrorCode, InputError
from poise.inertia.estimators.answer import Method
from poise.inertia.estimators.geo import geo
from poise.inertia.estimators.hps import hps
from poise.inertia.estimators.ols import ols
from poise.inertia.estimators.pmd import pmd
from poise.inertia.estimators.rtls import rtls

THESIS_METHODS: dict[str, Method] = {"ols": ols, "rtls": rtls, "geo": geo, "pmd": pmd, "hps": hps}
"""What thesis chapter 3 proposes (pmd, hps) and compares with."""

OWN_METHOD = "poise"
OWN_MODULE = "poise.inertia.bayes.estimator"


def method_names() -> tuple[str, ...]:
    """The names that `method` knows, the default last."""
    own = (OWN_METHOD,) if importlib.util.find_spec(OWN_MODULE) else ()
    return (*THESIS_METHODS, *own)


def method(name: str) -> Method:
    """The estimator of that name.

    Raises:
        InputError: BAD_INPUT for a name that is not known.
    """
    if name in THESIS_METHODS:
        return THESIS_METHODS[name]
    if name in method_names():
        own: Method = getattr(importlib.import_module(OWN_MODULE), OWN_METHOD)
        return own
    raise InputError(ErrorCode.BAD_INPUT, f"method {name!r} is not known; take one of {', '.join(method_names())}")
