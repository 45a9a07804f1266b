"""The `poise` estimator: Bayesian model averaging over shape, density and bias, from sums over samples.

- `estimator`: `PoiseEstimator`; `change`: `ContinuousEstimator`, which detects changes of the payload; `expectation`:
  answers that newer samples are compared with.
- `recorder`, `blocks`: sums of samples in blocks of time.
- `clock_comparison`, `delay`: the delay of wrench stamps relative to kinematics stamps.
- `mass_model`, `hypotheses`, `first_guess`: the priors. `averaging`, `search`, `sensor_bias`: the posterior.
- `outliers`, `findings`: samples that are rejected, and findings.
"""

from poise.inertia.bayes.change import ContinuousEstimator, PayloadChange, PayloadDoubt
from poise.inertia.bayes.clock_comparison import ClockComparison
from poise.inertia.bayes.delay import LAG_STEP, PRIOR_SPREAD, Delay
from poise.inertia.bayes.estimator import EXTERNAL_CONTACT, LONGEST_DELAY, SHAPE_ACCURACY, PoiseEstimator, poise
from poise.inertia.bayes.lasting import LOAD_ACCURACY
from poise.inertia.bayes.recorder import sample_rows

__all__ = [
    "EXTERNAL_CONTACT",
    "LAG_STEP",
    "LOAD_ACCURACY",
    "LONGEST_DELAY",
    "PRIOR_SPREAD",
    "SHAPE_ACCURACY",
    "ClockComparison",
    "ContinuousEstimator",
    "Delay",
    "PayloadChange",
    "PayloadDoubt",
    "PoiseEstimator",
    "poise",
    "sample_rows",
]
