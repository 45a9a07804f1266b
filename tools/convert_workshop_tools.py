"""Condense the Workshop Tools Dataset (meshes, clouds, motions) into benchmarks/data/workshop_tools.npz.

Usage: python tools/convert_workshop_tools.py FOLDER, where FOLDER holds one folder per tool, as the dataset does.
Needs trimesh. What the arrays are is said in benchmarks/identification/objects.py, which reads them.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree
from scipy.spatial.transform import Rotation

from poise.inertia.model import InertialParameters, phi_of_pseudo_inertia
from poise.types import Array

TARGET = Path(__file__).resolve().parents[1] / "benchmarks" / "data" / "workshop_tools.npz"
VOXELS = 400_000
OBLIQUE = (0.5, 0.2, 0.3)  # rad
KEPT_POINTS = 2000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--output", type=Path, default=TARGET)
    arguments = parser.parse_args()
    unfinished = arguments.output.with_suffix(".partial.npz")
    np.savez_compressed(unfinished, **convert_all(arguments.folder))
    unfinished.replace(arguments.output)
    print(f"{arguments.output}: {arguments.output.stat().st_size / 1e6:.1f} MB")


def convert_all(folder: Path) -> dict[str, NDArray[Any]]:
    """The arrays of every tool below a folder, by `tool/array`; prints a line for each tool."""
    arrays: dict[str, NDArray[Any]] = {}
    for path in sorted(folder.glob("*/Inertia.yaml")):
        tool = convert(path.parent)
        arrays |= {f"{path.parent.name}/{key}": value for key, value in tool.items()}
        print(path.parent.name, report(tool))
    if not arrays:
        sys.exit(f"{folder}: no */Inertia.yaml below it; give the folder that holds one folder per tool")
    return arrays


def convert(folder: Path) -> dict[str, NDArray[Any]]:
    """All arrays of one tool, in metres, kilograms and seconds, in the frame of its mesh unless named otherwise."""
    facts = yaml.safe_load((folder / "Inertia.yaml").read_text())["OBJECT"]
    truth = InertialParameters(facts["MASS"], np.array(facts["COM_WRT_MESH"]), np.array(facts["INERTIA_WRT_COM"]))
    mesh = trimesh.load(folder / "mesh.ply", process=False)
    triangles = np.asarray(mesh.triangles, dtype=np.float64) * 1e-3  # the meshes are in millimetres
    cloud, labels = read_cloud(folder / "point-cloud.ply")
    voxels, volumes = voxelise(triangles)
    voxel_labels = labels[cKDTree(cloud).query(voxels)[1]]
    hull = triangles.reshape(-1, 3)
    kept = np.random.default_rng(0).choice(len(voxels), KEPT_POINTS, p=volumes / volumes.sum(), replace=False)
    return {
        "phi": truth.phi,
        **parts(triangles, voxels, volumes, voxel_labels),
        "hull": np.unique(hull[ConvexHull(hull).vertices], axis=0),
        "points": voxels[kept].astype(np.float32),
        "point_parts": voxel_labels[kept].astype(np.uint8),
        **stop_and_go(folder / "stop_and_go_kinematics.npz"),
    }


def read_cloud(path: Path) -> tuple[Array, NDArray[np.int64]]:
    """(N, 3) m and (N,) part labels from 0 without gaps."""
    cloud = trimesh.load(path, process=False)
    columns = (cloud.metadata.get("_ply_raw") or cloud.metadata["ply_raw"])["vertex"]["data"]
    points = np.stack([np.ravel(columns[axis]) for axis in "xyz"], axis=1).astype(np.float64)
    return points, np.unique(np.ravel(columns["segmentation"]), return_inverse=True)[1]


def voxelise(triangles: Array) -> tuple[Array, Array]:
    """(V, 3) centres and (V,) volumes of little columns that fill a closed surface.

    Lines on a grid, roughly along the shortest side of the object, are cut where they cross the surface. What has a
    positive winding number is inside: shells that overlap count once, hollows (shells turned inside out) not at all.
    The lines are oblique, for a wall along them would be in or out as a whole by chance (0.2 mm in the centroid).
    """
    turn = (
        Rotation.from_euler("zxy", OBLIQUE).as_matrix()
        @ np.eye(3)[np.argsort(-np.ptp(triangles.reshape(-1, 3), axis=0))]
    )
    turned = triangles @ turn.T
    step = float(np.cbrt(volume_of(triangles) / VOXELS))
    low, high = turned.reshape(-1, 3).min(axis=0), turned.reshape(-1, 3).max(axis=0)
    grid = [np.arange(low[axis] + 0.5 * step, high[axis], step) for axis in range(2)]
    crossings = np.concatenate([found for found in (cross(triangle, grid) for triangle in turned) if len(found)])
    crossings[:, 3] *= np.linalg.det(turn)  # a permutation of axes may turn the normals over
    crossings = without_cracks(crossings[np.lexsort((crossings[:, 2], crossings[:, 1], crossings[:, 0]))])
    winding = np.cumsum(crossings[:, 3])  # back at zero after each line
    inside = np.flatnonzero(winding[:-1] > 0)
    start, length = crossings[inside], crossings[inside + 1, 2] - crossings[inside, 2]
    count = np.maximum(1, np.round(length / step)).astype(int)
    rows = np.repeat(np.arange(len(inside)), count)
    place = np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count) + 0.5
    piece = (length / count)[rows]
    column, line = start[rows, 0].astype(int), start[rows, 1].astype(int)
    centres = np.stack([grid[0][column], grid[1][line], start[rows, 2] + place * piece], axis=1)
    return centres @ turn, piece * step**2


def without_cracks(crossings: Array) -> Array:
    """Leave out the lines whose entries into and exits from the object differ in number: they met an edge."""
    line = np.unique(crossings[:, :2], axis=0, return_inverse=True)[1]
    closed = np.bincount(line, crossings[:, 3]) == 0
    if np.mean(closed) < 0.99:
        sys.exit(
            f"{np.sum(~closed)} of {len(closed)} lines leave the object more or less often than they enter it: the "
            "mesh is not closed"
        )
    return crossings[closed[line]]


def cross(triangle: Array, grid: list[Array]) -> Array:
    """(n, 4) where grid lines cross a triangle: column, row, height, and +1 where a line enters, -1 where it leaves."""
    ranges = [
        np.arange(*np.searchsorted(grid[axis], [triangle[:, axis].min(), triangle[:, axis].max()])) for axis in range(2)
    ]
    (x0, y0, _), (x1, y1, _), (x2, y2, _) = triangle
    area = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
    if not len(ranges[0]) or not len(ranges[1]) or abs(area) < 1e-18:
        return np.zeros((0, 4))
    column, row = (index.ravel() for index in np.meshgrid(*ranges, indexing="ij"))
    x, y = grid[0][column] - x0, grid[1][row] - y0
    u, v = (x * (y2 - y0) - y * (x2 - x0)) / area, ((x1 - x0) * y - (y1 - y0) * x) / area
    hit = (u >= 0) & (v >= 0) & (u + v <= 1)
    height = triangle[0, 2] + u * (triangle[1, 2] - triangle[0, 2]) + v * (triangle[2, 2] - triangle[0, 2])
    # An outward normal that points down (negative area from above) is where the line, going up, enters.
    return np.stack([column, row, height, np.full(len(column), -np.sign(area))], axis=1)[hit]


def parts(triangles: Array, voxels: Array, volumes: Array, labels: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
    """`unit_parts` (10, K), phi of each part at 1 kg, and `volumes` (K,)."""
    if labels.max() == 0:  # one part: the integrals over the mesh are exact, which a ruler 1 mm thick needs
        return {
            "unit_parts": (phi_of_mesh(triangles) / volume_of(triangles))[:, None],
            "volumes": np.array([volume_of(triangles)]),
        }
    columns = []
    for label in range(labels.max() + 1):
        mine = labels == label
        weights = volumes[mine] / volumes[mine].sum()
        columns.append(phi_of_points(voxels[mine], weights))
    return {"unit_parts": np.stack(columns, axis=1), "volumes": np.bincount(labels, volumes)}


def phi_of_points(points: Array, masses: Array) -> Array:
    """(10,) of point masses (thesis eq. 3.9)."""
    homogeneous = np.column_stack([points, np.ones(len(points))])
    return phi_of_pseudo_inertia((homogeneous * masses[:, None]).T @ homogeneous)


def phi_of_mesh(triangles: Array) -> Array:
    """(10,) of a closed surface filled with density 1: the signed tetrahedra between its triangles and the origin.

    The second moment of a tetrahedron with one corner at the origin is V/20 (sum v v^T + s s^T), s the sum of v.
    """
    volumes = np.linalg.det(triangles) / 6
    total = triangles.sum(axis=1)
    second = np.einsum("t,tki,tkj->ij", volumes, triangles, triangles) + np.einsum("t,ti,tj->ij", volumes, total, total)
    moments = np.zeros((4, 4))
    moments[:3, :3] = second / 20
    moments[:3, 3] = moments[3, :3] = volumes @ total / 4
    moments[3, 3] = volumes.sum()
    return phi_of_pseudo_inertia(moments)


def volume_of(triangles: Array) -> float:
    """m3, overlapping shells counted once per shell."""
    return float(np.sum(np.linalg.det(triangles)) / 6)


def stop_and_go(path: Path) -> dict[str, NDArray[Any]]:
    """The motion of thesis fig. 3.11: sensor attitude, and velocity and accelerations turned into sensor axes.

    In the dataset twist and acceleration are (linear, angular) in WORLD axes: with that, and not otherwise, they are
    the derivatives of the poses, which is checked here.
    """
    with np.load(path, allow_pickle=False) as file:
        time, sensor, tool = file["t"], file["sensor_pose"], file["object_pose"]
        twist, acceleration = file["sensor_twist"], file["sensor_accel"]
    rotation = sensor[:, :3, :3]
    check("twist is the derivative of the pose", np.gradient(sensor[:, :3, 3], time, axis=0), twist[:, :3])
    check("acceleration is the derivative of the twist", np.gradient(twist, time, axis=0), acceleration)
    turns = (
        Rotation.from_matrix(rotation[2:] @ rotation[:-2].swapaxes(1, 2)).as_rotvec() / (time[2:] - time[:-2])[:, None]
    )
    check("angular velocity turns the sensor", turns, twist[1:-1, 3:])
    into_sensor = lambda vectors: np.einsum("nji,nj->ni", rotation, vectors).astype(np.float32)  # noqa: E731
    return {
        "pose_in_sensor": np.linalg.inv(sensor[0]) @ tool[0],
        "time": time.astype(np.float32),
        "quaternion_world_sensor": Rotation.from_matrix(rotation).as_quat().astype(np.float32),
        "angular_velocity": into_sensor(twist[:, 3:]),
        "angular_acceleration": into_sensor(acceleration[:, 3:]),
        "linear_acceleration": into_sensor(acceleration[:, :3]),
    }


def check(claim: str, derivative: Array, value: Array) -> None:
    worst = np.abs(derivative - value)[3:-3].max()
    if worst > 0.02 * np.abs(value).max():
        sys.exit(f"the frames are not what was thought: {claim} fails by {worst:.3g}")


def report(tool: dict[str, NDArray[Any]]) -> str:
    """How well a homogeneous body fits the true parameters: a wrong frame or scale shows here."""
    truth = InertialParameters.from_phi(tool["phi"])
    homogeneous = InertialParameters.from_phi(tool["unit_parts"] @ tool["volumes"] / tool["volumes"].sum() * truth.mass)
    box = np.ptp(tool["hull"], axis=0)
    return (
        f"{len(tool['volumes'])} parts, {tool['volumes'].sum() * 1e6:.1f} cm3, {truth.mass / tool['volumes'].sum():.0f}"
        f" kg/m3, centroid off by {1e3 * np.linalg.norm(homogeneous.com - truth.com):.2f} mm of"
        f" {1e3 * np.linalg.norm(box):.0f} mm"
    )


if __name__ == "__main__":
    main()
