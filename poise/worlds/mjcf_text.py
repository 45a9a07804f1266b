"""Objects as elements of MJCF (https://mujoco.readthedocs.io/en/stable/XMLreference.html)."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from poise.assembly import Assembly, Box, Cylinder, FrictionPair, RigidObject, Sphere
from poise.assembly.contact import CONTACT_MARGIN
from poise.errors import PoiseError
from poise.exporting import mjcf_inertial as inertial_element
from poise.geometry import Pose, quaternion_of_rotation
from poise.types import Array
from poise.worlds.assembling import inertial_of
from poise.worlds.pieces import convex_pieces

MJCF_MEMORY = 1 << 30
"""Bytes for contacts, of which MuJoCo touches what it needs: 451 contacts do not fit into its default of 16 MB."""


def mjcf_place(pose: Pose) -> str:
    """The attributes `pos` and `quat`."""
    x, y, z, w = quaternion_of_rotation(pose.rotation)
    return f'pos="{_numbers(pose.translation)}" quat="{_numbers([w, x, y, z])}"'


def mjcf_inertial(item: RigidObject) -> str:
    """The element `inertial` of an object's body."""
    return inertial_element(inertial_of(item))


def mjcf_resistance(items: Sequence[RigidObject], rolling: float, friction: float) -> tuple[list[float], int]:
    """Coefficients of spinning and rolling (moments per normal force, m) between objects, and the `condim` they need.

    Rolling resistance acts on cylinders and balls, between two of them at the radius 1 / (1 / a + 1 / b); other
    contacts have the default of three dimensions.
    """
    radii = [item.shape.radius for item in items if isinstance(item.shape, Cylinder | Sphere)]
    if not radii or rolling == 0:
        return [0.0, 0.0], 3
    lever = rolling / sum(1 / radius for radius in radii)
    return [2 / 3 * friction * lever, lever], 6


def mjcf_round_pairs(assembly: Assembly, friction: float) -> list[FrictionPair]:
    """Cylinders and balls whose bounding spheres touch and that no friction pair names.

    Of two geoms MuJoCo takes the larger resistance, and two round bodies have less than each has on a plane.
    """
    items = [each for each in assembly.objects if isinstance(each.shape, Cylinder | Sphere)]
    if len(items) < 2 or assembly.rolling == 0:
        return []
    middles = np.array([item.pose.translation for item in items])
    reach = np.array([np.linalg.norm(item.vertices - item.pose.translation, axis=1).max() for item in items])
    named = {frozenset(pair.objects) for pair in assembly.friction_pairs}
    near = cKDTree(middles).query_pairs(2 * reach.max() + CONTACT_MARGIN, output_type="ndarray")
    apart = np.linalg.norm(middles[near[:, 0]] - middles[near[:, 1]], axis=1)
    touching = near[apart <= reach[near].sum(axis=1) + CONTACT_MARGIN].tolist()
    pairs = [(items[one], items[other]) for one, other in sorted(touching)]
    return [
        FrictionPair((one.id, other.id), friction)
        for one, other in pairs
        if not (one.fixed and other.fixed) and frozenset((one.id, other.id)) not in named
    ]


def mjcf_geom(item: RigidObject, name: str, attributes: str, hull: bool = False) -> tuple[str, str, bool]:
    """The geoms of an object, the meshes that they use, and whether they are the convex hull of a body that is not.

    Args:
        item: the object.
        name: of the geom; pieces of a solid are `name/1` and so on.
        attributes: of each geom, such as friction.
        hull: take the hull of what is not convex, in place of convex pieces.
    """
    shape, place = item.shape, f'name="{name}" {attributes}'
    if isinstance(shape, Box):
        return f'<geom type="box" size="{_numbers(np.array(shape.size) / 2)}" {place}/>', "", False
    if isinstance(shape, Cylinder):
        return f'<geom type="cylinder" size="{_numbers([shape.radius, shape.length / 2])}" {place}/>', "", False
    if isinstance(shape, Sphere):
        return f'<geom type="sphere" size="{_numbers([shape.radius])}" {place}/>', "", False
    surface, simple = shape.polyhedron, False
    pieces = [surface.vertices]
    if not surface.convex:
        simple = hull
        try:
            pieces = pieces if hull else convex_pieces(surface)
        except PoiseError:  # too round for pieces
            simple = True
    names = [name] if len(pieces) == 1 else [f"{name}/{number}" for number in range(1, len(pieces) + 1)]
    # MuJoCo centres a mesh on its inertial frame; the geom's own pose then brings it back.
    geoms = "".join(f'<geom type="mesh" mesh="{each}" name="{each}" {attributes}/>' for each in names)
    meshes = (
        f'<mesh name="{each}" vertex="{_numbers(piece.ravel())}"/>' for each, piece in zip(names, pieces, strict=True)
    )
    return geoms, "".join(meshes), simple


def _numbers(values: Sequence[float] | Array) -> str:
    return " ".join(f"{float(value):.12g}" for value in values)
