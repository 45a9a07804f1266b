"""Sweeps whose poses are wrong: stamps that are late, a camera that sits elsewhere on the hand, arms that give way.

    python -m benchmarks.broken_sweeps                      # 4 things, each from three motions, in every way
    python -m benchmarks.broken_sweeps --first 9100 --list  # other things, and what is said of each

Random things of `benchmarks.sweep_objects` that are compact, so that volumes are stated to a few percent, are seen by a
camera on an arm, by one that is carried around by hand, and by one at rest beside a turntable whose rate varies. Images
are those of the true poses; the given poses are wrong.
A sweep is right if its volume is within two of the stated sigmas, named if it is not and a note says that poses are
wrong, and silently wrong otherwise. z is the error over the stated sigma; Gaussian errors have a mean z2 of 1.
Exits with 1 where more than 5 % of the sweeps are silently wrong.
"""

import argparse
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count, islice

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.spatial.transform import Rotation

from benchmarks.sweep_objects import CAMERAS, PERIOD, SPOT, Thing, swept, thing
from poise.errors import PoiseError
from poise.fake_robots.rasteriser import Scene, look_at
from poise.fake_robots.sweep_bag import FakeSweep, arm_motion
from poise.robot import RobotModel
from poise.scanning import CameraPoses, Sweep, View, scan_sweep
from poise.types import Array

FIRST = 9000
"""Seeds of things from here on are for development, as from 9200 on; 9100, 9300 and 9400 on were answered once."""
_COMPACT = (0, 1, 7, 9)
"""Last digits of their seeds."""
_POINT = np.array([*SPOT, 0.02])
_CAUSE = r"ms late|ms early|hand-eye|too long|too short|the poses of the views"
Poses = Callable[[Array], tuple[Array, Array]]
"""Rotations (N, 3, 3) and places (N, 3), m, of the camera at times (N,), s."""


# ---- motions ----


def _arm(frames: int) -> Poses:
    return arm_motion(FakeSweep(Scene((), middle=SPOT), frames=frames), RobotModel.from_file("xarm7", "link_eef"))


def _around(azimuth: Array, elevation: Array, distance: Array) -> tuple[Array, Array]:
    level = np.cos(elevation)
    towards = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1)
    places = _POINT + distance[:, None] * towards
    return np.array([look_at(place, _POINT) for place in places]), places


def _by_hand(frames: int) -> Poses:
    def poses(times: Array) -> tuple[Array, Array]:
        turn = 2e9 * np.pi * times / (frames * PERIOD)
        elevation = 0.8 + 0.3 * np.sin(2 * turn + 1.0) + 0.08 * np.sin(5 * turn + 2.0)
        return _around(turn + 0.15 * np.sin(3 * turn), elevation, 0.32 + 0.04 * np.sin(3 * turn + 4.0))

    return poses


def _turntable(frames: int) -> Poses:
    def poses(times: Array) -> tuple[Array, Array]:
        turn = 2e9 * np.pi * times / (frames * PERIOD)
        azimuth = turn + 0.08 * np.sin(2 * turn + 1.0) + 0.05 * np.sin(3 * turn + 3.0)
        return _around(azimuth, np.full(len(turn), 0.75), np.full(len(turn), 0.3))

    return poses


MOTIONS: dict[str, Callable[[int], Poses]] = {"arm": _arm, "by hand": _by_hand, "turntable": _turntable}


# ---- ways of being wrong ----


@dataclass(frozen=True)
class Way:
    """How poses are wrong.

    Args:
        late: of a frame's period, by which images' stamps are late.
        shift: m by which the camera is shifted on the hand, in a random direction.
        turn: deg by which it is turned on it.
        jitter: m, one sigma of the places of single views, whose turns are off by 2 rad per m as well.
    """

    late: float = 0.0
    shift: float = 0.0
    turn: float = 0.0
    jitter: float = 0.0


WAYS = {
    "right": Way(),
    "0.15 of a period late": Way(late=0.15),
    "0.33 of a period late": Way(late=0.33),
    "0.5 of a period late": Way(late=0.5),
    "shifted by 1 mm": Way(shift=1e-3),
    "shifted by 3 mm": Way(shift=3e-3),
    "turned by 0.5 deg": Way(turn=0.5),
    "0.33 late, 2 mm, 0.5 deg": Way(late=0.33, shift=2e-3, turn=0.5),
    "each view off by 0.3 mm": Way(jitter=3e-4),
}


def broken(views: list[View], true: Poses, way: Way, rng: np.random.Generator) -> Sweep:
    """The views with the poses that a wrong recording gives them."""
    stamps = np.array([view.frame.stamp for view in views]) * 1e-9
    shift, turn = rng.normal(size=(2, 3))
    mounting = Rotation.from_rotvec(np.deg2rad(way.turn) * turn / np.linalg.norm(turn)).as_matrix()
    shift = way.shift * shift / np.linalg.norm(shift)
    away = way.jitter * rng.normal(size=(len(views), 3))
    turned = Rotation.from_rotvec(2 * way.jitter * rng.normal(size=(len(views), 3))).as_matrix()

    def poses_at(delay: float) -> CameraPoses:
        rotation, place = true(np.clip(stamps + 1e-9 * PERIOD * way.late - delay, 0.0, stamps[-1]))
        known = np.ones(len(views), bool)
        return CameraPoses(rotation @ mounting @ turned, place + rotation @ shift + away, known, known)

    frames = tuple(view.frame for view in views)
    sweep = Sweep(views, "base", poses_at=poses_at, frames=frames)
    return replace(sweep, views=sweep.delayed(0.0))


# ---- answers ----


@dataclass(frozen=True)
class Answer:
    """Volume and its sigma over the truth, or NaN where it was refused; whether poses are said to be wrong; notes."""

    volume: float
    sigma: float
    named: bool
    said: str

    @property
    def z(self) -> float:
        """The error over the stated sigma."""
        return (self.volume - 1) / self.sigma

    @property
    def outcome(self) -> str:
        """One of `OUTCOMES`."""
        if np.isnan(self.volume):
            return "refused"
        return "right" if abs(self.z) < 2 else "named" if self.named else "silently wrong"


OUTCOMES = ("right", "named", "refused", "silently wrong")


def answer(made: Thing, sweep: Sweep) -> Answer:
    """What is said of a sweep."""
    try:
        found = scan_sweep(sweep)
        solid = found.segmented().solid
    except PoiseError as error:
        return Answer(np.nan, np.nan, bool(re.search(_CAUSE, error.message)), error.message)
    said = "; ".join(found.notes)
    return Answer(solid.volume / made.volume, solid.volume_std / made.volume, bool(re.search(_CAUSE, said)), said)


def answers(
    seeds: Sequence[int], cameras: tuple[str, ...], frames: int, motions: Sequence[str], ways: Sequence[str]
) -> Iterator[tuple[str, str, Answer]]:
    """The way, a name, and the answer, of each thing, motion, camera and way."""
    for seed in seeds:
        made = thing(seed)
        for motion in motions:
            true = MOTIONS[motion](frames)
            seen = swept(made, seed, frames, cameras, true(1e-9 * PERIOD * np.arange(frames)))
            for camera in cameras:
                for number, (name, way) in enumerate(WAYS.items()):
                    if name not in ways:
                        continue
                    rng = np.random.default_rng([seed, 21, number])
                    yield name, f"{made.name}, {motion}, {camera}", answer(made, broken(seen[camera], true, way, rng))


def table(found: dict[str, list[Answer]]) -> Table:
    """A row for each way."""
    made = Table("poses", *OUTCOMES, "causes named", "mean of z2", "worst z", "off, middle %", "stated +-, middle %")
    for name, said in found.items():
        good = [one for one in said if np.isfinite(one.volume)]
        counts = [str(sum(one.outcome == outcome for one in said)) for outcome in OUTCOMES]
        figures = ["-"] * 4
        if good:
            z = np.array([one.z for one in good])
            off = 100 * np.median([abs(one.volume - 1) for one in good])
            sigma = 100 * np.median([one.sigma for one in good])
            figures = [f"{np.mean(z**2):.2f}", f"{z[np.argmax(np.abs(z))]:+.1f}", f"{off:.1f}", f"{sigma:.1f}"]
        made.add_row(name, *counts, str(sum(one.named for one in said)), *figures)
    return made


def main() -> int:
    """Break and answer; 1 where too many are silently wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=FIRST, help="seed of the first thing")
    parser.add_argument("--things", type=int, default=4)
    parser.add_argument("--frames", type=int, default=64)
    parser.add_argument("--cameras", nargs="+", default=CAMERAS, choices=CAMERAS)
    parser.add_argument("--motions", nargs="+", default=list(MOTIONS), choices=MOTIONS)
    parser.add_argument("--ways", nargs="+", default=list(WAYS), choices=WAYS)
    parser.add_argument("--quick", action="store_true", help="one thing, one camera")
    parser.add_argument("--list", action="store_true", help="each answer")
    options = parser.parse_args()
    console = Console(width=170)
    compact = (seed for seed in count(options.first) if seed % 10 in _COMPACT)
    seeds = list(islice(compact, 1 if options.quick else options.things))
    found: dict[str, list[Answer]] = {name: [] for name in options.ways}
    cameras = tuple(options.cameras)[: 1 if options.quick else None]
    for name, of, one in answers(seeds, cameras, options.frames, options.motions, options.ways):
        found[name].append(one)
        if options.list or one.outcome == "silently wrong":
            console.print(f"{name}: {of}: {one.volume:.3f} ± {one.sigma:.3f} {one.outcome}: {one.said}", soft_wrap=True)
    console.print(table(found))
    every = [one for said in found.values() for one in said]
    return int(np.mean([one.outcome == "silently wrong" for one in every]) > 0.05)


if __name__ == "__main__":
    raise SystemExit(main())
