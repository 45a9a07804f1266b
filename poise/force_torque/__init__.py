"""From the bytes of a force-torque sensor to calibrated and stamped samples, with counts of losses.

- `wire`: samples, and the building blocks of links and fakes. `sensors`: the registry of devices.
- `acquisition`: the thread that reads a device.
- `sequence`: new, late, duplicate and lost samples. `clock`: stamps without jitter.
- `decimation`, `batch`: block averages; all samples in one message.
- `bias`: the mean reading, and a test that the load was at rest.
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
