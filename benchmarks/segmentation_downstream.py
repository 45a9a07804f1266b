"""What found parts are worth: e_I of stop-and-go with moderate noise, from true parts and from parts found in clouds.

python -m benchmarks.segmentation_downstream [--seeds N] [--first-seed N] [--random N] [--first-object N] [--layered]
    [--densities given|any|hollow]

Scanned shapes are as `poise identify --object` reads them, and as accurate as it says. The true parts are once known as
from CAD, and once only as accurately as a cloud shows lengths: that difference is what a cloud costs whatever is found.
The last column has found parts on a solid whose volume, centroid and second moments are true: that difference is what
the solid costs, the cuts between its parts left out. The last row is the share of the entries of the inertia that lie
in the 95 % intervals of `poise`. With `--layered` the largest part of each random object has two layers, which no cloud
shows and no model of parts describes. With `--densities` random objects alone have other densities than those of
`benchmarks.random_objects`: any for each colour, or a part of their own, as if they were hollow.
"""

import argparse
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.spatial import cKDTree

from benchmarks.identification.objects import BenchmarkObject, load_tools
from benchmarks.identification.scenarios import DEVELOPMENT_SEEDS, Scenario, make_trial
from benchmarks.random_objects import GRIP, Composite, as_benchmark_object, make_composite
from benchmarks.segmentation_truth import NOISE, SHIPPED, Subject, ToolCloud, load_clouds
from poise.errors import InputError
from poise.inertia.bayes.estimator import SHAPE_ACCURACY, PoiseEstimator
from poise.inertia.estimators.hps import hps
from poise.inertia.model.metrics import errors, expected_errors
from poise.inertia.model.object_shape import (
    CLOUD_ACCURACY,
    ObjectShape,
    load_object,
    parts_of_solid,
    shape_of_cloud,
)
from poise.inertia.model.parameters import UPPER, InertialParameters, phi_of_pseudo_inertia, pseudo_inertia
from poise.inertia.model.parts import Parts, box_moments, likeness_of_colours, upper_factor
from poise.inertia.model.problem import IdentificationProblem
from poise.shape.independent import independent_parts
from poise.shape.reconstruction import guarded, reconstruct
from poise.shape.segmentation import DEFAULT_SEGMENTATION, segment
from poise.types import Array, Indices

INNER = 40_000
"""Points in each piece that the truth is integrated with: with 2,000 its e_I would be 0.7 %, and true parts, which
contain the same error, would alone be right."""
STILL = Scenario("stop-and-go")
HALF = 1.959964
"""Standard deviations: half the width of a 95 % interval."""
LAYERS, LAYER_RATIO = (0.3, 0.7), (0.5, 2.0)
"""Share of the first layer, and log of the ratio of the densities, of which either may be the larger."""
ANY, HOLLOW, HOLLOW_METAL = (300.0, 12_000.0), (0.25, 1.0), 0.3
"""kg/m3 of materials that may be any; shares that are left of hollow ones, and the probability that one of metal is."""
LIGHT = 2000.0
"""kg/m3: what is lighter is no metal."""
Solve = Callable[[IdentificationProblem, Parts, float], tuple[InertialParameters, Array | None]]
"""Parameters, and their covariance (10, 10) if the method has one."""
Case = tuple[Subject, BenchmarkObject, Array]  # and (4, 4), the cloud's frame in the sensor's
console = Console(width=160)


def by_poise(problem: IdentificationProblem, parts: Parts, accuracy: float) -> tuple[InertialParameters, Array | None]:
    estimator = PoiseEstimator(parts, problem.noise, shape_accuracy=accuracy)
    estimator.add_problem(problem)
    found = estimator.solve()
    return found.parameters, found.covariance


def by_hps(problem: IdentificationProblem, parts: Parts, _: float) -> tuple[InertialParameters, Array | None]:
    known = replace(problem, unit_parts=parts.unit_phi, part_volumes=parts.volumes)
    return InertialParameters.from_phi(hps(known).phi), None


METHODS: dict[str, Solve] = {"poise": by_poise, "hps": by_hps}


def parts_to_try(subject: Subject, tool: BenchmarkObject, pose: Array) -> dict[str, tuple[Parts, float]]:
    """By name, with their accuracy, in the sensor frame; (4, 4) pose of the cloud's frame in it."""
    found = segment(subject.points, subject.colours)
    solid, ours = found.solid, shape_of_cloud(found)

    def cut(labels: Indices | None) -> Parts:
        return parts_of_solid(solid, labels)

    scanned = {
        "true labels on our solid": true_labels(subject),
        "ours": ours.parts,
        "all of ours, no colours": cut(found.tetrahedron_labels),
        "at most 4 of ours": cut(independent_parts(found)),
        "one part": cut(None),
    }
    shapes = {name: ObjectShape(parts, ours.accuracy, name) for name, parts in scanned.items()}
    if isinstance(subject, ToolCloud):
        with suppress(InputError):  # a ruler whose surface is not closed is refused
            shapes["its mesh, as read by identify"] = mesh_of(subject)
    held = {name: (shape.parts.in_frame(pose[:3, :3], pose[:3, 3]), shape.accuracy) for name, shape in shapes.items()}
    true = Parts(tool.unit_parts, tool.part_volumes, tool.hull)
    known = {
        "true parts": (true, SHAPE_ACCURACY),
        "the same, as a cloud shows it": (true, CLOUD_ACCURACY),
        "the same, as accurate as ours": (true, ours.accuracy),
    }
    exact = stretched(held["ours"][0], true), ours.accuracy
    return known | held | {"ours, the whole exact": exact}


def stretched(parts: Parts, true: Parts) -> Parts:
    """Parts moved by the one affine map that gives the whole its true volume, centroid and second moments."""
    found, exact = (
        np.array([volume * pseudo_inertia(phi) for volume, phi in zip(each.volumes, each.unit_phi.T, strict=True)])
        for each in (parts, true)
    )
    move = upper_factor(exact.sum(axis=0)) @ np.linalg.inv(upper_factor(found.sum(axis=0)))
    made = Parts.from_moments(move @ found @ move.T, np.arange(len(found)), true.points)
    return replace(made, likeness=parts.likeness)


def true_labels(subject: Subject) -> Parts:
    """True parts cut out of the reconstructed solid, with what their colours say, as `parts_of_segmentation` does."""
    made = reconstruct(subject.points, DEFAULT_SEGMENTATION.points)
    nearest = subject.labels[cKDTree(subject.points).query(made.carved.centroids)[1]]
    present, labels = np.unique(nearest, return_inverse=True)
    colours = np.array([np.median(subject.colours[subject.labels == part], axis=0) for part in present])
    return replace(parts_of_solid(guarded(made, labels), labels), likeness=likeness_of_colours(colours))


def mesh_of(subject: ToolCloud) -> ObjectShape:
    """What `poise identify --object` makes of the true surface; shells that are closed for themselves are parts."""
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in subject.vertices.tolist())
    faces = "".join(f"f {a} {b} {c}\n" for a, b, c in (subject.triangles + 1).tolist())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{subject.name}.obj"
        path.write_text(vertices + faces)
        return load_object(path)


def compare(cases: list[Case], seeds: list[int], title: str) -> Table:
    """Mean and median e_I in % over cases and seeds."""
    sums: dict[tuple[str, str], list[float]] = {}
    inside: dict[str, list[float]] = {}
    for subject, tool, pose in track(cases, title, console=console, transient=True):
        for key, (held, accuracy) in parts_to_try(subject, tool, pose).items():
            for seed in seeds:
                problem = make_trial(tool, STILL, seed).problem
                for name, solve in METHODS.items():
                    found, covariance = solve(problem, held, accuracy)
                    error = errors(found, tool.truth, tool.bounding_box).inertia
                    sums.setdefault((name, key), []).append(error)
                    if covariance is not None:
                        inside.setdefault(key, []).append(covered(found, covariance, tool))
    made = Table(title=f"{title}: mean e_I % (median)", title_justify="left")
    keys = list(dict.fromkeys(key for _, key in sums))
    for heading in ("method", *keys):
        made.add_column(heading, justify="left" if heading == "method" else "right")
    for name in METHODS:
        made.add_row(name, *(f"{np.mean(sums[name, key]):.2f} ({np.median(sums[name, key]):.2f})" for key in keys))
    made.add_row("inside", *(f"{np.mean(inside[key]):.3f}" for key in keys))
    return made


def covered(found: InertialParameters, covariance: Array, tool: BenchmarkObject) -> float:
    """Share of the true inertia's entries in the 95 % intervals."""
    off = np.abs(found.inertia - tool.truth.inertia)[UPPER]
    return float(np.mean(off < HALF * expected_errors(covariance, found, tool.bounding_box)[1][4:]))


def layered(composite: Composite, tool: BenchmarkObject) -> BenchmarkObject:
    """The object, whose largest part has two layers along its longest axis, as a box of its moments would have them."""
    rng, number = (
        np.random.default_rng([len(composite.points), *composite.name.encode()]),
        int(tool.part_volumes.argmax()),
    )
    share, ratio = rng.uniform(*LAYERS), np.exp(rng.choice([-1, 1]) * rng.uniform(*LAYER_RATIO))
    phi = tool.unit_parts[:, number]
    body = InertialParameters.from_phi(phi)
    squares, axes = np.linalg.eigh(np.trace(body.inertia) / 2 * np.eye(3) - body.inertia)
    sides, mass = np.sqrt(12 * squares), composite.densities[number] * tool.part_volumes[number]
    change = -mass * phi
    for start, size, density in ((0.0, share, 1.0), (share, 1 - share, ratio)):
        layer = box_moments(np.array([[0, 0, (start + size / 2 - 0.5) * sides[2]]]), sides[None] * [1, 1, size])[0]
        placed = np.block([[axes, body.com[:, None]], [np.zeros((1, 3)), 1.0]])
        change += mass * density * size * phi_of_pseudo_inertia(placed @ layer @ placed.T / layer[3, 3])
    return replace(tool, truth=InertialParameters.from_phi(tool.truth.phi + change))


def tools() -> list[Case]:
    with np.load(SHIPPED.with_name("workshop_tools.npz"), allow_pickle=False) as file:
        poses = {key.split("/")[0]: file[key] for key in file.files if key.endswith("pose_in_sensor")}
    held = {tool.name: tool for tool in load_tools()}
    return [(cloud, held[cloud.name], poses[cloud.name]) for cloud in load_clouds() if cloud.name in held]


def with_densities(composite: Composite, kind: str) -> Composite:
    """The same of other materials; what was of one still is."""
    rng = np.random.default_rng([91, *composite.name.encode()])
    given, which = np.unique(composite.densities, return_inverse=True)
    if kind == "any":
        made = np.exp(rng.uniform(*np.log(ANY), len(given)))
    else:
        hollow = (given < LIGHT) | (rng.random(len(given)) < HOLLOW_METAL)
        made = given * np.where(hollow, rng.uniform(*HOLLOW, len(given)), 1.0)
    return replace(composite, densities=made[which])


def random_objects(first: int, count: int, hidden: bool = False, densities: str = "given") -> list[Case]:
    pose = np.eye(4)
    pose[:3, 3] = GRIP
    made = [make_composite(seed, NOISE, INNER) for seed in range(first, first + count)]
    if densities != "given":
        made = [with_densities(one, densities) for one in made]
    held = [as_benchmark_object(one) for one in made]
    return [(one, layered(one, tool) if hidden else tool, pose) for one, tool in zip(made, held, strict=True)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2, help="of the noise")
    parser.add_argument("--first-seed", type=int, default=DEVELOPMENT_SEEDS[0], help="of the noise")
    parser.add_argument("--random", type=int, default=24, help="how many random objects")
    parser.add_argument("--first-object", type=int, default=600, help="seed of the first of them; tuned on below 1000")
    parser.add_argument("--layered", action="store_true", help="random objects alone, with two layers in a part")
    parser.add_argument("--densities", choices=("given", "any", "hollow"), default="given", help="of random objects")
    arguments = parser.parse_args()
    seeds = list(range(arguments.first_seed, arguments.first_seed + arguments.seeds))
    if not arguments.layered and arguments.densities == "given":
        console.print(compare(tools(), seeds, "workshop tools"))
    if arguments.random:
        cases = random_objects(arguments.first_object, arguments.random, arguments.layered, arguments.densities)
        console.print(compare(cases, seeds, "random objects, layered" if arguments.layered else "random objects"))


if __name__ == "__main__":
    main()
