"""A mesh of tens of thousands of vertices, from its file to the robustness of a push: processor time of this process.

`python benchmarks/big_meshes.py`: a ball with a flat to stand on. Text of OBJ is read in another process, whose time is
given beside it. With `--place`, meshes of thousands of facets are placed on a tray instead.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import trimesh

from poise.assembly import Analysis, Mesh, Push, RigidObject, assess, load_scene
from poise.geometry import Pose
from poise.placement import plan_placement
from poise.shape.mesh_formats import MESH_READERS
from poise.types import Array, Indices

RADIUS, HEIGHT = 0.1, 0.09
SCENE = """
gravity: [0, 0, -9.81]
friction: 0.5
objects:
  - {{id: floor, fixed: true, box: [2, 2, 0.1], pose: [0, 0, -0.05, 0, 0, 0, 1]}}
  - {{id: ball, mesh: {mesh}, mass: 1, com: [0, 0, 0], pose: [0, 0, {height}, 0, 0, 0, 1]}}
"""


def ball_with_flat(vertices: int) -> tuple[Array, Indices]:
    """About so many vertices (V, 3) m around the centre, and triangles (T, 3); what is below the flat lies on it."""
    rings = round(np.sqrt(vertices / 2))
    around = 2 * rings
    polar = np.linspace(0, np.pi, rings + 2)[1:-1, None]
    turn = 2 * np.pi * np.arange(around) / around
    points = np.stack(np.broadcast_arrays(np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)), 2)
    points = RADIUS * np.concatenate([[[0, 0, 1]], points.reshape(-1, 3), [[0, 0, -1]]])
    points[:, 2] = np.maximum(points[:, 2], -HEIGHT)
    here = np.arange(around)
    after, last = (here + 1) % around, 1 + (rings - 1) * around
    top = np.stack([np.zeros_like(here), 1 + here, 1 + after], axis=1)
    bottom = np.stack([np.full_like(here, len(points) - 1), last + after, last + here], axis=1)
    starts = 1 + around * np.arange(rings - 1)[:, None]
    a, b, c, d = ((starts + k).ravel() for k in (here[None], after[None], around + here[None], around + after[None]))
    sides = [np.stack(corners, axis=1) for corners in ((a, c, d), (a, d, b))]
    return points, np.concatenate([top, bottom, *sides])


def content(points: Array, triangles: Indices, suffix: str) -> bytes:
    """A mesh as the bytes of a file: binary STL, binary PLY, or OBJ."""
    written = trimesh.Trimesh(points, triangles, process=False).export(file_type=suffix[1:])
    return written.encode() if isinstance(written, str) else written


def answered(folder: Path, suffix: str) -> float:
    """N, what a level push at the centre of the ball takes."""
    scene = folder / f"{suffix[1:]}.yaml"
    scene.write_text(SCENE.format(mesh=f"ball{suffix}", height=HEIGHT), encoding="utf-8")
    analysis = Analysis.of(load_scene(scene))
    return assess(analysis, [Push("ball", (-RADIUS, 0, HEIGHT), (1, 0, 0))]).results[0].robustness


def scanned() -> dict[str, RigidObject]:
    """A rough ball, a tube, and a box with rough faces, of 3,000 to 6,400 triangles."""
    rng, ball = np.random.default_rng(1), trimesh.creation.icosphere(4, radius=0.05)
    ball.vertices *= np.array([1, 0.8, 0.6]) * (1 + 0.02 * rng.normal(size=(len(ball.vertices), 1)))
    box = trimesh.creation.box((0.1, 0.08, 0.06))
    for _ in range(4):
        box = box.subdivide()
    box.vertices += 2e-5 * rng.normal(size=box.vertices.shape)
    meshes = {"ball": ball, "tube": trimesh.creation.annulus(0.03, 0.04, 0.1, sections=800), "box": box}
    return {
        name: RigidObject(name, Mesh(mesh.vertices, mesh.faces.astype(np.int64)), Pose.identity(), mass=0.5)
        for name, mesh in meshes.items()
    }


def place(runs: int) -> None:
    """Place each of the meshes on the tray of the pages."""
    tray = load_scene(Path(__file__).parents[1] / "docs" / "scenes" / "tray.yaml")
    for name, item in scanned().items():
        times = []
        for seed in range(runs):
            start = time.process_time()
            plan_placement(tray, item, seed=seed)
            times.append(time.process_time() - start)
        print(f"{name} of {len(item.shape.polyhedron.triangles)}: placed in {min(times):.2f} to {max(times):.2f} s")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vertices", type=int, default=41_000)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--place", action="store_true", help="place meshes on a tray")
    given = parser.parse_args()
    if given.place:
        place(given.runs)
        return
    mesh = ball_with_flat(given.vertices)
    with tempfile.TemporaryDirectory() as name:
        for suffix in (".stl", ".ply", ".obj"):
            written = content(*mesh, suffix)
            (Path(name) / f"ball{suffix}").write_bytes(written)
            times, reading, found = [], [], 0.0
            for _ in range(given.runs):
                start = time.process_time()
                found = answered(Path(name), suffix)
                middle = time.process_time()
                MESH_READERS[suffix](written, suffix)
                times.append(middle - start)
                reading.append(time.process_time() - middle)
            print(f"{suffix} {len(mesh[0])} vertices: {min(times):.2f} s, read in {min(reading):.2f} s; {found:.3f} N")


if __name__ == "__main__":
    main()
