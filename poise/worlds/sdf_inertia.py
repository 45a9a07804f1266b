"""Masses of links in SDFormat: stated, computed from the density of their shapes, or the format's default."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.inertia import InertialParameters
from poise.worlds.assembling import combined
from poise.worlds.base import WorldSolid
from poise.worlds.sdf_frames import is_true, pose_inside
from poise.worlds.xml_tree import AXES_OF_INERTIA, inertial_at, numbers_of

_DENSITY = "1000"
"""kg/m3, of `inertial auto="true"` where neither the collision nor the link gives one."""


def link_inertial(link: ET.Element, solids: Sequence[tuple[ET.Element, WorldSolid]], where: str) -> InertialParameters:
    """Of a link, in its frame; NaN for what the file leaves open.

    With `auto` (SDFormat 1.11) mass, centre of mass and inertia follow from the density of each shape; a mass that is
    given beside it scales them (1.12).

    Args:
        link: the element.
        solids: its collisions that have a volume, and their shapes.
        where: names it in errors.

    Raises:
        InputError: BAD_INPUT for what is no number, and for a density that is not positive.
    """
    element = link.find("inertial")
    if element is None:
        return InertialParameters(1.0, np.full(3, np.nan), np.full((3, 3), np.nan))
    if is_true(element.get("auto")) and solids:
        return _of_density(element, solids, where)
    mass = float(numbers_of(element.findtext("mass"), 1, f"{where}: mass", "1")[0])
    tensor = element.find("inertia")
    if tensor is None:
        return inertial_at(mass, pose_inside(element, where), None)
    entries = zip(AXES_OF_INERTIA, ("1", "0", "0", "1", "0", "1"), strict=True)
    six = [numbers_of(tensor.findtext(axis), 1, f"{where}: {axis}", value)[0] for axis, value in entries]
    return inertial_at(mass, pose_inside(element, where), np.array(six))


def _of_density(element: ET.Element, solids: Sequence[tuple[ET.Element, WorldSolid]], where: str) -> InertialParameters:
    general = element.findtext("density") or _DENSITY
    parts = []
    for collision, solid in solids:
        name = f"{where}::{collision.get('name')}: density"
        density = float(numbers_of(collision.findtext("density") or general, 1, name)[0])
        if density <= 0:
            raise InputError(ErrorCode.BAD_INPUT, f"{name} is {density:g} kg/m3; it has to be positive")
        mass, shape = density * solid.shape.volume, solid.shape
        alone = InertialParameters(mass, np.asarray(shape.centroid), mass * np.asarray(shape.inertia_per_mass))
        parts.append(alone.in_frame(solid.pose.rotation, solid.pose.translation))
    whole = combined(parts)
    if whole is None:  # `solids` is not empty
        raise InputError(ErrorCode.BAD_INPUT, f"{where}: no shape has a volume")
    if element.find("mass") is None:
        return whole
    given = float(numbers_of(element.findtext("mass"), 1, f"{where}: mass")[0])
    return InertialParameters(given, whole.com, whole.inertia * (given / whole.mass))
