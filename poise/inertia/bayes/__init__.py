"""The `poise` estimator: Bayesian model averaging over shape, density and bias, from sums over samples.

- `estimator`: `PoiseEstimator`; `change`: `ContinuousEstimator`, which notices a change of the payload.
- `recorder`, `blocks`: samples in, sums in blocks of time. `delay`: wrench stamps against kinematics stamps.
- `mass_model`, `hypotheses`, `first_guess`: the priors. `averaging`, `search`, `sensor_bias`: the posterior.
- `outliers`, `findings`: what does not fit.
"""

from poise.inertia.bayes.change import ContinuousEstimator, PayloadChange
from poise.inertia.bayes.delay import LAG_STEP, PRIOR_SPREAD
from poise.inertia.bayes.estimator import LONGEST_DELAY, SHAPE_ACCURACY, PoiseEstimator, poise
from poise.inertia.bayes.findings import SURELY
from poise.inertia.bayes.recorder import NOT_FINITE, OUT_OF_ORDER, SATURATED

__all__ = [
    "LAG_STEP",
    "LONGEST_DELAY",
    "NOT_FINITE",
    "OUT_OF_ORDER",
    "PRIOR_SPREAD",
    "SATURATED",
    "SHAPE_ACCURACY",
    "SURELY",
    "ContinuousEstimator",
    "PayloadChange",
    "PoiseEstimator",
    "poise",
]
