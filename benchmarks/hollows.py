"""Cups and boxes upside down, and solids of the same outside: volumes stated, and what identification makes of them.

python -m benchmarks.hollows [--seeds N]
The cloud is as of a scan whose views did not see the underside. Identification has the solid in pieces (columns -), or
the same with the space that may be hollow as one more part, whose mass may be zero (columns +).
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import trimesh
from manifold3d import Manifold
from rich.console import Console
from rich.table import Table

from benchmarks.closed_shapes import ClosedShape, of_manifold
from benchmarks.identification.objects import BenchmarkObject, load_tools
from benchmarks.identification.scenarios import Scenario, make_trial
from poise.inertia.bayes.estimator import PoiseEstimator
from poise.inertia.model.metrics import errors
from poise.inertia.model.object_shape import ObjectShape, shape_of_cloud
from poise.inertia.model.parameters import InertialParameters
from poise.inertia.model.parts import Parts, surface_moments
from poise.shape.segmentation import Segmentation, segment
from poise.types import Array

SCENARIOS = Scenario("stop-and-go"), Scenario("wrist", speed=1.0)
_DENSITY, _POINTS, _NOISE = 1200.0, 9000, 3e-4
_GRIP = np.array([0.0, 0.0, 0.08])


def shapes() -> Iterator[tuple[str, ClosedShape, ClosedShape]]:
    """Name, the shape, and its outside: walls of 2 and 4 mm, open below, and none."""
    cup, box = Manifold.cylinder(0.09, 0.04, 0.034, 72), Manifold.cube((0.1, 0.07, 0.06))
    for wall in (0.002, 0.004):
        inner = Manifold.cylinder(0.09 - wall, 0.04 - wall, 0.034 - wall, 72)
        yield f"cup, walls of {1e3 * wall:.0f} mm", of_manifold("cup", cup - inner), of_manifold("cup", cup)
        inner = Manifold.cube((0.1 - 2 * wall, 0.07 - 2 * wall, 0.06 - wall)).translate((wall, wall, 0.0))
        yield f"box, walls of {1e3 * wall:.0f} mm", of_manifold("box", box - inner), of_manifold("box", box)
    for name, body in (("solid cone", cup), ("solid box", box)):
        yield name, of_manifold(name, body), of_manifold(name, body)


def scanned(outside: ClosedShape) -> Segmentation:
    """Its solid, from a cloud whose underside was completed."""
    mesh = trimesh.Trimesh(outside.vertices, outside.triangles)
    points, face = trimesh.sample.sample_surface(mesh, _POINTS, seed=0)
    points = np.asarray(points) + np.random.default_rng(0).normal(scale=_NOISE, size=(_POINTS, 3))
    normals = np.asarray(mesh.face_normals)[face]
    seen = normals[:, 2] > -0.9
    return segment(points, normals=normals, seen=seen, doubt=np.where(seen, 0.0, 5e-4))


def without_hollow(found: Segmentation) -> ObjectShape:
    """As if all of it had been seen."""
    return shape_of_cloud(replace(found, hollow=None))


def identified(true: ClosedShape, shape: ObjectShape, scenario: Scenario, seed: int) -> tuple[float, float]:
    """Error of the inertia, %, and the largest error of centre and inertia in stated sigmas."""
    whole = Parts.from_moments(surface_moments(true.vertices[true.triangles])[None], [0], true.vertices)
    held, tool = whole.in_frame(np.eye(3), _GRIP), load_tools()[seed]
    truth = InertialParameters.from_phi(held.unit_phi[:, 0] * _DENSITY * true.volume)
    hull: Array = true.vertices + _GRIP
    size = np.ptp(hull, axis=0)
    made = BenchmarkObject(true.name, truth, size, hull, held.unit_phi, held.volumes, hull, tool.stop_and_go)
    problem = make_trial(made, scenario, seed).problem
    estimator = PoiseEstimator(shape.parts.in_frame(np.eye(3), _GRIP), problem.noise, shape_accuracy=shape.accuracy)
    estimator.add_problem(problem)
    answer = estimator.solve()
    off = (answer.parameters.phi - truth.phi)[1:] / np.sqrt(np.diag(answer.covariance))[1:]
    return errors(answer.parameters, truth, size).inertia, float(np.abs(off).max())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=4, help="of motion and noise, development ones from 0 on")
    seeds = range(parser.parse_args().seeds)
    table = Table(title="what may be hollow: e_I %, and worst error in stated sigmas")
    for heading in ("shape", "cm3", "stated", "if hollow", *(f"{s.name}: {w}" for s in SCENARIOS for w in ("-", "+"))):
        table.add_column(heading, justify="right")
    for name, true, outside in shapes():
        found = scanned(outside)
        row = [name, f"{1e6 * true.volume:.0f}", f"{1e6 * found.solid.volume:.0f} ± {1e6 * found.solid.volume_std:.0f}"]
        row.append("-" if found.volume_if_hollow is None else f"{1e6 * found.volume_if_hollow:.0f}")
        for scenario in SCENARIOS:
            for shape in (without_hollow(found), shape_of_cloud(found)):
                off = np.array([identified(true, shape, scenario, seed) for seed in seeds])
                row.append(f"{off[:, 0].mean():.1f}; {off[:, 1].max():.1f}")
        table.add_row(*row)
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
