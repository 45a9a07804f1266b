"""What in a scene is possible, but probably a slip: units, the order of a quaternion, friction, densities, gravity."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from poise.assembly.scene.scene import Assembly, RigidObject

_SLIPPERY, _FRICTION = 0.0, 2.0
_LIGHT, _DENSE = 0.5, 12_000.0
"""kg/m3: lighter than the lightest foams by far; denser than lead."""
_UPSIDE_DOWN, _NEARLY = np.array([1.0, 0.0, 0.0, 0.0]), 0.05
_GRAVITY = np.cos(np.radians(60))
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
    return (*_friction(assembly), *_densities(movable), *_quaternions(movable), *_gravity(assembly))


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
        ([name for name, value in densities.items() if value > _DENSE], "denser than lead"),
        ([name for name, value in densities.items() if value < _LIGHT], "lighter than any packed object"),
    ):
        if strange:
            worst = max(strange, key=lambda name: abs(np.log(densities[name] / 1000.0)))
            what = f"{_listed(strange)}: {densities[worst]:.3g} kg/m3, {than}; check units of mass and lengths"
            yield SceneFinding(what, {"density": densities[worst]})


def _quaternions(movable: Sequence[RigidObject]) -> Iterator[SceneFinding]:
    off = [float(np.abs(np.abs(item.pose.vector[3:]) - _UPSIDE_DOWN).max()) for item in movable]
    # Of poses that a camera sees none is exact: that most objects lie upside down about the same axis is no chance.
    most = len(off) > 1 and np.median(off) < _NEARLY
    turned = [item.id for item, value in zip(movable, off, strict=True) if value < (_NEARLY if most else 1e-9)]
    if turned:
        what = f"{_listed(turned)}: the quaternion 1 0 0 0 is a half turn about x; the order is x y z w"
        yield SceneFinding(what, {"objects": float(len(turned))})


def _gravity(assembly: Assembly) -> Iterator[SceneFinding]:
    down = -assembly.gravity[2] / float(np.linalg.norm(assembly.gravity))
    if down < _GRAVITY:
        what = f"gravity is {' '.join(f'{value:g}' for value in assembly.gravity)}: the world's z points upwards here"
        yield SceneFinding(what, {"angle_deg": float(np.degrees(np.arccos(np.clip(down, -1, 1))))})


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")
