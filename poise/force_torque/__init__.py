"""From a force-torque sensor's bytes to calibrated, stamped, accounted-for samples.

- `wire`: what a device delivers, and what links and fakes are built from. `sensors`: the registry of devices.
- `acquisition`: the thread that reads a device; `connection`: when it tries again.
- `sequence`: new, late, duplicate and lost samples. `clock`: stamps without jitter.
- `decimation`, `batch`: block averages; many samples in a message.
- `bias`: the zero, and whether the load was at rest.
- `health`: the conditions of the fault contract in docs/ft_driver.md.
"""

from poise.force_torque.acquisition import Acquisition, AcquisitionOptions, Sink
from poise.force_torque.batch import SampleBatch
from poise.force_torque.bias import Bias, estimate_bias
from poise.force_torque.decimation import BlockAverages
from poise.force_torque.health import Condition, Severity, StreamReport

__all__ = [
    "Acquisition",
    "AcquisitionOptions",
    "Bias",
    "BlockAverages",
    "Condition",
    "SampleBatch",
    "Severity",
    "Sink",
    "StreamReport",
    "estimate_bias",
]
