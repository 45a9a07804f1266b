"""What in a scene is possible, but probably a slip: units, the order of a quaternion, friction, densities, gravity."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from poise.assembly.scene.scene import Assembly, RigidObject

_SLIPPERY, _FRICTION = 0.0, 2.0
MATTER = (0.5, 12_000.0)
"""kg/m3: lighter than the lightest foams by far; denser than lead."""
_USUAL = (20.0, MATTER[1])
_UPSIDE_DOWN, _NEARLY = np.array([1.0, 0.0, 0.0, 0.0]), 0.05
_GRAVITY = np.cos(np.radians(60))
_STRENGTHS = (1.5, 25.0)
"""m/s2, of the Moon and of Jupiter."""
_DEFAULT_MASS, _ALIKE = 1.0, 1.2
"""kg, of objects without a mass in many formats; ratio of volumes of objects that may weigh the same."""
_BEYOND = 1e-6
"""Share of its bounds by which rounding may move a centre of mass out of a shape, or spread its mass beyond it."""
_NAMED = 3


@dataclass(frozen=True)
class SceneFinding:
    """A sentence about a scene, and the numbers that it rests on."""

    sentence: str
    evidence: Mapping[str, float] = field(default_factory=dict)


@lru_cache(maxsize=16)  # nodes ask with each answer about one assembly
def scene_findings(assembly: Assembly) -> tuple[SceneFinding, ...]:
    """What is probably wrong in a scene, most often by its file; nothing is changed."""
    movable = [item for item in assembly.objects if not item.fixed]
    return (
        *_friction(assembly),
        *_densities(movable),
        *_defaults(movable),
        *_distributions(movable),
        *_quaternions(movable),
        *_gravity(assembly),
    )


def _friction(assembly: Assembly) -> Iterator[SceneFinding]:
    given = {" and ".join(pair.objects): pair.coefficient for pair in assembly.friction_pairs}
    if assembly.friction is not None:
        given = {"all other pairs": assembly.friction, **given}
    if high := {name: value for name, value in given.items() if value > _FRICTION}:
        name, value = max(high.items(), key=lambda entry: entry[1])
        what = f"friction of {name} is {value:g}: rubber on dry concrete has about 1; is it a coefficient?"
        yield SceneFinding(what, {"friction": value})
    if none := [name for name, value in given.items() if value <= _SLIPPERY]:
        yield SceneFinding(f"friction of {_listed(none)} is 0: nothing holds on an incline", {"friction": 0.0})


def _densities(movable: Sequence[RigidObject]) -> Iterator[SceneFinding]:
    densities = {item.id: item.mass / abs(item.shape.volume) for item in movable}
    for strange, than in (
        ([name for name, value in densities.items() if value > MATTER[1]], "denser than lead"),
        ([name for name, value in densities.items() if value < MATTER[0]], "lighter than any packed object"),
    ):
        if strange:
            worst = max(strange, key=lambda name: abs(np.log(densities[name] / 1000.0)))
            other = _in_other_units(densities[worst])
            what = f"{_listed(strange)}: {densities[worst]:.3g} kg/m3, {than}; check units of mass and lengths{other}"
            yield SceneFinding(what, {"density": densities[worst]})


def _in_other_units(density: float) -> str:
    """The unit that would make a density an ordinary one; empty where there is none."""
    for words, factor in (("lengths in mm", 1e9), ("lengths in cm", 1e6), ("masses in g", 1e-3)):
        if _USUAL[0] < density * factor < _USUAL[1]:
            return f" ({words} would give {density * factor:.3g} kg/m3)"
    return ""


def _defaults(movable: Sequence[RigidObject]) -> Iterator[SceneFinding]:
    """What is probably a default, and not known: masses of 1 kg, and poses at the origin among those that are seen."""
    volumes = [abs(item.shape.volume) for item in movable]
    if all(item.mass == _DEFAULT_MASS for item in movable) and max(volumes, default=0) > _ALIKE * min(
        volumes, default=0
    ):
        what = f"{_listed([item.id for item in movable])}: all weigh 1 kg, though of different size; is it a default?"
        yield SceneFinding(what, {"mass": _DEFAULT_MASS})
    origin = [
        item.id
        for item in movable
        if item.pose_covariance is not None
        and not item.pose.translation.any()
        and np.array_equal(item.pose.rotation, np.eye(3))
    ]
    if origin:
        what = f"{_listed(origin)}: the pose is exactly 0 0 0 0 0 0 1, the default; no camera sees an object there"
        yield SceneFinding(what, {"objects": float(len(origin))})


def _distributions(movable: Sequence[RigidObject]) -> Iterator[SceneFinding]:
    """Centres of mass and inertias that no mass within the shape can have."""
    outside, spread = [], []
    for item in movable:
        corners = item.shape.polyhedron.vertices
        com = item.shape.centroid if item.com is None else np.asarray(item.com)
        low, high = com - corners.min(axis=0), corners.max(axis=0) - com
        size = float(np.ptp(corners, axis=0).max())
        if min(low.min(), high.min()) <= _BEYOND * size:
            outside.append(item.id)
        elif item.inertia is not None:
            # Along an axis, mass between two ends has at most the variance of two points at these (Bhatia, Davis 2000).
            second = np.trace(item.inertia) / 2 - np.diag(item.inertia)
            if np.any(second > (1 + _BEYOND) * item.mass * low * high):
                spread.append(item.id)
    if outside:
        what = f"{_listed(outside)}: the centre of mass is not inside the shape; com is in the object frame, m"
        yield SceneFinding(what, {"objects": float(len(outside))})
    if spread:
        what = (
            f"{_listed(spread)}: the inertia is more than any mass inside the shape has; give it in kg m2, about the "
            "centre of mass, not about the origin of the frame"
        )
        yield SceneFinding(what, {"objects": float(len(spread))})


def _quaternions(movable: Sequence[RigidObject]) -> Iterator[SceneFinding]:
    off = [float(np.abs(np.abs(item.pose.vector[3:]) - _UPSIDE_DOWN).max()) for item in movable]
    # Of poses that a camera sees none is exact: that most objects lie upside down about the same axis is no chance.
    most = len(off) > 1 and np.median(off) < _NEARLY
    turned = [item.id for item, value in zip(movable, off, strict=True) if value < (_NEARLY if most else 1e-9)]
    if turned:
        what = f"{_listed(turned)}: the quaternion 1 0 0 0 is a half turn about x; the order is x y z w"
        yield SceneFinding(what, {"objects": float(len(turned))})


def _gravity(assembly: Assembly) -> Iterator[SceneFinding]:
    strength = float(np.linalg.norm(assembly.gravity))
    down = -assembly.gravity[2] / strength
    if down < _GRAVITY:
        what = f"gravity is {' '.join(f'{value:g}' for value in assembly.gravity)}: the world's z points upwards here"
        yield SceneFinding(what, {"angle_deg": float(np.degrees(np.arccos(np.clip(down, -1, 1))))})
    if not _STRENGTHS[0] <= strength <= _STRENGTHS[1]:
        what = f"gravity is {strength:.3g} m/s2, and 9.81 on Earth; it is given in m/s2"
        yield SceneFinding(what, {"gravity": strength})


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")
