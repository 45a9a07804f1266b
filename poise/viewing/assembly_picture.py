"""Assemblies drawn in 3-D for figures: shaded bodies, coloured surfaces, and places for what is drawn over them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import FigureBase
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from poise.assembly import Analysis, Assembly
from poise.assembly.robustness import RobustnessMap
from poise.geometry import Pose
from poise.types import Array, Mask
from poise.viewing.canvas import PALETTE
from poise.viewing.z_buffer import NOTHING, PictureCamera, see

_TOWARD = (-1.0, -1.7, 0.9)
"""From the middle of the picture to the viewer."""
_LIGHT = np.array([-0.35, -0.6, 0.72])
_SUPERSAMPLED = 2
_PIXELS_PER_POINT = 2
FIXED, MOVABLE = "#f4f5f6", "#aebdd0"
_ACROSS, _STRIPE = np.array([1.0, 1.0, 1.0]), 0.35
"""Normal of the stripes, and the share of the colour that is left in them."""
_NEIGHBOURS = 4
"""Points of a map that the colour of a pixel is made of."""
_SAME_FACE = 0.3
"""m that points of a map are as good as apart when their pushes are at right angles."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """The triangles of an assembly as they are drawn.

    Args:
        triangles: (T, 3, 3) m.
        normals: (T, 3) outward.
        place: (T,) in `Assembly.objects`.
    """

    triangles: Array
    normals: Array
    place: NDArray[np.int64]

    @classmethod
    def of(cls, assembly: Assembly) -> "Bodies":
        """All objects where they are."""
        triangles, normals, places = [], [], []
        for place, item in enumerate(assembly.objects):
            polyhedron = item.shape.polyhedron
            triangles.append(item.vertices[polyhedron.triangles])
            normals.append((polyhedron.normals @ item.pose.rotation.T)[polyhedron.facet_of_triangle])
            places.append(np.full(len(polyhedron.triangles), place))
        return cls(np.concatenate(triangles), np.concatenate(normals), np.concatenate(places))


@dataclass(frozen=True, eq=False)
class Stage:
    """Axes with an assembly in them; what is drawn over it is placed by `at`.

    Args:
        axes: in points of the picture, (0, 0) at the lower left.
        camera: with one pixel per point.
    """

    axes: Axes
    camera: PictureCamera

    def at(self, points: Array) -> Array:
        """(N, 2) where points (N, 3) are in the picture."""
        return self.camera.project(points)


def stage(
    figure: FigureBase,
    assembly: Assembly,
    box: tuple[float, float, float, float],
    colours: Mapping[int, str] | None = None,
    surface: "SurfaceColours | None" = None,
    shown: Assembly | None = None,
    beside: Array | None = None,
    pale: float = 0.0,
) -> Stage:
    """Draw an assembly into a part of a figure.

    Args:
        figure: to draw on.
        assembly: what the view is made for.
        box: left, bottom, width, height of the part, shares of the figure.
        colours: of single objects, by place.
        surface: colours of the movable objects' surfaces instead.
        shown: with objects elsewhere; None: the assembly itself.
        beside: (N, 3) points that have to be in the picture too.
        pale: share of white over everything.
    """
    axes = figure.add_axes(box)
    window = axes.get_window_extent()
    width, height = (int(side * 72 / axes.figure.get_dpi()) for side in (window.width, window.height))
    movable = [item.vertices for item in assembly.objects if not item.fixed]
    movable += [item.vertices for item in (shown or assembly).objects if not item.fixed]
    movable += [] if beside is None else [beside]
    camera = PictureCamera.around(np.concatenate(movable), _TOWARD, width, height, 0.07)
    fine = _PIXELS_PER_POINT * _SUPERSAMPLED
    sharp = replace(camera, scale=fine * camera.scale, width=fine * width, height=fine * height)
    picture = _painted(shown or assembly, sharp, colours or {}, surface)
    picture = picture.reshape(height * _PIXELS_PER_POINT, _SUPERSAMPLED, -1, _SUPERSAMPLED, 3).mean(axis=(1, 3))
    axes.imshow(pale + (1 - pale) * picture, origin="lower", extent=(0, width, 0, height), interpolation="none")
    axes.set_axis_off()
    return Stage(axes, camera)


@dataclass(frozen=True, eq=False)
class SurfaceColours:
    """Colours of the surface by the nearest points of a map, with dark stripes where these are doubtful.

    Args:
        found: the map.
        colours: (N, 3) of its points.
    """

    found: RobustnessMap
    colours: Array

    @cached_property
    def _pitch(self) -> float:
        return 0.01 * extent(self.found.analysis)

    def at(self, points: Array, normals: Array, places: NDArray[np.int64]) -> Array:
        """(P, 3) colours of points (P, 3) with outward normals (P, 3) on objects (P,)."""
        surface, colours = self.found.surface, np.ones((len(points), 3))
        for place in np.unique(places).tolist():
            on, asked = np.flatnonzero(surface.place == place), np.flatnonzero(places == place)
            if not len(on):
                continue
            tree = cKDTree(np.concatenate([surface.points[on], -_SAME_FACE * surface.directions[on]], axis=1))
            count = min(_NEIGHBOURS, len(on))
            where = np.concatenate([points[asked], _SAME_FACE * normals[asked]], axis=1)
            distance, nearest = tree.query(where, k=range(1, count + 1))
            weights = 1 / (distance**2 + 1e-12)
            weights /= weights.sum(axis=1, keepdims=True)
            colours[asked] = np.einsum("pk,pkc->pc", weights, self.colours[on[nearest]])
            # Planes that cross each face of an upright body at an angle.
            striped = np.floor(points[asked] @ _ACROSS / self._pitch) % 2 == 0
            doubtful = np.einsum("pk,pk->p", weights, unconfirmed(self.found)[on[nearest]]) > 0.5
            colours[asked[striped & doubtful]] *= _STRIPE
        return colours


def unconfirmed(found: RobustnessMap) -> Mask:
    """(N,) points of a map that are doubtful, or were not computed in time: what they bear is known from below only."""
    return np.asarray(found.doubtful | ((found.lower == 0) & np.isinf(found.upper)))


def _painted(
    assembly: Assembly, camera: PictureCamera, colours: Mapping[int, str], surface: SurfaceColours | None
) -> Array:
    """(H, W, 3) of 0..1."""
    bodies, objects = Bodies.of(assembly), assembly.objects
    seen = see(camera, bodies.triangles)
    hit = seen.triangle != NOTHING
    place, normals = bodies.place[seen.triangle], bodies.normals[seen.triangle]
    base = np.array([to_rgb(colours.get(i, FIXED if item.fixed else MOVABLE)) for i, item in enumerate(objects)])
    picture = np.where(hit[..., None], base[place], 1.0)
    fixed = np.array([item.fixed for item in objects])[place]
    strength = np.where(fixed, 0.2, 0.45)
    if surface is not None:
        movable = hit & ~fixed
        strength[movable] = 0.15
        # One look-up for each pixel of the picture; between bodies there is a line over it anyway.
        rough = (slice(None, None, _SUPERSAMPLED),) * 2
        asked, coarse = movable[rough], picture[rough].copy()
        coarse[asked] = surface.at(seen.points[rough][asked], normals[rough][asked], place[rough][asked])
        picture = np.where(movable[..., None], _enlarged(coarse), picture)
    shade = 1 - strength * (1 - np.clip(normals @ _LIGHT, 0, 1))
    picture = np.where(hit[..., None], picture * shade[..., None], 1.0)
    edges = _edges(np.where(hit, place, NOTHING), np.where(hit[..., None], normals, 0.0))
    picture[edges] = 0.35 * picture[edges] + 0.65 * np.array(to_rgb(PALETTE["ink"]))
    return picture


def _enlarged(picture: Array) -> Array:
    return picture.repeat(_SUPERSAMPLED, axis=0).repeat(_SUPERSAMPLED, axis=1)


def _edges(place: NDArray[np.int64], normals: Array) -> Mask:
    """(H, W) pixels at which the body or the direction of its face changes."""
    edges = np.zeros(place.shape, dtype=bool)
    for axis in (0, 1):
        here = [slice(None)] * 2
        there = [slice(None)] * 2
        here[axis], there[axis] = slice(None, -1), slice(1, None)
        first, second = tuple(here), tuple(there)
        turns = np.einsum("hwc,hwc->hw", normals[first], normals[second]) < 0.9
        change = (place[first] != place[second]) | (turns & (place[first] != NOTHING))
        edges[first] |= change
        edges[second] |= change
    return edges


def moved(assembly: Assembly, names: Sequence[str], twists: Array, reach: float) -> Assembly:
    """The assembly with objects moved along twists (M, 6) of their centres of mass, the fastest corner by `reach` m."""
    speeds = [
        np.linalg.norm(twist[:3] + np.cross(twist[3:], item.vertices - item.com_in_world), axis=1).max()
        for item, twist in zip((assembly.objects[assembly.place_of(name)] for name in names), twists, strict=True)
    ]
    seconds = reach / max(speeds)
    objects = []
    for name, twist in zip(names, twists, strict=True):
        item = assembly.objects[assembly.place_of(name)]
        turn = Rotation.from_rotvec(seconds * twist[3:]).as_matrix()
        shift = item.com_in_world + seconds * twist[:3]
        pose = Pose(turn @ item.pose.rotation, shift + turn @ (item.pose.translation - item.com_in_world))
        objects.append(replace(item, pose=pose))
    return assembly.with_object(*objects)


def extent(analysis: Analysis) -> float:
    """Size of what can move, m."""
    vertices = np.concatenate([item.vertices for item in analysis.assembly.objects if not item.fixed])
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))
