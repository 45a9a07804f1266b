"""What the acquisition asks of a device, whatever wire it hangs on."""

from typing import Protocol

from poise.force_torque.samples import Samples


class Link(Protocol):
    """A device behind a wire.

    Every call is bounded in time. OSError says that the wire is gone (the acquisition closes and starts again),
    SensorError that the device answers wrongly or not at all.
    """

    @property
    def name(self) -> str:
        """Which device at which address, as far as it is known by now."""

    @property
    def rate(self) -> float | None:
        """Nominal samples per second, known after start(); None: samples carry the time of their arrival."""

    @property
    def has_hardware_bias(self) -> bool:
        """Whether the device itself can be zeroed."""

    def start(self) -> None:
        """Open the wire where it is not open, and ask for samples; calling it again asks again."""

    def read(self, timeout: float) -> Samples:
        """Wait at most `timeout` s for samples; take all that are there. Needs start()."""

    def bias(self) -> None:
        """Zero the device; the stream goes on with numbers that may begin anew."""

    def describe(self, status: int) -> str:
        """Say in words what a status word reports."""

    def close(self) -> None:
        """Ask for silence and let go of the wire; never raises, and start() may follow."""
