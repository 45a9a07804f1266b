"""What the acquisition asks of a device, on any wire."""

from typing import Protocol

from poise.force_torque.wire.samples import SensorSamples


class Link(Protocol):
    """A device behind a wire.

    Every call is bounded in time. OSError says that the wire is gone (the acquisition closes and starts again),
    SensorError that the device answers wrongly or not at all.
    """

    @property
    def name(self) -> str:
        """Device and address, as far as they are known."""

    @property
    def rate(self) -> float | None:
        """Nominal samples per second, known after start(); None: samples carry the time of their arrival."""

    def start(self) -> None:
        """Open the wire where it is not open, and ask for samples; calling it again asks again."""

    def read(self, timeout: float) -> SensorSamples:
        """Wait at most `timeout` s for samples; take all that are there. Needs start()."""

    def bias(self) -> None:
        """Zero the device; the stream goes on with numbers that may start again.

        Raises:
            SensorError: UNSUPPORTED, for a device that has no bias command.
        """

    def describe(self, status: int) -> str:
        """The text of a status word."""

    def close(self) -> None:
        """Stop the stream and release the wire; never raises, and start() may follow."""
