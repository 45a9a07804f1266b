"""Clouds to solids to parts on the workshop tools, beside tables 3.5 and 3.6 of the thesis; then their e_I.

python -m benchmarks.segmentation [--tools NPZ] [--repeats N] [--seeds N] [--out FOLDER]
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.identification.objects import BenchmarkObject, load_tools
from benchmarks.identification.scenarios import DEVELOPMENT_SEEDS, Scenario, make_trial
from poise.inertia.methods import method
from poise.inertia.metrics import errors
from poise.inertia.parameters import InertialParameters
from poise.inertia.parts import Parts
from poise.shape.carving import carve
from poise.shape.hierarchy import MergeCosts
from poise.shape.independent import independent_parts
from poise.shape.metrics import global_consistency_error, scaled_hausdorff, undersegmentation_error
from poise.shape.segmentation import Segmentation, SegmentationOptions, segment

Array = NDArray[np.float64]
SHIPPED = Path(__file__).resolve().parent / "data" / "workshop_clouds.npz"
NOISE = 3e-4  # m, of the clouds that are sampled anew
SAMPLES, SEEN = 100_000, 20_000
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
    "eq. (3.27) alone": SegmentationOptions(costs=MergeCosts(colour=0, fold=0, hollow=1.0), limit=0.06),
}
STILL = Scenario("stop-and-go")
console = Console(width=130)


@dataclass(frozen=True, eq=False)
class ToolCloud:
    """A tool of tools/convert_workshop_clouds.py, which says what the arrays are."""

    name: str
    points: Array
    colours: Array
    labels: NDArray[np.int64]
    vertices: Array
    triangles: NDArray[np.int64]
    volume: float

    def surface(self, rng: np.random.Generator, count: int) -> Array:
        return sample(self.vertices, self.triangles, rng, count)


@dataclass(frozen=True)
class Record:
    """One tool; Hausdorff in mm at a diagonal of 1 m, seconds from cloud to parts and to the solid alone.

    Args:
        hausdorff: to the surface that a ball can touch from outside (the true one carved from `SEEN` of its points).
        hausdorff_inside: to all of the true surface, with gaps between parts and hollows that no camera sees.
    """

    tool: str
    variant: str
    use: float
    gce: float
    hausdorff: float
    hausdorff_inside: float
    volume_ratio: float
    volume_std_ratio: float
    n_parts: int
    n_true: int
    seconds: float
    carve_seconds: float


def load_clouds(source: Path = SHIPPED) -> list[ToolCloud]:
    """The tools of an .npz, by name."""
    with np.load(source, allow_pickle=False) as file:
        names = sorted({key.split("/")[0] for key in file.files})
        return [
            ToolCloud(
                name,
                file[f"{name}/points"].astype(np.float64),
                file[f"{name}/colours"] / 255.0,
                file[f"{name}/labels"].astype(np.int64),
                file[f"{name}/vertices"].astype(np.float64),
                file[f"{name}/triangles"].astype(np.int64),
                float(file[f"{name}/volume"]),
            )
            for name in names
        ]


def sample(vertices: Array, triangles: NDArray[np.int64], rng: np.random.Generator, count: int) -> Array:
    """(count, 3) points on triangles, as many per area everywhere."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = rng.choice(len(triangles), count, p=areas / areas.sum())
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen]


def resampled(tool: ToolCloud, seed: int) -> ToolCloud:
    """Another cloud of the same tool: other points, with noise; colours and labels of the nearest point."""
    rng = np.random.default_rng([seed, *tool.name.encode()])
    clean = tool.surface(rng, len(tool.points))
    nearest = np.argmin(np.linalg.norm(clean[:, None] - tool.points[None], axis=2), axis=1)
    noisy = clean + rng.normal(scale=NOISE, size=clean.shape)
    return replace(tool, points=noisy, colours=tool.colours[nearest], labels=tool.labels[nearest])


def measure(tool: ToolCloud, variant: str, repeats: int) -> tuple[Record, Segmentation]:
    """All stages on one tool; times are the best of the repeats."""
    options, times, carve_times = VARIANTS[variant], [], []
    for _ in range(repeats):
        start = time.perf_counter()
        found = segment(tool.points, tool.colours, options)
        times.append(time.perf_counter() - start)
        start = time.perf_counter()
        carve(found.solid.vertices)
        carve_times.append(time.perf_counter() - start)
    rng = np.random.default_rng(0)
    everything = tool.surface(rng, SAMPLES)
    seen = carve(tool.surface(rng, SEEN))
    reference = sample(seen.vertices, seen.surface[0], rng, SAMPLES)
    rebuilt = sample(found.solid.vertices, found.surface[0], rng, SAMPLES)
    record = Record(
        tool.name,
        variant,
        undersegmentation_error(found.labels, tool.labels),
        global_consistency_error(found.labels, tool.labels),
        1e3 * scaled_hausdorff(rebuilt, reference),
        1e3 * scaled_hausdorff(rebuilt, everything),
        found.solid.volume / tool.volume,
        found.solid.volume_std / tool.volume,
        found.n_parts,
        len(np.unique(tool.labels)),
        float(np.median(times)),
        float(np.median(carve_times)),
    )
    return record, found


def table(records: Sequence[Record], title: str, thesis: bool) -> Table:
    """A row per tool, then the mean and the worst."""
    made = Table(title=title, title_justify="left")
    headings = ("tool", "USE", "GCE", "Hausdorff mm", "with insides", "volume / true", "parts", "true", "s", "solid s")
    for heading in headings + (("thesis USE", "GCE", "mm") if thesis else ()):
        made.add_column(heading, justify="left" if heading == "tool" else "right")
    for one in records:
        beside = [f"{value:.3g}" for value in THESIS.get(one.tool, ())] if thesis else []
        ratio = f"{one.volume_ratio:.2f} ± {one.volume_std_ratio:.2f}"
        scores = (
            f"{one.use:.3f}",
            f"{one.gce:.3f}",
            f"{one.hausdorff:.1f}",
            f"{one.hausdorff_inside:.1f}",
            ratio,
            str(one.n_parts),
            str(one.n_true),
        )
        made.add_row(one.tool, *scores, f"{one.seconds:.2f}", f"{one.carve_seconds:.2f}", *beside)
    made.add_section()
    columns = [[getattr(one, name) for one in records] for name in ("use", "gce", "hausdorff", "hausdorff_inside")]
    off = np.abs([one.volume_ratio - 1 for one in records])
    parts, seconds = [one.n_parts for one in records], [one.seconds for one in records]
    beside = [f"{value:.3f}" for value in np.mean([THESIS[one.tool] for one in records], axis=0)] if thesis else []
    use, gce, hausdorff, inside = (float(np.mean(column)) for column in columns)
    volume = f"off {np.median(off):.0%}, <40%: {np.mean(off < 0.4):.0%}"
    middle = f"{np.median(seconds):.2f}, worst {max(seconds):.2f}"
    means = (
        f"{use:.3f}",
        f"{gce:.3f}",
        f"{hausdorff:.1f}",
        f"{inside:.1f}",
        volume,
        f"{np.mean(parts):.1f}",
        "",
        middle,
        "",
    )
    made.add_row("mean", *means, *beside)
    return made


def downstream(found: dict[str, Segmentation], tools: Sequence[BenchmarkObject], seeds: Sequence[int]) -> Table:
    """Mean e_I in % of stop-and-go with moderate noise, with the true parts, ours, and ours made independent."""
    poses = _poses()
    made = Table(title="stop-and-go, moderate noise: mean e_I %", title_justify="left")
    for heading in ("method", "true parts", "all of ours", "at most 4 independent", "one part"):
        made.add_column(heading, justify="left" if heading == "method" else "right")
    for name in ("poise", "hps"):
        solve = method(name)
        sums: dict[str, list[float]] = {"true": [], "all": [], "independent": [], "one": []}
        for tool in track(tools, f"downstream, {name}", console=console, transient=True):
            if tool.name not in found:
                continue
            ours = _parts(found[tool.name], poses[tool.name])
            for seed in seeds:
                trial = make_trial(tool, STILL, seed)
                for key, parts in {"true": None, **ours}.items():
                    problem = trial.problem
                    if parts is not None:
                        problem = replace(problem, unit_parts=parts.unit_phi, part_volumes=parts.volumes)
                    estimate = InertialParameters.from_phi(solve(problem).phi)
                    sums[key].append(errors(estimate, tool.truth, tool.bounding_box).inertia)
        made.add_row(name, *(f"{np.mean(values):.2f} (median {np.median(values):.2f})" for values in sums.values()))
    return made


def _parts(found: Segmentation, pose: Array) -> dict[str, Parts]:
    """In the sensor frame."""
    solid, rotation, translation = found.solid, pose[:3, :3], pose[:3, 3]
    labels = {"all": found.tetrahedron_labels, "independent": independent_parts(found), "one": None}
    return {
        key: Parts.from_tetrahedra(solid.vertices, solid.tetrahedra, part).in_frame(rotation, translation)
        for key, part in labels.items()
    }


def _poses() -> dict[str, Array]:
    """(4, 4) of each tool's mesh frame in the sensor frame."""
    with np.load(SHIPPED.with_name("workshop_tools.npz"), allow_pickle=False) as file:
        return {key.split("/")[0]: file[key] for key in file.files if key.endswith("pose_in_sensor")}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tools", type=Path, default=SHIPPED, help="what tools/convert_workshop_clouds.py writes")
    parser.add_argument("--repeats", type=int, default=3, help="of the timing")
    parser.add_argument("--seeds", type=int, default=2, help="of other samplings, and of the downstream trials")
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    from poise.viewing.parts_picture import draw_parts

    tools = load_clouds(arguments.tools)
    records: list[Record] = []
    kept: dict[str, Segmentation] = {}
    segment(tools[0].points, tools[0].colours)  # nobody's first call pays for loading libraries
    for variant in VARIANTS:
        here = []
        for tool in track(tools, variant, console=console, transient=True):
            record, found = measure(tool, variant, arguments.repeats)
            here.append(record)
            kept.setdefault(tool.name, found)
        title = f"{variant}; thesis: table 3.6, {THESIS_SECONDS} s per tool (table 3.5)"
        console.print(table(here, title, thesis=all(one.tool in THESIS for one in here)))
        records += here
    for seed in range(arguments.seeds):
        here = [measure(resampled(tool, seed), "poise", 1)[0] for tool in tools]
        console.print(table(here, f"other points on the same tools, noise {1e3 * NOISE:.1f} mm, seed {seed}", False))
        records += [replace(one, variant=f"resampled {seed}") for one in here]
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "segmentation.json").write_text(json.dumps([asdict(one) for one in records], indent=1))
    (arguments.out / "segmentation.png").write_bytes(draw_parts(list(kept.items())))
    console.print(downstream(kept, load_tools(), DEVELOPMENT_SEEDS[: arguments.seeds]))


if __name__ == "__main__":
    main()
