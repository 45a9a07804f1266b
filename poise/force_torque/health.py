"""State of a sensor stream: its worst condition, and the counts behind it.

The fault contract in docs/ft_driver.md is the table of these conditions.
"""

from dataclasses import dataclass
from enum import IntEnum

from poise.errors import ErrorCode, PoiseError
from poise.force_torque.wire import SensorSamples

HOLD = 1.0
"""s that a transient fault stays visible after it was last seen."""
FIRST_SAMPLE_GRACE = 1.0
"""s after activation before a missing first sample is an error."""


class Severity(IntEnum):
    """The levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Condition:
    """The state of the stream: one word and one sentence.

    Attributes:
        kind: stable name: failed, connecting, unreachable, silent, stalled, saturated, faulty, losing, restarted,
            rejecting, flagged, streaming.
        severity: of diagnostics.
        code: what the fault is, OK for none.
        text: the sentence for people.
    """

    kind: str
    severity: Severity
    code: ErrorCode
    text: str


@dataclass(frozen=True)
class StreamReport:
    """The state for diagnostics; counts are since activation.

    Attributes:
        condition: the worst that holds.
        device: name of the link.
        received, lost, out_of_order, duplicates, restarts: see sequence.SequenceCounter.
        rejected: messages that were not valid.
        withheld: averages not published because a sample in them was saturated or faulty.
        connects: how often the device was asked to start.
        rate: samples per second, measured; 0 before there is one.
        age: s since the last sample, None before the first.
        status: last status word.
        status_text: what it says.
        bias: (6,) N and N m, subtracted from what the device reports.
    """

    condition: Condition
    device: str
    received: int
    lost: int
    out_of_order: int
    duplicates: int
    restarts: int
    rejected: int
    withheld: int
    connects: int
    rate: float
    age: float | None
    status: int
    status_text: str
    bias: tuple[float, ...]


class Health:
    """Tracks events and names the condition. All times are of time.monotonic(), in s.

    Silence is judged when a read ends: after a delay of the thread, samples are still waiting to be read.

    Args:
        silence: s without a sample after which a sensor counts as silent.
        now: time of activation.
    """

    def __init__(self, silence: float, now: float) -> None:
        self.silence = silence
        self.status = 0
        self.rejected = 0
        self._began = now
        self._checked = now
        self._last_sample: float | None = None
        self._measured: int | None = None
        self._measured_at = now
        self._error: PoiseError | None = None
        self._seen: dict[str, tuple[float, str]] = {}

    def age(self, now: float) -> float | None:
        """Seconds since the last sample."""
        return None if self._last_sample is None else now - self._last_sample

    @property
    def is_connected(self) -> bool:
        """Whether samples are coming in."""
        return self._last_sample is not None and self._checked - self._last_sample <= self.silence

    @property
    def is_stalled(self) -> bool:
        """Whether records come but the device measures nothing new."""
        return self._measured is not None and self._checked - self._measured_at > self.silence

    def check(self, now: float) -> None:
        """A read has ended, or was not possible."""
        self._checked = now

    def failed(self, error: PoiseError) -> None:
        """An attempt to reach the device, or to read it, failed."""
        self._error = error

    def note(self, kind: str, text: str, now: float) -> None:
        """A transient fault was seen; it stays visible for HOLD."""
        self._seen[kind] = (now, text)

    def take(self, samples: SensorSamples, now: float) -> None:
        """Note a read."""
        self.check(now)
        if samples.rejected:
            self.rejected += samples.rejected
            self.note("rejecting", f"{self.rejected} messages were not valid: check cable, baud rate and address", now)
        if not len(samples):
            return
        if samples.measured is None or samples.measured != self._measured:
            self._measured, self._measured_at = samples.measured, now
        self._last_sample = now
        self._error = None
        self.status = int(samples.status[-1])
        if samples.faulty.any():
            self.note("faulty", "", now)
        if samples.saturated.any():
            self.note("saturated", "the load is beyond the sensor's range: reduce it", now)

    def condition(self, now: float, status_text: str) -> Condition:
        """The worst condition that holds."""
        return (
            self._failed(now)
            or self._no_stream(now)
            or self._bad_samples(now, status_text)
            or self._degraded(now)
            or self._flagged(status_text)
            or Condition("streaming", Severity.OK, ErrorCode.OK, "streaming")
        )

    def _failed(self, now: float) -> Condition | None:
        text = self._recent("failed", now)
        return None if text is None else Condition("failed", Severity.ERROR, ErrorCode.INTERNAL, text)

    def _no_stream(self, now: float) -> Condition | None:
        if self.is_connected:
            if not self.is_stalled:
                return None
            text = "the device repeats one measurement: switch it off and on"
            return Condition("stalled", Severity.ERROR, ErrorCode.SENSOR_STALE, text)
        why = f" ({self._error.message})" if self._error else ""
        if self._last_sample is not None:
            text = f"no sample for {now - self._last_sample:.2f} s; trying again{why}"
            return Condition("silent", Severity.ERROR, ErrorCode.SENSOR_STALE, text)
        if self._error is None and now - self._began <= FIRST_SAMPLE_GRACE:
            return Condition("connecting", Severity.WARN, ErrorCode.OK, "waiting for the first sample")
        code = self._error.code if self._error else ErrorCode.SENSOR_UNREACHABLE
        text = self._error.message if self._error else "no sample since activation: check address, port, cable, power"
        return Condition("unreachable", Severity.ERROR, code, text)

    def _bad_samples(self, now: float, status_text: str) -> Condition | None:
        if (text := self._recent("saturated", now)) is not None:
            return Condition("saturated", Severity.ERROR, ErrorCode.SENSOR_SATURATED, text)
        if self._recent("faulty", now) is not None:
            text = f"status {self.status:#010x}: {status_text}"
            return Condition("faulty", Severity.ERROR, ErrorCode.SENSOR_FAULT, text)
        return None

    def _degraded(self, now: float) -> Condition | None:
        for kind in ("losing", "restarted", "rejecting"):
            if (text := self._recent(kind, now)) is not None:
                return Condition(kind, Severity.WARN, ErrorCode.SENSOR_PROTOCOL, text)
        return None

    def _flagged(self, status_text: str) -> Condition | None:
        if not self.status:
            return None
        text = f"status {self.status:#010x}: {status_text}"
        return Condition("flagged", Severity.WARN, ErrorCode.OK, text)

    def _recent(self, kind: str, now: float) -> str | None:
        seen, text = self._seen.get(kind, (-HOLD, ""))
        return text if kind in self._seen and now - seen <= HOLD else None
