"""Whether a payload explains its samples.

- `samples`: `SampleBins`, averages over bins of time.
- `clipping`: `ExtremeReadings`, readings that stop at one value.
- `slow_residual`: averages over a tenth of a second, and further parameters fitted to them.
- `fit_check`: `judge`, the tests of a fit.
"""

from poise.inertia.verdict.clipping import ExtremeReadings
from poise.inertia.verdict.fit_check import FitTest, FitVerdict, judge
from poise.inertia.verdict.samples import FitSamples, SampleBins
from poise.inertia.verdict.slow_residual import Fit

__all__ = ["ExtremeReadings", "Fit", "FitSamples", "FitTest", "FitVerdict", "SampleBins", "judge"]
