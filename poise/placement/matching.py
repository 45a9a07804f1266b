"""From two places of the scene and two features of the object to poses (thesis section 5.5.2 and 5.5.3).

The thesis fixes the pose by two points and one normal (eq. 5.55-5.63): of two faces that are to lie flat, one then
does not, unless the line between the points happens to be square to the common edge. Here the normals come first: the
rotation makes every chosen feature lie on its plane, the translation brings it onto the plane, and what freedom is left
puts the centre of mass over the middle between the two places, which is what the thesis' choice of points is for.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from poise.geometry import Pose, cross, rotation_about, rotation_between, unit
from poise.placement.features import ContactFeatures, Face
from poise.types import Array

_PARALLEL = 0.01
"""Half the angle, rad, below which two planes are parallel: theirs is no place within reach."""
_ANGLE = np.radians(1.0)
"""Two pairs of normals match when the angles between them differ by less."""


@dataclass(frozen=True, eq=False)
class SupportPoint:
    """A place on the scene: a point (3,) m and the outward unit normal (3,) there, in the world."""

    point: Array
    normal: Array


def poses_on_one(contact: SupportPoint, face: Face, com: Array, yaws: Array) -> Iterator[Pose]:
    """Poses with a face flat on the plane of one place, the centre of mass over it, turned by each yaw, rad."""
    down = rotation_between(face.normal, -contact.normal)
    for yaw in yaws:
        rotation = rotation_about(contact.normal, float(yaw)) @ down
        yield _on_planes(rotation, [(contact, face.point)], contact.point, com)


def poses_on_two(
    a: SupportPoint, b: SupportPoint, features: ContactFeatures, rng: np.random.Generator, tries: int
) -> Iterator[Pose]:
    """Poses that touch both places, with `tries` random pairs of features that can.

    Faces on one plane (case A.1), faces that intersect (A.2), a face and an edge (B), and two edges (C).

    Args:
        a, b: of the scene.
        features: of the object.
        rng: chooses.
        tries: pairs of features to try; not each can touch both.
    """
    middle = (a.point + b.point) / 2
    if same_plane(a, b):
        for _ in range(tries):
            face = _pick_face(features, rng)
            run = unit(b.point - a.point)
            down = rotation_between(face.normal, -a.normal)
            along = down @ face.along
            # The longest extent along the line between the places, in either direction, or a random angle.
            yaw: float = _signed_angle(along, run, a.normal) + rng.integers(4) * np.pi / 2
            yaw = yaw if rng.random() < 0.5 else float(rng.uniform(0, 2 * np.pi))
            rotation = rotation_about(a.normal, yaw) @ down
            yield _on_planes(rotation, [(a, face.point)], middle, features.com)
        return
    for _ in range(tries):
        kind = rng.random()
        if kind < 0.6 or not features.edges:
            yield from _face_face(a, b, features, rng, middle)
        elif kind < 0.85:
            yield from _face_edge(a, b, features, rng, middle)
        else:
            yield from _edge_edge(a, b, features, rng, middle)


def _face_face(
    a: SupportPoint, b: SupportPoint, features: ContactFeatures, rng: np.random.Generator, middle: Array
) -> Iterator[Pose]:
    angle = np.arccos(np.clip(a.normal @ b.normal, -1, 1))
    if angle < _ANGLE or angle > np.pi - _ANGLE:
        return
    pair = features.pair_at(float(angle), _ANGLE, rng)
    if pair is None:
        return
    first, second = pair
    rotation = rotation_of_pairs(first.normal, second.normal, -a.normal, -b.normal)
    yield _on_planes(rotation, [(a, first.point), (b, second.point)], middle, features.com)


def _face_edge(
    a: SupportPoint, b: SupportPoint, features: ContactFeatures, rng: np.random.Generator, middle: Array
) -> Iterator[Pose]:
    """The face on the place a; the edge on b. The turn about a's normal that lays the edge into b's plane."""
    face = _pick_face(features, rng)
    edge = features.edges[rng.integers(len(features.edges))]
    down = rotation_between(face.normal, -a.normal)
    for yaw in _yaws_into_plane(down @ edge.direction, a.normal, b.normal):
        rotation = rotation_about(a.normal, yaw) @ down
        if edge.affords(rotation.T @ b.normal):
            yield _on_planes(rotation, [(a, face.point), (b, edge.start)], middle, features.com)


def _edge_edge(
    a: SupportPoint, b: SupportPoint, features: ContactFeatures, rng: np.random.Generator, middle: Array
) -> Iterator[Pose]:
    """Each edge in its plane; how far the first leans between its faces is free, and chosen at random."""
    first, second = (features.edges[k] for k in rng.integers(len(features.edges), size=2))
    share = rng.uniform(0.1, 0.9)
    lean = unit((1 - share) * first.normals[0] + share * first.normals[1])
    down = rotation_between(lean, -a.normal)
    for yaw in _yaws_into_plane(down @ second.direction, a.normal, b.normal):
        rotation = rotation_about(a.normal, yaw) @ down
        if second.affords(rotation.T @ b.normal):
            yield _on_planes(rotation, [(a, first.start), (b, second.start)], middle, features.com)


def _pick_face(features: ContactFeatures, rng: np.random.Generator) -> Face:
    return features.faces[int(rng.choice(len(features.faces), p=features.odds))]


def same_plane(a: SupportPoint, b: SupportPoint) -> bool:
    """Whether both places lie on one plane and face the same way."""
    run = b.point - a.point
    length = float(np.linalg.norm(run))
    return bool(a.normal @ b.normal > np.cos(_ANGLE) and length > 0 and abs(run @ a.normal) <= 2e-4 + 1e-3 * length)


def over_three(a: SupportPoint, b: SupportPoint, c: SupportPoint, up: Array) -> SupportPoint | None:
    """The plane over three places, above their middle: what a face needs to lie on three peaks, or on one surface.

    None when the places are in line, or when the plane would run into a surface at one of them.
    """
    across = cross(b.point - a.point, c.point - a.point)
    size = float(np.linalg.norm(across))
    if size < 1e-3 * float(np.linalg.norm(b.point - a.point)) * float(np.linalg.norm(c.point - a.point)) or size == 0:
        return None
    normal = across / size * np.sign(across @ up)
    slopes = np.array([contact.normal @ normal for contact in (a, b, c)])
    flat = np.all(slopes > np.cos(_ANGLE))
    peaks = np.array([contact.normal @ up for contact in (a, b, c)]) > 1 - 1e-9
    if not (flat or np.all(peaks)) or normal @ up <= 0:
        return None
    return SupportPoint((a.point + b.point + c.point) / 3, normal)


def _on_planes(rotation: Array, pairs: list[tuple[SupportPoint, Array]], middle: Array, com: Array) -> Pose:
    """The translation that puts points of the object (3,) on the planes, its com over `middle` as far as is free.

    Planes that are nearly parallel meet far away: the object comes between them instead, and touches neither.
    """
    normals = np.array([contact.normal for contact, _ in pairs])
    distances = np.array([contact.normal @ (contact.point - rotation @ point) for contact, point in pairs])
    over = middle - rotation @ com
    gap = distances - normals @ over
    return Pose(rotation, over + np.linalg.lstsq(normals, gap, rcond=_PARALLEL)[0])


def rotation_of_pairs(first: Array, second: Array, to_first: Array, to_second: Array) -> Array:
    """The rotation that turns `first` into `to_first` and `second` as near to `to_second` as that allows."""

    def frame(x: Array, other: Array) -> Array:
        z = unit(cross(x, other))
        return np.column_stack([x, cross(z, x), z])

    return np.asarray(frame(to_first, to_second) @ frame(first, second).T)


def _yaws_into_plane(direction: Array, axis: Array, normal: Array) -> list[float]:
    """Turns about a unit axis, rad, that lay a direction into the plane with this normal; none, one or two."""
    along = float(axis @ direction) * float(axis @ normal)
    cosine = float(direction @ normal) - along
    sine = float(cross(axis, direction) @ normal)
    size = np.hypot(cosine, sine)
    if size < 1e-12 or abs(along) > size:
        return []
    middle, half = np.arctan2(sine, cosine), np.arccos(-along / size)
    return [float(middle + half), float(middle - half)]


def _signed_angle(start: Array, end: Array, axis: Array) -> float:
    return float(np.arctan2(cross(start, end) @ axis, start @ end))
