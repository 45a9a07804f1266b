"""The Rerun scene of an assembly: bodies, contact interface graph, map of robustness, mechanisms, cone of limits."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import LogNorm

from poise.assembly import Analysis, Push
from poise.assembly.robustness import AccelerationLimits, Robustness, RobustnessMap
from poise.errors import ErrorCode, InputError
from poise.files import write_whole
from poise.viewing.assembly_picture import extent, unconfirmed
from poise.viewing.wording import readable

FIXED, MOVABLE, GRAPH = (200, 204, 210), (150, 170, 200, 120), (213, 94, 1)
PUSH, MOTION, ENDLESS = (179, 38, 30), (27, 31, 36), (158, 163, 171)
_POINT = 0.006
"""Radius of the points of a map, as a share of the scene."""


def write_assembly_recording(
    path: Path,
    analysis: Analysis,
    pushes: Sequence[Push] = (),
    results: Sequence[Robustness] = (),
    found_map: RobustnessMap | None = None,
    limits: AccelerationLimits | None = None,
) -> Path:
    """Write a Rerun recording (.rrd); open it with `rerun FILE`.

    Entities: `world/bodies/ID`; `world/graph` with the places of contact; `world/map`, points coloured from weak (red)
    to strong (blue), with their robustness as labels of the weakest, and dark dots on doubtful points; `world/pushes`
    and `world/mechanism` with one step of the timeline `push` for each push; `limits` with the sustained accelerations
    (m/s2) in each direction, red where doubtful.

    Raises:
        InputError: UNSUPPORTED when rerun-sdk is not installed, FILE_UNWRITABLE.
    """
    try:
        import rerun as rr
    except ImportError as error:
        raise InputError(
            ErrorCode.UNSUPPORTED, "a Rerun recording needs rerun-sdk: pip install 'poise[viewer]'"
        ) from error
    recording = rr.RecordingStream("poise_assembly")
    memory = rr.memory_recording(recording)
    scene = _Scene(rr, recording, analysis)
    scene.send_bodies()
    scene.send_graph()
    if found_map is not None:
        scene.send_map(found_map)
    scene.send_pushes(pushes, results)
    if limits is not None:
        scene.send_limits(limits)
    return write_whole(path, memory.drain_as_bytes())


class _Scene:
    """What is sent where."""

    def __init__(self, rr: Any, recording: Any, analysis: Analysis) -> None:
        self.rr = rr
        self.recording = recording
        self.analysis = analysis
        self.size = extent(analysis)
        self._log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def send_bodies(self) -> None:
        for item in self.analysis.assembly.objects:
            polyhedron = item.shape.polyhedron
            corners = item.vertices[polyhedron.triangles].reshape(-1, 3)
            normals = (polyhedron.normals @ item.pose.rotation.T)[polyhedron.facet_of_triangle].repeat(3, axis=0)
            mesh = self.rr.Mesh3D(
                vertex_positions=corners,
                vertex_normals=normals,
                triangle_indices=np.arange(len(corners)).reshape(-1, 3),
                albedo_factor=FIXED if item.fixed else MOVABLE,
            )
            self._log(f"world/bodies/{_part(item.id)}", mesh, static=True)

    def send_graph(self) -> None:
        objects = self.analysis.assembly.objects
        lines, outlines = [], []
        for interface in self.analysis.structure.interfaces:
            middle = interface.points.mean(axis=0)
            outlines.append(np.concatenate([interface.points, interface.points[:1]]))
            sides = (objects[place] for place in (interface.first, interface.second))
            lines += [np.stack([item.com_in_world, middle]) for item in sides if not item.fixed]
        radius = 0.002 * self.size
        self._log("world/graph/edges", self.rr.LineStrips3D(lines, colors=[GRAPH], radii=[radius]), static=True)
        self._log("world/graph/contacts", self.rr.LineStrips3D(outlines, colors=[GRAPH], radii=[radius]), static=True)
        movable = [objects[place] for place in self.analysis.structure.movable]
        nodes = self.rr.Points3D(
            [item.com_in_world for item in movable],
            labels=[readable(item.id) for item in movable],
            colors=[GRAPH],
            radii=[3 * radius],
        )
        self._log("world/graph/bodies", nodes, static=True)

    def send_map(self, found: RobustnessMap) -> None:
        doubtful = unconfirmed(found)
        borne = np.where(doubtful, found.lower, found.upper)
        finite, positive = np.isfinite(borne), np.isfinite(borne) & (borne > 0)
        colours = np.tile(np.array(ENDLESS, dtype=np.uint8), (len(finite), 1))
        if finite.any():
            low, high = (borne[positive].min(), np.quantile(borne[positive], 0.97)) if positive.any() else (1.0, 1.0)
            shade = colormaps["RdYlBu"](LogNorm(low, max(high, 1.02 * low))(np.maximum(borne[finite], low)))
            colours[finite] = (255 * shade[:, :3]).astype(np.uint8)
        points = self.rr.Points3D(found.surface.points, colors=colours, radii=[_POINT * self.size])
        self._log("world/map/points", points, static=True)
        radius = _POINT * self.size
        # On top of the points of the map, where they are seen.
        above = found.surface.points[doubtful] - radius * found.surface.directions[doubtful]
        self._log("world/map/doubtful", self.rr.Points3D(above, colors=[MOTION], radii=[radius / 3]), static=True)
        weakest = int(borne.argmin())
        label = self.rr.Points3D(
            found.surface.points[[weakest]],
            labels=[f"{borne[weakest]:.3g} N{' (doubtful)' * bool(doubtful[weakest])}"],
            colors=[PUSH],
            radii=[2 * _POINT * self.size],
        )
        self._log("world/map/weakest", label, static=True)

    def send_pushes(self, pushes: Sequence[Push], results: Sequence[Robustness]) -> None:
        for number, (push, result) in enumerate(zip(pushes, results, strict=True)):
            self.recording.set_time("push", sequence=number)
            direction = np.asarray(push.direction, dtype=np.float64)
            shaft = 0.2 * self.size * direction / np.linalg.norm(direction)
            arrow = self.rr.Arrows3D(
                origins=[np.asarray(push.point) - shaft],
                vectors=[shaft],
                colors=[PUSH],
                labels=[f"{result.robustness:.3g} N {result.mode}{' (doubtful)' * result.doubtful}"],
            )
            self._log("world/pushes", arrow)
            objects = self.analysis.assembly.objects
            starts = [objects[self.analysis.assembly.index[name]].com_in_world for name in result.moves]
            velocities = result.mechanism[:, :3]
            fastest = max(np.linalg.norm(velocities, axis=1), default=0.0) or 1.0
            moves = self.rr.Arrows3D(
                origins=starts,
                vectors=0.2 * self.size * velocities / fastest,
                colors=[MOTION],
                labels=[readable(name) for name in result.moves],
            )
            self._log("world/mechanism", moves)

    def send_limits(self, limits: AccelerationLimits) -> None:
        """The boundary of what is sustained, along the directions asked for."""
        kept = np.isfinite(limits.limits)
        ends = limits.directions[kept] * limits.limits[kept, None]
        movers = [readable(", ".join(limits.first_to_move[row])) for row in np.flatnonzero(kept)]
        doubtful = limits.doubtful[kept]
        names = [f"{name}{' (doubtful)' * bool(doubt)}" for name, doubt in zip(movers, doubtful, strict=True)]
        arrows = self.rr.Arrows3D(
            origins=np.zeros_like(ends),
            vectors=ends,
            colors=[PUSH if doubt else GRAPH for doubt in doubtful],
            labels=names,
            show_labels=False,
        )
        self._log("limits", arrows, static=True)

    def _log(self, path: str, archetype: Any, static: bool = False) -> None:
        self.rr.log(path, archetype, static=static, recording=self.recording, strict=True)


def _part(name: str) -> str:
    """An id as a part of an entity path: slashes would make two parts of it."""
    return readable(name).replace("/", "_")
