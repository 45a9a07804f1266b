"""One thread that reads a device, delivers averages, batches and reports, and reconnects."""

import threading
import time
from collections.abc import Callable
from concurrent.futures import TimeoutError as FutureTimeoutError
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, PoiseError, SensorError
from poise.force_torque.batch import Batcher, SampleBatch
from poise.force_torque.bias import MAX_DRIFT, Bias, BiasJob
from poise.force_torque.clock import SampleClock
from poise.force_torque.decimation import BlockAverager, BlockAverages, Stamped, block_size
from poise.force_torque.health import Health, StreamReport
from poise.force_torque.sequence import SequenceCounter
from poise.force_torque.wire import Link, SensorSamples
from poise.serial_bus import Backoff
from poise.types import Array

_LONGEST_WAIT = 0.05
"""s that one read lasts at most; a stop takes effect after it."""
_RECONNECTS_WITHIN = 1.0
"""s; a stream whose device is back is back after it (docs/ft_driver.md)."""
_REPORT_PERIOD = 1.0
"""s between reports while nothing changes."""


class Sink(Protocol):
    """Receiver of the results; called from the acquisition's thread."""

    def blocks(self, blocks: BlockAverages) -> None:
        """Take one or more averages."""

    def batch(self, batch: SampleBatch) -> None:
        """SensorSamples to publish together."""

    def report(self, report: StreamReport) -> None:
        """Take the state, when the condition changes and once a second."""


@dataclass(frozen=True)
class AcquisitionOptions:
    """How to acquire.

    Attributes:
        publish_rate: averages per second, at the most.
        batch_rate: batches per second; 0: none.
        silence: s without a sample after which a sensor counts as silent.
        publish_saturated: hand on averages of saturated samples too.
        bias: (6,) N and N m to subtract from the start.
    """

    publish_rate: float
    batch_rate: float = 0.0
    silence: float = 0.05
    publish_saturated: bool = False
    bias: Array = field(default_factory=lambda: np.zeros(6))


class Acquisition:
    """Reads a link from start() to stop().

    Args:
        link: the device; used by this thread alone.
        options: rates and limits.
        sink: receives the results.
        rng: for the jitter of the back-off.
    """

    def __init__(self, link: Link, options: AcquisitionOptions, sink: Sink, rng: np.random.Generator) -> None:
        self._link = link
        self._options = options
        self._sink = sink
        self._backoff = Backoff(rng)
        self._lock = threading.Lock()  # what report() and zero() touch from other threads
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="acquisition", daemon=True)
        self._orders: SimpleQueue[Callable[[], None]] = SimpleQueue()

        self._health = Health(options.silence, time.monotonic())
        self._counter = SequenceCounter()
        self._clock: SampleClock | None = None
        self._averager = BlockAverager(1)
        self._batcher = Batcher(options.batch_rate)
        self._bias = np.array(options.bias, dtype=np.float64)
        self._job: BiasJob | None = None

        self._is_open = False
        self._next_start = 0.0
        self._connects = 0
        self._rate = 0.0
        self._rate_from = (0, time.monotonic())
        self._withheld = 0
        self._reported_kind = ""
        self._reported_at = -_REPORT_PERIOD

    def start(self) -> None:
        """Start the thread; returns at once, with or without a device."""
        self._thread.start()

    def stop(self, timeout: float = 3.0) -> bool:
        """Stop the stream and the thread; False when a system call still blocks the thread after `timeout` s."""
        self._stopping.set()
        self._thread.join(timeout)
        with self._lock:
            if self._job is not None:
                self._job.fail(SensorError(ErrorCode.CANCELLED, "the driver was stopped"))
        return not self._thread.is_alive()

    def report(self) -> StreamReport:
        """The present condition and counts."""
        with self._lock:
            now = time.monotonic()
            status_text = self._link.describe(self._health.status)
            counter = self._counter
            return StreamReport(
                condition=self._health.condition(now, status_text),
                device=self._link.name,
                received=counter.received,
                lost=counter.lost,
                out_of_order=counter.out_of_order,
                duplicates=counter.duplicates,
                restarts=counter.restarts,
                rejected=self._health.rejected,
                withheld=self._withheld,
                connects=self._connects,
                rate=self._rate,
                age=self._health.age(now),
                status=self._health.status,
                status_text=status_text,
                bias=tuple(self._bias.tolist()),
            )

    def zero(self, count: int, timeout: float, hardware: bool = False) -> Bias:
        """Make the present load the zero; call from any thread but the acquisition's.

        Args:
            count: samples to average.
            timeout: s for everything.
            hardware: zero the device itself, which holds for every client, then check that it did.

        Raises:
            SensorError: SENSOR_STALE, without samples; DEADLINE; SENSOR_FAULT, when the device did not zero itself.
            NoAnswerError: NOT_IDENTIFIABLE, when the load moves.
        """
        deadline = time.monotonic() + timeout
        bias = self._collect(count, deadline)
        if not hardware:
            with self._lock:
                self._bias = bias.wrench_in_sensor
            return bias
        self._orders.put(self._zero_device)
        self._stopping.wait(2 * _LONGEST_WAIT)  # until samples from before it are gone
        after = self._collect(count, deadline)
        if np.any(np.abs(after.wrench_in_sensor) > MAX_DRIFT):
            raise SensorError(
                ErrorCode.SENSOR_FAULT, f"the device did not zero itself: it still shows {after.wrench_in_sensor}"
            )
        with self._lock:
            self._bias = np.zeros(6)
        return bias

    def _await_samples(self, deadline: float) -> None:
        """Give a stream that is being reconnected the time for that."""
        end = min(deadline, time.monotonic() + _RECONNECTS_WITHIN)
        while not self._health.is_connected and not self._stopping.wait(0.01):
            if time.monotonic() > end:
                raise SensorError(ErrorCode.SENSOR_STALE, "no samples to take a bias from; connect the sensor first")

    def _collect(self, count: int, deadline: float) -> Bias:
        self._await_samples(deadline)
        job = BiasJob(count)
        with self._lock:
            if self._stopping.is_set():
                raise SensorError(ErrorCode.CANCELLED, "the driver was stopped")
            if self._job is not None:
                self._job.fail(SensorError(ErrorCode.BUSY, "another bias was asked for"))
            self._job = job
        try:
            return job.future.result(max(0.0, deadline - time.monotonic()))
        except FutureTimeoutError:
            raise SensorError(
                ErrorCode.DEADLINE, f"{count} samples did not come in time; ask for fewer, or see diagnostics"
            ) from None
        finally:
            with self._lock:
                self._job = None

    def _zero_device(self) -> None:
        self._counter.expect_restart()
        self._link.bias()

    # Everything below runs in the acquisition's thread.

    def _run(self) -> None:
        while not self._stopping.is_set():
            self._guard(self._step)
            self._guard(self._report)
        self._link.close()

    def _guard(self, act: Callable[[], None]) -> None:
        """Report an exception of this code or of the sink, and go on with the stream."""
        try:
            act()
        except Exception as error:
            with self._lock:
                self._health.note("failed", f"please report this: {error!r}", time.monotonic())
            self._stopping.wait(0.01)  # limits the load of an error that repeats

    def _step(self) -> None:
        connected = self._health.is_connected
        if not connected and time.monotonic() >= self._next_start:
            self._connect()
        now = time.monotonic()
        due = self._options.silence - (self._health.age(now) or 0.0) if connected else self._next_start - now
        samples = self._read(min(_LONGEST_WAIT, max(0.0, due)))
        if samples is None:
            self._health.check(time.monotonic())
            return
        if len(samples) and not connected:
            self._backoff.reset()
        self._deliver(*self._digest(samples))

    def _deliver(self, blocks: BlockAverages, batch: SampleBatch | None) -> None:
        if len(blocks):
            self._sink.blocks(blocks)
        if batch is not None:
            self._sink.batch(batch)

    def _connect(self) -> None:
        self._connects += 1
        with self._lock:
            self._counter.expect_restart()
            self._averager.clear()  # a block across a silence has no meaning
            rest = self._batcher.flush(self._counter, self._clock)
        if rest is not None:
            self._sink.batch(rest)
        try:
            self._link.start()
        except (OSError, PoiseError) as error:
            self._lose(error)
        else:
            self._is_open = True
            rate = self._link.rate
            if self._clock is None and rate is not None:
                with self._lock:
                    self._clock = SampleClock(1e9 / rate)
                    self._averager = BlockAverager(block_size(rate, self._options.publish_rate))
        self._next_start = time.monotonic() + self._backoff.next()

    def _read(self, timeout: float) -> SensorSamples | None:
        if not self._is_open:
            self._stopping.wait(timeout)
            return None
        try:
            while True:
                self._orders.get_nowait()()
        except Empty:
            pass
        except (OSError, PoiseError) as error:
            self._lose(error)
            return None
        try:
            return self._link.read(timeout)
        except (OSError, PoiseError) as error:
            self._lose(error)
            return None

    def _lose(self, error: Exception) -> None:
        """An attempt failed: with an OSError the wire is gone."""
        if isinstance(error, PoiseError):
            known = error
        else:
            self._is_open = False
            self._link.close()
            known = SensorError(ErrorCode.SENSOR_UNREACHABLE, f"{self._link.name}: {error}")
        with self._lock:
            self._health.failed(known)
        self._stopping.wait(0.001)

    def _digest(self, samples: SensorSamples) -> tuple[BlockAverages, SampleBatch | None]:
        with self._lock:
            now = time.monotonic()
            counter, before = self._counter, (self._counter.lost, self._counter.restarts)
            index, position = counter.account(samples.sequence)
            self._health.take(samples, now)
            if counter.lost > before[0]:
                self._health.note("losing", f"{counter.lost} of {counter.lost + counter.received} samples lost", now)
            if counter.restarts > before[1]:
                self._health.note("restarted", "the device restarted its count", now)
                self._averager.clear()
                if self._clock is not None:
                    self._clock.restart()
            samples = samples.take(index)
            stamped = self._stamp(samples, position)
            if self._job is not None and len(samples):
                usable = not (stamped.saturated.any() or stamped.faulty.any())
                self._job.feed(samples.wrench_in_sensor, usable)
            batch = self._batcher.push(samples, stamped, counter, self._clock)
            return self._publishable(self._averager.push(stamped)), batch

    def _stamp(self, samples: SensorSamples, position: NDArray[np.int64]) -> Stamped:
        if self._clock is None:
            stamps = np.full(len(samples), samples.arrival, dtype=np.int64)
        elif len(samples):
            self._clock.observe(int(position[-1]), samples.arrival)
            stamps = self._clock.stamps(position)
        else:
            stamps = np.empty(0, dtype=np.int64)
        wrench = samples.wrench_in_sensor - self._bias
        return Stamped(position, stamps, wrench, samples.saturated, samples.faulty)

    def _publishable(self, blocks: BlockAverages) -> BlockAverages:
        """Leave out averages of saturated, faulty or repeated samples."""
        bad = blocks.faulty | (blocks.saturated & (not self._options.publish_saturated))
        if self._health.is_stalled:
            bad[:] = True
        if not bad.any():
            return blocks
        self._withheld += int(bad.sum())
        return blocks.take(~bad)

    def _report(self) -> None:
        with self._lock:
            now = time.monotonic()
            count, since = self._rate_from
            if now - since >= _REPORT_PERIOD:
                self._rate = (self._counter.received - count) / (now - since)
                self._rate_from = (self._counter.received, now)
            kind = self._health.condition(now, "").kind
        if kind != self._reported_kind or now - self._reported_at >= _REPORT_PERIOD:
            self._reported_kind, self._reported_at = kind, now
            self._sink.report(self.report())
