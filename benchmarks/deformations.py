"""How far solids from clouds are deformed, in the standard deviations that `poise identify --object` expects.

python -m benchmarks.deformations [--objects N] [--first-object SEED] [--noise MM ...]

The affine map from the true volume, centroid and second moments to the found ones, along the true principal axes: three
stretches, from the thinnest axis to the longest, three shears, and three shifts in radii of gyration. Of normal errors
as large as expected, the median of |z| is 0.67, and 5 % of them are beyond 2. The constants were chosen on the tools
and on objects below 1000.
"""

import argparse

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.segmentation_downstream import Case, random_objects, tools
from benchmarks.segmentation_truth import NOISE
from poise.errors import PoiseError
from poise.inertia.bayes.hypotheses import hypotheses_for_shape
from poise.inertia.bayes.mass_model import N_DEFORMATIONS, MassModel
from poise.inertia.model import NoiseLevels
from poise.inertia.model.object_shape import shape_of_cloud
from poise.inertia.model.parameters import pseudo_inertia
from poise.inertia.model.parts import Parts
from poise.shape.segmentation import segment
from poise.types import Array

_KINDS = {"thinnest": [0], "middle": [3], "longest": [5], "shears": [1, 2, 4], "shifts": [6, 7, 8]}
"""Rows of the generators of `poise.inertia.bayes.mass_model`."""
console = Console(width=140)


def deformation(case: Case, extra: float) -> tuple[Array, Array, float]:
    """(9,) found, (9,) standard deviations that were expected, and the found volume over the true one.

    Args:
        case: an object, its truth, and where it is held.
        extra: m, noise along each axis that is added to its cloud.

    Raises:
        PoiseError: the cloud is refused.
    """
    subject, tool, pose = case
    rng = np.random.default_rng([7000, round(1e6 * extra), *subject.name.encode()])
    found = segment(subject.points + extra * rng.normal(size=subject.points.shape), subject.colours)
    shape = shape_of_cloud(found)
    true = Parts(tool.unit_parts, tool.part_volumes, tool.hull).whole
    held = shape.parts.in_frame(pose[:3, :3], pose[:3, 3]).whole
    model = MassModel.of_parts(true.unit_phi, true.volumes)
    prior = hypotheses_for_shape(model, shape.accuracy, 0.0, NoiseLevels())
    expected = prior.state_variances[prior.as_stated & ~prior.uneven][0, -N_DEFORMATIONS:]
    found_phi = np.linalg.solve(model.to_sensor, held.unit_phi[:, 0])
    return coordinates(found_phi), np.sqrt(expected), float(held.volumes[0] / true.volumes[0])


def coordinates(phi: Array) -> Array:
    """(9,) state of `MassModel` that deforms the true body into one of 1 kg with phi (10,), in its normalised frame."""
    moments = pseudo_inertia(phi)
    shift = moments[:3, 3]
    squares, axes = np.linalg.eigh(moments[:3, :3] - np.outer(shift, shift))
    stretch = (axes * np.sqrt(squares)) @ axes.T
    xy, xz, yz = np.sqrt(2) * stretch[[0, 0, 1], [1, 2, 2]]
    xx, yy, zz = np.diag(stretch) - 1
    return np.array([xx, xy, xz, yy, yz, zz, *shift])


def table(cases: list[Case], extra: float, title: str) -> Table:
    """A row for each kind of deformation."""
    offs, expected, volumes = [], [], []
    for case in cases:
        try:
            off, sigma, volume = deformation(case, extra)
        except PoiseError:
            continue
        offs.append(off)
        expected.append(sigma)
        volumes.append(volume)
    off, sigma, ratios = np.array(offs), np.array(expected), np.array(volumes)
    words = f"{title}: {len(ratios)} of {len(cases)} clouds; volume {np.median(ratios):.3f}"
    made = Table(title=f"{words}, off by {100 * np.median(np.abs(ratios - 1)):.1f} %", title_justify="left")
    for heading in ("deformation", "bias %", "off, median %", "expected, 1 sigma %", "median |z|", "beyond 2"):
        made.add_column(heading, justify="left" if heading == "deformation" else "right")
    for name, rows in _KINDS.items():
        own, score = off[:, rows], np.abs(off[:, rows] / sigma[:, rows])
        made.add_row(
            name,
            f"{100 * np.median(own):+.2f}",
            f"{100 * np.median(np.abs(own)):.2f}",
            f"{100 * np.median(sigma[:, rows]):.2f}",
            f"{np.median(score):.2f}",
            f"{np.mean(score > 2):.2f}",
        )
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", type=int, default=48, help="how many random objects")
    parser.add_argument("--first-object", type=int, default=600, help="seed of the first of them; tuned on below 1000")
    parser.add_argument("--noise", nargs="+", type=float, default=[0.3, 1.0], help="mm along each axis")
    arguments = parser.parse_args()
    sets = {"tools": tools(), "random objects": random_objects(arguments.first_object, arguments.objects)}
    for noise in arguments.noise:
        for name, cases in sets.items():
            own = NOISE if name == "random objects" else 0.0  # what the cloud has already
            extra = np.sqrt(max((1e-3 * noise) ** 2 - own**2, 0.0))
            console.print(table(cases, float(extra), f"{name}, {noise:g} mm"))


if __name__ == "__main__":
    main()
