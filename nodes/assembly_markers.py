"""RViz markers of an assembly: objects, contact interface graph, robustness map, collapse mechanism."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from poise.assembly import Analysis, Box, Cylinder, RigidObject, Sphere
from poise.assembly.robustness import Robustness, RobustnessMap
from poise.nodes.assembly_message import pose_message

_FIXED, _MOVABLE = (0.45, 0.47, 0.5, 0.9), (0.65, 0.75, 0.9, 0.55)
_GRAPH, _MECHANISM, _ENDLESS = (0.1, 0.1, 0.1, 1.0), (0.85, 0.1, 0.1, 1.0), (0.6, 0.6, 0.6, 1.0)
# Weak to strong, on a logarithmic scale: the same colours as in the pictures (RdYlBu).
_SCALE = np.array([(165, 0, 38), (244, 109, 67), (254, 224, 144), (171, 217, 233), (69, 117, 180), (49, 54, 149)]) / 255
MOST_DRAWN = 20_000
"""Points of a map that are drawn; of a larger one, evenly spread ones."""
_ARROW = 0.15
"""m, of the fastest object of a mechanism."""


def cleared(frame_id: str) -> Marker:
    """Takes away all markers there are."""
    marker = Marker(action=Marker.DELETEALL)
    marker.header.frame_id = frame_id
    return marker


def scene_markers(analysis: Analysis, frame_id: str) -> list[Marker]:
    """All objects with their ids, and the graph: a line from each centre of mass to each place of contact."""
    objects = analysis.assembly.objects
    markers = [_body(item, number, frame_id) for number, item in enumerate(objects)]
    markers += [_label(item, number, frame_id) for number, item in enumerate(objects)]
    lines = _marker("graph", 0, Marker.LINE_LIST, frame_id, _GRAPH, (0.004, 0.0, 0.0))
    outlines = _marker("contacts", 0, Marker.LINE_LIST, frame_id, _GRAPH, (0.003, 0.0, 0.0))
    for interface in analysis.structure.interfaces:
        middle = interface.points.mean(axis=0)
        for place in (interface.first, interface.second):
            if not objects[place].fixed:
                lines.points += [_point(objects[place].com_in_world), _point(middle)]
        for start, end in zip(interface.points, np.roll(interface.points, -1, axis=0), strict=True):
            outlines.points += [_point(start), _point(end)]
    return [*markers, lines, outlines]


def map_markers(found: RobustnessMap, frame_id: str) -> list[Marker]:
    """Points of the surface, coloured from weak (red) to strong (blue); grey where nothing ever moves."""
    marker = _marker("map", 0, Marker.POINTS, frame_id, _ENDLESS, (0.008, 0.008, 0.0))
    drawn = slice(None, None, -(-len(found.upper) // MOST_DRAWN) or 1)
    marker.points = [_point(point) for point in found.surface.points[drawn]]
    upper = found.upper[drawn]
    finite = np.isfinite(upper)
    colours = np.tile(_ENDLESS, (len(upper), 1))
    if finite.any():
        level = np.log(np.maximum(upper[finite], 1e-9))
        span = max(float(np.quantile(level, 0.97) - level.min()), 1e-9)
        share = (level - level.min()) / span * (len(_SCALE) - 1)
        colours[finite, :3] = np.stack([np.interp(share, range(len(_SCALE)), _SCALE[:, c]) for c in range(3)], axis=1)
    marker.colors = [_colour(colour) for colour in colours.tolist()]
    return [marker]


def mechanism_markers(analysis: Analysis, results: Sequence[Robustness], frame_id: str) -> list[Marker]:
    """How the weakest of the pushes moves things: an arrow from the centre of mass of each."""
    weakest = min(results, key=lambda result: result.robustness)
    fastest = max(np.linalg.norm(weakest.mechanism[:, :3], axis=1), default=0.0) or 1.0
    markers = []
    for number, (name, velocity) in enumerate(zip(weakest.moves, weakest.mechanism, strict=True)):
        start = analysis.assembly.objects[analysis.assembly.index[name]].com_in_world
        arrow = _marker("mechanism", number, Marker.ARROW, frame_id, _MECHANISM, (0.012, 0.024, 0.0))
        arrow.points = [_point(start), _point(start + velocity[:3] * _ARROW / fastest)]
        markers.append(arrow)
    return markers


def _body(item: RigidObject, number: int, frame_id: str) -> Marker:
    colour, shape = _FIXED if item.fixed else _MOVABLE, item.shape
    if isinstance(shape, Box):
        marker = _marker("objects", number, Marker.CUBE, frame_id, colour, shape.size)
    elif isinstance(shape, Cylinder):
        sizes = (2 * shape.radius, 2 * shape.radius, shape.length)
        marker = _marker("objects", number, Marker.CYLINDER, frame_id, colour, sizes)
    elif isinstance(shape, Sphere):
        marker = _marker("objects", number, Marker.SPHERE, frame_id, colour, (2 * shape.radius,) * 3)
    else:
        marker = _marker("objects", number, Marker.TRIANGLE_LIST, frame_id, colour, (1.0, 1.0, 1.0))
        polyhedron = shape.polyhedron
        marker.points = [_point(vertex) for vertex in polyhedron.vertices[polyhedron.triangles].reshape(-1, 3)]
    marker.pose = pose_message(item.pose)
    return marker


def _label(item: RigidObject, number: int, frame_id: str) -> Marker:
    marker = _marker("ids", number, Marker.TEXT_VIEW_FACING, frame_id, (1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.05))
    marker.text = item.id
    marker.pose.position = _point(item.com_in_world)
    return marker


def _marker(
    name: str, number: int, kind: int, frame_id: str, colour: Sequence[float], scale: Sequence[float]
) -> Marker:
    marker = Marker(ns=name, id=number, type=kind, action=Marker.ADD, color=_colour(colour))
    marker.header.frame_id = frame_id
    marker.scale.x, marker.scale.y, marker.scale.z = (float(value) for value in scale)
    return marker


def _point(values: Any) -> Point:
    x, y, z = values
    return Point(x=float(x), y=float(y), z=float(z))


def _colour(values: Sequence[float]) -> ColorRGBA:
    r, g, b, a = values
    return ColorRGBA(r=float(r), g=float(g), b=float(b), a=float(a))
