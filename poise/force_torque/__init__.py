"""From a force-torque sensor's bytes to calibrated, stamped, accounted-for samples.

What a device says (no I/O):
- `rdt`, `rdt_settings`: ATI's UDP protocol, status words, web page.
- `robotiq`: Robotiq's serial stream and Modbus registers.
- `units`, `samples`: counts and units -> N and N m in the contract's sign.

What is done with it (no I/O):
- `sequence`: new, late, doubled and lost samples.
- `clock`: stamps without jitter.
- `decimation`, `batch`: block averages; many samples to a message.
- `bias`: the zero, and whether the load was at rest.
- `health`: the conditions of the fault contract.
- `connection`: when to try again.

Wires:
- `link`: what a wire has to offer; `rdt_link`, `robotiq_link`: the two there are (the latter needs pyserial and
  pymodbus, so it is not imported here).
- `acquisition`: the thread that ties all of this together.
"""

from poise.force_torque.acquisition import Acquisition, AcquisitionOptions, Sink
from poise.force_torque.batch import Batch
from poise.force_torque.bias import Bias, estimate_bias
from poise.force_torque.decimation import Blocks
from poise.force_torque.health import Condition, Report, Severity
from poise.force_torque.link import Link
from poise.force_torque.rdt_link import RdtLink, RdtOptions
from poise.force_torque.samples import Calibration, Reports, Samples

__all__ = [
    "Acquisition",
    "AcquisitionOptions",
    "Batch",
    "Bias",
    "Blocks",
    "Calibration",
    "Condition",
    "Link",
    "RdtLink",
    "RdtOptions",
    "Report",
    "Reports",
    "Samples",
    "Severity",
    "Sink",
    "estimate_bias",
]
