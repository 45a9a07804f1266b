"""Whether a payload explains its samples.

- `samples`: `SampleBins`, averages over bins of time.
- `fit_check`: `judge`, the tests of a fit.
"""

from poise.inertia.verdict.fit_check import Fit, FitTest, FitVerdict, judge
from poise.inertia.verdict.samples import FitSamples, SampleBins

__all__ = ["Fit", "FitSamples", "FitTest", "FitVerdict", "SampleBins", "judge"]
