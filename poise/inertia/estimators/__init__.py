"""The registry of estimators: one file for each, with a declaration of its inputs and outputs.

See docs/add_an_estimator.md.

- `entry`: `EstimatorEntry`, the declaration. `registry`: all estimators by name.
- `streaming`: `StreamingEstimator`, the interface of an estimator, and its prior.
- `sample_window`, `least_squares_stream`: streaming forms that several estimators share.
- `poise`, `static`, `ols`, `rtls`, `geo` (with `divergence`), `pmd`, `hps`: the estimators.
- `information`, `least_squares`: sums that do not grow with time, and their weighted solution.
- `accelerometer`: offset and scale of an accelerometer that gives the motion.
- `noise`: the noise of the samples. `change_watch`: changes of the payload.
"""

from poise.inertia.estimators.accelerometer import Accelerometer, AccelerometerComparison, AccelerometerErrors
from poise.inertia.estimators.answer import answer
from poise.inertia.estimators.change_watch import WATCH, WATCH_NOISE, ChangeWatch
from poise.inertia.estimators.entry import EstimatorEntry, MotionNeed
from poise.inertia.estimators.information import InformationAccumulator
from poise.inertia.estimators.least_squares import NULL_EIGENVALUE, solve
from poise.inertia.estimators.noise import LEAST_NOISE, NoiseMeter
from poise.inertia.estimators.registry import (
    AUTO,
    DEFAULT_METHOD,
    OLS,
    STATIC,
    all_estimators,
    check_method,
    estimator_named,
    method_choices,
)
from poise.inertia.estimators.sample_window import SampleWindow
from poise.inertia.estimators.streaming import Prior, SampleEvidence, StreamingEstimator, joined, model_matrix

__all__ = [
    "AUTO",
    "DEFAULT_METHOD",
    "LEAST_NOISE",
    "NULL_EIGENVALUE",
    "OLS",
    "STATIC",
    "WATCH",
    "WATCH_NOISE",
    "Accelerometer",
    "AccelerometerComparison",
    "AccelerometerErrors",
    "ChangeWatch",
    "EstimatorEntry",
    "InformationAccumulator",
    "MotionNeed",
    "NoiseMeter",
    "Prior",
    "SampleEvidence",
    "SampleWindow",
    "StreamingEstimator",
    "all_estimators",
    "answer",
    "check_method",
    "estimator_named",
    "joined",
    "method_choices",
    "model_matrix",
    "solve",
]
