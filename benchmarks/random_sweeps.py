"""Volumes of random things from sweeps of two depth cameras; `python -m benchmarks.scanning --random N` prints them."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.sweep_objects import Thing, swept, thing
from poise.errors import PoiseError
from poise.fake_robots.sweep_bag import VGA
from poise.scanning import Frame, View, depth_in_metres, scan

_NEAR = 0.15
_HEADINGS = (
    "camera", "sweeps", "refused", "off, middle %", "bias %", "within 15 %", "worst", "stated +- %", "beyond 2 sigma",
    "nor in the range if hollow", "with such a range",
    "parts", "of one colour (1 to 3)", "of two (2 to 4)", "scan, CPU s", "solid and parts, CPU s",
)  # fmt: skip


@dataclass(frozen=True)
class Sweep:
    """One sweep.

    Args:
        name, camera: of the thing and what saw it.
        volume, std: found, and its stated sigma, over the true volume; NaN when refused.
        hollow: the least volume that is stated in case of a hollow, over the true one; NaN where none is.
        parts: that were found.
        paints: colours that it has.
        scanning, cutting: s of CPU.
        notes: of the scan and the solid, or why it was refused.
    """

    name: str
    camera: str
    volume: float
    std: float
    hollow: float
    parts: int
    paints: int
    scanning: float
    cutting: float
    notes: tuple[str, ...]

    @property
    def near(self) -> bool:
        """Within 15 % of the truth."""
        return abs(self.volume - 1) < _NEAR

    @property
    def missed(self) -> bool:
        """The truth is beyond two of the stated sigmas."""
        return abs(self.volume - 1) > 2 * self.std

    @property
    def silent(self) -> bool:
        """Missed, and not in the range that is stated in case of a hollow."""
        return self.missed and not self.hollow - 2 * self.std < 1 < self.volume

    def __str__(self) -> str:
        return (
            f"{self.camera:6} {self.name:28} {self.volume:5.2f} ± {self.std:4.2f}"
            f" {'!!' if self.silent else '! ' if self.missed else '  '}"
            f" ({self.hollow:4.2f} if hollow)"
            f" {self.parts:3} parts of {self.paints}"
            f" {self.scanning:5.2f} s {self.cutting:5.2f} s  {'; '.join(self.notes)}"
        )


def measure(made: Thing, camera: str, views: list[View]) -> Sweep:
    """Scan one thing."""
    name, volume, paints = made.name, made.volume, len(np.unique(made.colours, axis=0))
    start = time.process_time()
    try:
        found = scan(views)
        between = time.process_time()
        cut = found.segmented()
    except PoiseError as error:
        return Sweep(
            name, camera, np.nan, np.nan, np.nan, 0, paints, time.process_time() - start, np.nan, (error.message,)
        )
    end = time.process_time()
    ratio, std = cut.solid.volume / volume, cut.solid.volume_std / volume
    hollow = np.nan if cut.volume_if_hollow is None else cut.volume_if_hollow / volume
    notes = (*found.notes, *cut.notes)
    return Sweep(name, camera, ratio, std, hollow, cut.n_parts, paints, between - start, end - between, notes)


def measured(seeds: range, cameras: tuple[str, ...], frames: int, kept: Path | None) -> Iterator[Sweep]:
    """All seeds; the images are kept in a folder, if one is given, for the next time."""
    for seed in seeds:
        made = thing(seed)
        path = None if kept is None else kept / f"{seed}_{frames}.npz"
        views = _read(path) if path is not None and path.exists() else swept(made, seed, frames, cameras)
        if path is not None and not path.exists():
            _write(path, views)
        for camera in cameras:
            yield measure(made, camera, views[camera])


def _write(path: Path, views: dict[str, list[View]]) -> None:
    """Keep views whose depth is whole mm."""
    some = next(iter(views.values()))
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(
        path,
        colours=np.array([view.frame.colours for view in some]),
        rotation=np.array([view.rotation_world_camera for view in some]),
        translation=np.array([view.translation_world_camera for view in some]),
        stamps=np.array([view.frame.stamp for view in some]),
        **{f"depth_{camera}": _millimetres(of_camera) for camera, of_camera in views.items()},
    )


def _millimetres(views: list[View]) -> NDArray[np.uint16]:
    return np.array([np.round(1e3 * view.frame.depth) for view in views], np.uint16)


def _read(path: Path) -> dict[str, list[View]]:
    views: dict[str, list[View]] = {}
    with np.load(path) as data:
        place = list(zip(data["stamps"], data["colours"], data["rotation"], data["translation"], strict=True))
        for key in data.files:
            if key.startswith("depth_"):
                depths = (depth_in_metres(steps, "16UC1") for steps in data[key])
                views[key.removeprefix("depth_")] = [
                    View(Frame(int(stamp), "camera", VGA, depth, colours), turn, at)
                    for depth, (stamp, colours, turn, at) in zip(depths, place, strict=True)
                ]
    return views


def table(rows: list[Sweep]) -> Table:
    """A row per camera."""
    made = Table(title="random things, volume over the truth")
    for heading in _HEADINGS:
        made.add_column(heading, justify="right")
    for camera in dict.fromkeys(row.camera for row in rows):
        mine = [row for row in rows if row.camera == camera]
        made.add_row(camera, *_summary(mine))
    return made


def _summary(rows: list[Sweep]) -> list[str]:
    good = [row for row in rows if np.isfinite(row.volume)]
    if not good:
        return [str(len(rows))] * 2 + ["-"] * 13
    ratio = np.array([row.volume for row in good])
    return [
        str(len(rows)),
        str(len(rows) - len(good)),
        f"{100 * np.median(np.abs(ratio - 1)):.1f}",
        f"{100 * (np.median(ratio) - 1):+.1f}",
        f"{sum(row.near for row in good)} of {len(rows)}",
        f"{ratio[np.argmax(np.abs(ratio - 1))]:.2f}",
        f"{100 * np.median([row.std for row in good]):.1f}",
        f"{sum(row.missed for row in good)} of {len(good)}",
        f"{sum(row.silent for row in good)}",
        f"{sum(np.isfinite(row.hollow) for row in good)}",
        f"{np.mean([row.parts for row in good]):.1f}",
        *(_parts([row for row in good if row.paints == paints], paints) for paints in (1, 2)),
        f"{np.median([row.scanning for row in good]):.2f}",
        f"{np.median([row.cutting for row in good]):.2f}",
    ]


def _parts(rows: list[Sweep], least: int) -> str:
    """The mean, and how many are between the parts there are and two more."""
    near = sum(least <= row.parts <= least + 2 for row in rows)
    return f"{np.mean([row.parts for row in rows]):.1f}; {near} of {len(rows)}" if rows else "-"


def report(seeds: range, cameras: tuple[str, ...], frames: int, kept: Path | None, console: Console) -> None:
    """Print each sweep, and the table."""
    rows = []
    for row in measured(seeds, cameras, frames, kept):
        rows.append(row)
        console.print(str(row), soft_wrap=True, highlight=False)
    console.print(table(rows))
