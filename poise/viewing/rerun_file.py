"""A Rerun recording being filled: curves over time, what does not change, and the file at the end."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.files import write_whole
from poise.types import Array


class RerunFile:
    """One recording; `rr` is the rerun module, imported late because it is an extra.

    Args:
        name: of the application.
        origin: ns, where the timeline `time` begins.

    Raises:
        InputError: UNSUPPORTED when rerun-sdk is not installed.
    """

    def __init__(self, name: str, origin: int) -> None:
        try:
            import rerun as rr
        except ImportError as error:
            raise InputError(
                ErrorCode.UNSUPPORTED, "a Rerun recording needs rerun-sdk: pip install 'poise[viewer]'"
            ) from error
        self.rr: Any = rr
        self.origin = origin
        # No viewer and no file is attached: everything stays in memory and is written once, whole.
        self.recording = rr.RecordingStream(name)
        self._memory = rr.memory_recording(self.recording)

    def write(self, path: Path, blueprint: Any) -> Path:
        """Write the file whole, with its layout.

        Raises:
            InputError: FILE_UNWRITABLE.
        """
        self.rr.send_blueprint(blueprint, recording=self.recording)
        self.recording.flush()
        return write_whole(Path(path), self._memory.drain_as_bytes())

    def curve(self, path: str, stamps: NDArray[np.int64], values: Array, colour: Sequence[int], label: str) -> None:
        """One time series in one call."""
        self.static(path, self.rr.SeriesLines(colors=[colour], names=[label]))
        if len(values):
            self.columns(path, stamps, self.rr.Scalars.columns(scalars=values))

    def columns(self, path: str, stamps: NDArray[np.int64], columns: Any) -> None:
        """Rows of one entity on both timelines."""
        indexes = [
            self.rr.TimeColumn("time", duration=(stamps - self.origin).astype("timedelta64[ns]")),
            self.rr.TimeColumn("stamp", timestamp=stamps.astype("datetime64[ns]")),
        ]
        self.rr.send_columns(path, indexes, columns, recording=self.recording, strict=True)

    def static(self, path: str, archetype: Any) -> None:
        """What does not change over time."""
        self.rr.log(path, archetype, static=True, recording=self.recording, strict=True)
