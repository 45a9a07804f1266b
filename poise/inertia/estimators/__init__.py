"""The registry of estimators: one file for each, which declares what it needs and what it gives.

- `registry`: all estimators by name. `streaming`: how samples are handed to an estimator.
- `information`, `least_squares`: sums that do not grow with time, and their weighted solution.
- `ols`, `rtls`, `geo` (with `divergence`), `pmd`, `hps`: the methods of thesis chapter 3.
"""

from poise.inertia.estimators.information import InformationAccumulator
from poise.inertia.estimators.least_squares import solve
from poise.inertia.estimators.registry import OWN_METHOD, method, method_names
from poise.inertia.estimators.streaming import (
    AUTO,
    LEAST_SQUARES,
    METHODS,
    OLS,
    STATIC,
    WATCH,
    Continuous,
    Prior,
    StreamingEstimator,
    check_method,
    joined,
    model_matrix,
    weigher,
)

__all__ = [
    "AUTO",
    "LEAST_SQUARES",
    "METHODS",
    "OLS",
    "OWN_METHOD",
    "STATIC",
    "WATCH",
    "Continuous",
    "InformationAccumulator",
    "Prior",
    "StreamingEstimator",
    "check_method",
    "joined",
    "method",
    "method_names",
    "model_matrix",
    "solve",
    "weigher",
]
