"""Clouds to solids to parts on the workshop tools, beside tables 3.5 and 3.6 of the thesis, and on random objects.

python -m benchmarks.segmentation [--tools NPZ] [--repeats N] [--seeds N] [--random N] [--out FOLDER]
python -m benchmarks.segmentation --scores: USE, GCE and parts of the tools alone, with and without colours and noise.
What the parts are worth to an estimator: python -m benchmarks.segmentation_downstream.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.random_objects import FIRST_TEST_SEED, make_composite
from benchmarks.segmentation_truth import NOISE, SHIPPED, Reference, Subject, load_clouds, resampled
from poise.errors import PoiseError
from poise.shape.carving import carve
from poise.shape.hierarchy import MergeCosts
from poise.shape.metrics import global_consistency_error, undersegmentation_error
from poise.shape.segmentation import Segmentation, SegmentationOptions, segment

# Thesis table 3.6: USE, GCE, Hausdorff in mm at a diagonal of 1 m; table 3.5: seconds (mean over 20 tools).
THESIS = {
    "adjustable_wrench": (0.117, 0.098, 14.2), "bent_jaw_pliers": (0.176, 0.010, 16.5), "box_wrench": (0, 0, 10.9),
    "c_clamp": (0.103, 0.077, 9.6), "clamp": (0.259, 0.181, 17.6), "electronic_caliper": (0.42, 0.316, 9.1),
    "file": (0.057, 0.102, 17.9), "hammer": (0.08, 0.098, 14.7), "measuring_tape": (0, 0, 11.4),
    "nut_screwdriver": (0.002, 0.002, 16.0), "ruler": (0, 0, 14.8), "screwdriver": (0.013, 0.001, 12.1),
    "socket_wrench": (0.141, 0.123, 7.4), "vise_clamp": (0.296, 0.373, 15.1),
}  # fmt: skip
THESIS_SECONDS = 3.48
VARIANTS = {
    "poise": SegmentationOptions(),
    "shape alone": SegmentationOptions(costs=MergeCosts(colour=0.0), limit=SegmentationOptions().plain_limit),
}
console = Console(width=140)


@dataclass(frozen=True)
class Record:
    """One object; distances in mm at a diagonal of 1 m, seconds from cloud to parts and to the solid alone.

    Args:
        hausdorff, mean_distance: to what a ball can touch of the true surface from outside.
        floor: the least that any choice among the tetrahedra of the points reaches (see `Reference.floor`).
        hausdorff_inside: to all of the true surface, with gaps between parts and hollows that no camera sees.
    """

    tool: str
    variant: str
    use: float
    gce: float
    hausdorff: float
    floor: float
    mean_distance: float
    hausdorff_inside: float
    volume_ratio: float
    volume_std_ratio: float
    n_parts: int
    n_true: int
    seconds: float
    slowest: float
    carve_seconds: float


def measure(
    subject: Subject, reference: Reference, variant: str, repeats: int, floor: float = np.nan
) -> tuple[Record, Segmentation]:
    """All stages on one object, whose floor is known; times are the median of the repeats, and the worst."""
    options, times, carve_times = VARIANTS[variant], [], []
    for _ in range(repeats):
        start = time.perf_counter()
        found = segment(subject.points, subject.colours, options)
        times.append(time.perf_counter() - start)
        start = time.perf_counter()
        carve(found.solid.vertices)
        carve_times.append(time.perf_counter() - start)
    hausdorff, mean_distance, inside = (1e3 * value for value in reference.compare(found.solid))
    record = Record(
        subject.name,
        variant,
        undersegmentation_error(found.labels, subject.labels),
        global_consistency_error(found.labels, subject.labels),
        hausdorff,
        1e3 * floor,
        mean_distance,
        inside,
        found.solid.volume / subject.volume,
        found.solid.volume_std / subject.volume,
        found.n_parts,
        len(np.unique(subject.labels)),
        float(np.median(times)),
        max(times),
        float(np.median(carve_times)),
    )
    return record, found


COLUMNS = ("use", "gce", "hausdorff", "floor", "mean_distance", "hausdorff_inside")
HEADINGS = ("object", "USE", "GCE", "Hausdorff mm", "floor", "mean", "with insides", "volume / true", "parts", "true")


def table(records: Sequence[Record], title: str, thesis: bool) -> Table:
    """A row per object, then the mean and the worst."""
    made = Table(title=title, title_justify="left")
    for heading in (*HEADINGS, "s", "solid s", *(("thesis USE", "GCE", "mm") if thesis else ())):
        made.add_column(heading, justify="left" if heading == "object" else "right")
    for one in records:
        beside = [f"{value:.3g}" for value in THESIS[one.tool]] if thesis else []
        ratio = f"{one.volume_ratio:.2f} ± {one.volume_std_ratio:.2f}"
        counts, times = (str(one.n_parts), str(one.n_true)), (f"{one.seconds:.2f}", f"{one.carve_seconds:.2f}")
        made.add_row(one.tool, *_scores([getattr(one, name) for name in COLUMNS]), ratio, *counts, *times, *beside)
    made.add_section()
    off = np.abs([one.volume_ratio - 1 for one in records])
    beside = [f"{value:.3f}" for value in np.mean([THESIS[one.tool] for one in records], axis=0)] if thesis else []
    made.add_row(
        "mean",
        *_scores([float(np.mean([getattr(one, name) for one in records])) for name in COLUMNS]),
        f"off {np.median(off):.0%}, <40%: {np.mean(off < 0.4):.0%}",
        f"{np.mean([one.n_parts for one in records]):.1f}",
        f"{np.mean([one.n_true for one in records]):.1f}",
        f"{np.median([one.seconds for one in records]):.2f}, worst {max(one.slowest for one in records):.2f}",
        "",
        *beside,
    )
    return made


def _scores(values: Sequence[float]) -> list[str]:
    return [f"{value:.{3 if name in ('use', 'gce') else 1}f}" for name, value in zip(COLUMNS, values, strict=True)]


def _tools(source: Path, repeats: int, seeds: int) -> tuple[list[Record], dict[str, Segmentation]]:
    """Tables of the tools, and what was found first for each."""
    tools = load_clouds(source)
    references = {tool.name: Reference(tool) for tool in track(tools, "references", console=console, transient=True)}
    floors = {tool.name: references[tool.name].floor(tool.points) for tool in tools}
    records: list[Record] = []
    kept: dict[str, Segmentation] = {}
    segment(tools[0].points, tools[0].colours)  # loads the libraries before the first timed call
    for variant in VARIANTS:
        here = []
        for tool in track(tools, variant, console=console, transient=True):
            record, found = measure(tool, references[tool.name], variant, repeats, floors[tool.name])
            here.append(record)
            kept.setdefault(tool.name, found)
        title = f"{variant}; thesis: table 3.6, {THESIS_SECONDS} s per tool (table 3.5)"
        console.print(table(here, title, thesis=all(one.tool in THESIS for one in here)))
        records += here
    for seed in range(seeds):
        here = [measure(resampled(tool, seed), references[tool.name], "poise", 1)[0] for tool in tools]
        console.print(table(here, f"other points on the same tools, noise {1e3 * NOISE:.1f} mm, seed {seed}", False))
        records += [replace(one, variant=f"resampled {seed}") for one in here]
    return records, kept


def _alone(source: Path) -> Table:
    """Means over the tools, in half a minute."""
    made = Table(title="the tools, noise along each axis", title_justify="left")
    for heading in ("colours", "noise, mm", "USE", "GCE", "parts", "CPU, s", "refused"):
        made.add_column(heading, justify="right")
    for coloured, noise in ((True, 0.0), (True, 1.0), (False, 0.0), (False, 1.0)):
        rows, refused = [], 0
        for number, tool in enumerate(load_clouds(source)):
            points = tool.points + np.random.default_rng([number, 1]).normal(scale=1e-3 * noise, size=tool.points.shape)
            start = time.process_time()
            try:
                found = segment(points, tool.colours if coloured else None)
            except PoiseError:
                refused += 1
                continue
            scores = [score(found.labels, tool.labels) for score in (undersegmentation_error, global_consistency_error)]
            rows.append([*scores, found.n_parts, time.process_time() - start])
        use, gce, parts, seconds = np.mean(rows, axis=0)
        values = f"{use:.3f}", f"{gce:.3f}", f"{parts:.1f}", f"{seconds:.2f}", str(refused)
        made.add_row("yes" if coloured else "no", f"{noise:g}", *values)
    return made


def _random(count: int) -> list[Record]:
    """A table of objects that nothing was chosen on."""
    records = []
    for seed in track(range(FIRST_TEST_SEED, FIRST_TEST_SEED + count), "random", console=console, transient=True):
        subject = make_composite(seed, NOISE)
        reference = Reference(subject)
        record, _ = measure(subject, reference, "poise", 1, reference.floor(subject.points))
        records.append(replace(record, variant="random"))
    console.print(table(records, f"random objects, noise {1e3 * NOISE:.1f} mm, seeds from {FIRST_TEST_SEED}", False))
    return records


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tools", type=Path, default=SHIPPED, help="what tools/convert_workshop_clouds.py writes")
    parser.add_argument("--repeats", type=int, default=3, help="of the timing")
    parser.add_argument("--seeds", type=int, default=2, help="of other samplings of the tools")
    parser.add_argument("--random", type=int, default=24, help="how many random objects")
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--scores", action="store_true", help="USE and GCE of the tools alone")
    arguments = parser.parse_args()
    if arguments.scores:
        console.print(_alone(arguments.tools))
        return
    from poise.viewing import draw_parts

    records, kept = _tools(arguments.tools, arguments.repeats, arguments.seeds)
    if arguments.random:
        records += _random(arguments.random)
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "segmentation.json").write_text(json.dumps([asdict(one) for one in records], indent=1))
    (arguments.out / "segmentation.png").write_bytes(draw_parts(list(kept.items())))


if __name__ == "__main__":
    main()
