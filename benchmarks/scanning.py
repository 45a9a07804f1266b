"""Sweeps of a simulated depth camera around workshop tools, made into clouds: time, accuracy, volume; and a picture.

python -m benchmarks.scanning [--tools NAME...] [--frames N] [--repeats N] [--picture PNG]
python -m benchmarks.scanning --random N [--first SEED] [--cameras NAME...] [--frames N] [--keep FOLDER]
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.random_sweeps import report
from benchmarks.segmentation_truth import sample
from benchmarks.sweep_objects import CAMERAS
from poise.errors import PoiseError
from poise.fake_robots.rasteriser import Body, Scene
from poise.fake_robots.sweep_bag import FakeSweep, arm_sweep, fake_views
from poise.robot import RobotModel
from poise.scanning import Scan, ScanOptions, View, scan
from poise.shape.segmentation import segment
from poise.types import Array, Mask
from tools.make_scan_bag import tool_body

TOOLS = ("hammer", "screwdriver", "adjustable_wrench", "c_clamp", "ruler", "measuring_tape")
SPOT = (0.45, 0.0)
GAP = (40, 60)
"""Frames whose poses are spoilt in the second part."""
SAMPLES = 200_000
console = Console(width=130)


@dataclass(frozen=True, eq=False)
class Case:
    """A tool on the table, and what the arm's camera saw of it."""

    name: str
    body: Body
    volume: float
    views: list[View]

    def surface(self, count: int = SAMPLES) -> Array:
        """(count, 3) m on the true surface, evenly."""
        corners = self.body.triangles.reshape(-1, 3)
        return sample(corners, np.arange(len(corners)).reshape(-1, 3), np.random.default_rng(0), count)


def make_case(name: str, frames: int) -> Case:
    """Sweep an xArm7 with a camera of 640 x 480 pixels around a tool; not a part of any timing."""
    body, volume = tool_body(name, SPOT, 0.4)
    sweep = FakeSweep(Scene((body,), middle=SPOT), frames=frames)
    model = RobotModel.from_file("xarm7", "link_eef")
    rotation, translation, _ = arm_sweep(sweep, model, 0.0, np.random.default_rng(0))
    return Case(name, body, volume, [view for view, _ in fake_views(sweep, rotation, translation)])


def spoilt(views: Sequence[View], rng: np.random.Generator) -> list[View]:
    """Poses as bad calibration leaves them (0.5 mm, 0.1 deg), and 20 views in a gap of joint states (8 mm, 1.5 deg)."""
    middle, wrong = np.array([*SPOT, 0.02]), []
    for number, view in enumerate(views):
        gap = GAP[0] <= number < GAP[1]
        turn = Rotation.from_rotvec(rng.normal(size=3) * np.deg2rad(1.5 if gap else 0.1)).as_matrix()
        shift = rng.normal(size=3) * (8e-3 if gap else 5e-4)
        wrong.append(replace(view.moved(turn, middle + shift - turn @ middle), sure=not gap))
    return wrong


def timed(views: Sequence[View], repeats: int) -> tuple[Scan, list[float], list[float]]:
    """The scan, and of each repeat s by the clock and s of all cores together."""
    seconds, used = [], []
    for _ in range(repeats):
        start, begin = time.perf_counter(), time.process_time()
        found = scan(views)
        seconds.append(time.perf_counter() - start)
        used.append(time.process_time() - begin)
    return found, seconds, used


def row_of(case: Case, repeats: int) -> list[str]:
    """One line of the table."""
    truth = case.surface()
    tree = cKDTree(truth)
    found, seconds, used = timed(case.views, repeats)
    seen, hidden = (1e3 * tree.query(found.points[kept])[0] for kept in (found.seen, ~found.seen))
    cut = found.segmented()
    bad = spoilt(case.views, np.random.default_rng(1))
    poses = " / ".join(_off(bad, options, tree) for options in (ScanOptions(refine="never"), ScanOptions()))
    return [
        case.name,
        f"{np.median(seconds):.2f} ({max(seconds):.2f})",
        f"{np.median(used):.2f}",
        f"{seen.mean():.2f} ({np.quantile(seen, 0.95):.2f})",
        f"{hidden.mean():.1f}",
        f"{np.mean(~found.seen):.0%}",
        f"{cut.solid.volume / case.volume:.2f} ± {cut.solid.volume_std / case.volume:.2f}",
        f"{thesis_volume(found) / case.volume:.2f}",
        poses,
    ]


def _off(views: Sequence[View], options: ScanOptions, truth: cKDTree) -> str:
    """Mean distance, mm, of seen points from the true surface, or that the scan is refused."""
    try:
        found = scan(views, options)
    except PoiseError:
        return "refused"
    return f"{1e3 * truth.query(found.points[found.seen])[0].mean():.2f}"


def thesis_volume(found: Scan) -> float:
    """m3 with the whole cloud projected onto the table, as the thesis completes it (section 3.2.4)."""
    seen = found.points[found.seen]
    heights = found.plane.heights(seen)
    flat = seen - heights[:, None] * found.plane.normal
    walls = [seen - share * heights[:, None] * found.plane.normal for share in (0.25, 0.5, 0.75)]
    edge = _edge(seen @ found.plane.axes[:2].T)
    points = np.concatenate([seen, flat, *(wall[edge] for wall in walls)])
    return segment(points).solid.volume


def _edge(flat: Array) -> Mask:
    """Points on the outline, seen from above: those whose neighbours all lie to one side."""
    near = cKDTree(flat).query(flat, k=12)[1]
    return np.asarray(np.linalg.norm((flat[near] - flat[:, None]).mean(axis=1), axis=1) > 4e-4)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tools", nargs="+", default=TOOLS)
    parser.add_argument("--frames", type=int, default=127)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--picture", type=Path, help="draw the first tool")
    parser.add_argument("--random", type=int, help="so many random things instead (benchmarks/sweep_objects.py)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first of them")
    parser.add_argument("--cameras", nargs="+", default=CAMERAS, choices=CAMERAS)
    parser.add_argument("--keep", type=Path, help="folder in which their images are kept for the next time")
    options = parser.parse_args()
    if options.random is not None:
        seeds = range(options.first, options.first + options.random)
        report(seeds, tuple(options.cameras), options.frames, options.keep, console)
        return
    table = Table(title=f"{options.frames} frames of 640 x 480, D435 noise")
    for heading in (
        "tool", "s (worst)", "CPU s", "seen off, mm (95 %)", "completed off, mm", "completed", "volume / true",
        "projected as the thesis", "spoilt poses, mm: left / refined",
    ):  # fmt: skip
        table.add_column(heading, justify="right")
    for name in track(options.tools, console=console):
        case = make_case(name, options.frames)
        if options.picture is not None and name == options.tools[0]:
            draw(case, scan(case.views), options.picture)
        try:
            row = row_of(case, options.repeats)
        except PoiseError as error:
            row = [name, error.message]
        console.print(" | ".join(row), soft_wrap=True)
        table.add_row(*row)
    console.print(table)


def draw(case: Case, found: Scan, path: Path) -> None:
    """What the camera saw once, the cloud in its colours, and what was seen and completed."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 4.2), dpi=90, layout="constrained")
    FigureCanvasAgg(figure)
    frame = case.views[len(case.views) // 3].frame
    image, depth, cloud = figure.subplots(1, 3)
    image.imshow(frame.colours)
    image.set_title("one of the views")
    depth.imshow(np.where(frame.depth > 0, frame.depth, np.nan), cmap="viridis", vmin=0.2, vmax=0.45)
    depth.set_title("its depth, with the holes of a D435")
    x, z = found.points @ np.array([np.cos(0.4), np.sin(0.4), 0.0]), found.points[:, 2]
    y = found.points @ np.array([-np.sin(0.4), np.cos(0.4), 0.0])
    colours = np.where(found.seen[:, None], found.colours, [0.85, 0.2, 0.15])
    order = np.argsort(z)
    cloud.scatter(x[order], y[order], s=0.4, c=colours[order])
    side = y.min() - 0.03
    nearest = np.argsort(-y)
    cloud.scatter(x[nearest], z[nearest] + side - z.max(), s=0.4, c=colours[nearest])
    cloud.set_title("cloud from above and the side; red: completed")
    for axes in (image, depth, cloud):
        axes.set_aspect("equal")
        axes.axis("off")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Software": None})


if __name__ == "__main__":
    main()
