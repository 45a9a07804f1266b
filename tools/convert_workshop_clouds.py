"""Condense the clouds and meshes of the Workshop Tools Dataset into benchmarks/data/workshop_clouds.npz.

Usage: python tools/convert_workshop_clouds.py FOLDER, where FOLDER holds one folder per tool, as the dataset does.
Per tool: `points` (N, 3) m, `colours` (N, 3) bytes, `labels` (N,) true parts; `vertices` and `triangles` of the true
outer surface (shells united, simplified to 0.1 mm), and its `volume` in m3.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from manifold3d import Manifold
from manifold3d import Mesh as ManifoldMesh
from numpy.typing import NDArray

from poise.shape.clouds import read_cloud
from poise.shape.meshes import read_mesh

TARGET = Path(__file__).resolve().parents[1] / "benchmarks" / "data" / "workshop_clouds.npz"
TOLERANCE = 1e-4  # m


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--output", type=Path, default=TARGET)
    arguments = parser.parse_args()
    arrays = convert_all(arguments.folder)
    unfinished = arguments.output.with_suffix(".partial.npz")
    np.savez_compressed(unfinished, **arrays)
    unfinished.replace(arguments.output)
    print(f"{arguments.output}: {arguments.output.stat().st_size / 1e6:.1f} MB")


def convert_all(folder: Path) -> dict[str, NDArray[Any]]:
    """The arrays of every tool below a folder, by `tool/array`."""
    arrays: dict[str, NDArray[Any]] = {}
    for path in sorted(folder.glob("*/point-cloud.ply")):
        arrays |= {f"{path.parent.name}/{key}": value for key, value in convert(path.parent).items()}
        print(path.parent.name, len(arrays[f"{path.parent.name}/triangles"]), "triangles")
    if not arrays:
        sys.exit(f"{folder}: no */point-cloud.ply below it; give the folder that holds one folder per tool")
    return arrays


def convert(folder: Path) -> dict[str, NDArray[Any]]:
    """All arrays of one tool, in metres."""
    cloud = read_cloud(folder / "point-cloud.ply")
    text = (folder / "point-cloud.ply").read_text().partition("end_header\n")[2]
    labels = np.array([int(line.split()[6]) for line in text.splitlines() if line.strip()])
    if cloud.colours is None or len(labels) != len(cloud.points):
        sys.exit(f"{folder}: the cloud has no colours, or not one label per point")
    mesh = read_mesh("mesh.ply", folder, scale=1e-3)
    body = Manifold(ManifoldMesh(mesh.vertices.astype(np.float32), mesh.triangles.astype(np.uint32)))
    simple = body.simplify(TOLERANCE).to_mesh()
    vertices, triangles = np.asarray(simple.vert_properties[:, :3]), np.asarray(simple.tri_verts)
    if body.is_empty():
        vertices, triangles = mesh.vertices, mesh.triangles
    volume = np.linalg.det(mesh.vertices[mesh.triangles]).sum() / 6
    return {
        "points": cloud.points.astype(np.float32),
        "colours": np.round(255 * cloud.colours).astype(np.uint8),
        "labels": labels.astype(np.uint8),
        "vertices": vertices.astype(np.float32),
        "triangles": triangles.astype(np.uint16 if len(vertices) < 65536 else np.uint32),
        "volume": np.array(volume),
    }


if __name__ == "__main__":
    main()
