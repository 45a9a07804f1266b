"""What an assembly is made of: rigid objects, friction and gravity."""

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TypeVar

import numpy as np

from poise.assembly.scene.shapes import Shape
from poise.errors import ErrorCode, InputError
from poise.geometry import STANDARD_GRAVITY, Pose
from poise.ranges import check_covariance, check_range, vectors
from poise.types import Array

_Value = TypeVar("_Value", bound=Hashable)
ROLLING = 0.002
"""Rolling resistance of pairs that give none: that of hard bodies. Where it is too small, things roll too early."""
# Steel wheels on rails 0.001 to 0.002, tyres 0.005 to 0.015 (Marks' Standard Handbook for Mechanical Engineers).
_INERTIA_ROUNDING = 1e-9
"""Share of the largest entry by which an inertia tensor may miss symmetry and the triangle inequality."""


@dataclass(frozen=True, eq=False)
class RigidObject:
    """One rigid body of an assembly.

    Args:
        id: its name, unique in the assembly.
        shape: box, cylinder, sphere or mesh, in the object frame.
        pose: of the object frame, in the assembly's frame.
        fixed: no force moves it (floor, tray, shelf); its mass is ignored.
        mass: kg; positive unless fixed.
        com: (3,) centre of mass in the object frame, m; None: the centroid of the shape.
        inertia: (3, 3) about the centre of mass, in the object's axes, kg m2; None: uniform density.
        covariance: (10, 10) of (m, m c, I about the object frame's origin); None: known exactly.
        pose_covariance: (6, 6) of (position of the object frame, m, rotation vector, rad), in the assembly's axes;
            None: known exactly. `poise.assembly.settle` finds poses that touch.

    Raises:
        InputError: NOT_FINITE or OBJECT_INVALID, naming the object and the entry.
    """

    id: str
    shape: Shape
    pose: Pose
    fixed: bool = False
    mass: float = 0.0
    com: Array | None = None
    inertia: Array | None = None
    covariance: Array | None = None
    pose_covariance: Array | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.id, str) or not self.id:
            raise InputError(ErrorCode.OBJECT_INVALID, f"object id {self.id!r}: give every object a name")
        where = f"object {self.id}: "
        check = partial(check_range, where=where, object=self.id)
        check("characters of an id", len(self.id))
        check("position", self.pose.rotation)
        check("position", self.pose.translation)
        self.shape.check_size(where)
        if not self.fixed:
            check("mass", self.mass)
        if self.com is not None:
            vectors("com", [self.com], where=where)
        if self.inertia is not None:
            check("inertia", self.inertia)
            if not self.fixed and not _is_inertia(self.inertia):
                raise self._invalid(
                    "the inertia matrix belongs to no body: check the order ixx ixy ixz iyy iyz izz, about com"
                )
        if self.covariance is not None:
            check_covariance(np.ravel(self.covariance), where)
        if self.pose_covariance is not None:
            check_covariance(np.ravel(self.pose_covariance), where, name="pose_covariance")

    def _invalid(self, what: str) -> InputError:
        return InputError(ErrorCode.OBJECT_INVALID, f"object {self.id}: {what}", object=self.id)

    @cached_property
    def vertices(self) -> Array:
        """(V, 3) of the shape, in the assembly's frame."""
        return self.pose.apply(self.shape.polyhedron.vertices)

    @cached_property
    def com_in_world(self) -> Array:
        """(3,) m, in the assembly's frame."""
        return self.pose.apply(self.shape.centroid if self.com is None else np.asarray(self.com))

    @cached_property
    def inertia_in_world(self) -> Array:
        """(3, 3) about the centre of mass, in the assembly's axes, kg m2."""
        inertia = self.mass * self.shape.inertia_per_mass if self.inertia is None else np.asarray(self.inertia)
        return self.pose.rotation @ inertia @ self.pose.rotation.T


@dataclass(frozen=True)
class FrictionPair:
    """The Coulomb coefficient between two objects, and its standard deviation.

    Args:
        objects: their ids.
        coefficient: of Coulomb friction.
        deviation: of it.
        rolling: coefficient of rolling resistance; None: that of the assembly.
    """

    objects: tuple[str, str]
    coefficient: float
    deviation: float = 0.0
    rolling: float | None = None


@dataclass(frozen=True, eq=False)
class Assembly:
    """Objects in contact: the content of a scene file and of poise_msgs/Assembly.

    Args:
        objects: all bodies, fixed ones included.
        gravity: (3,) m/s2, in the assembly's frame.
        friction: Coulomb coefficient of pairs that `friction_pairs` does not name; None: it names all that touch.
        friction_pairs: single pairs.
        rolling: coefficient of rolling resistance of pairs that give none: the force that keeps a wheel rolling, per
            load; also the lever, per radius, by which the contact force may be off the line or point of contact.
        friction_deviation: standard deviation of the coefficients of pairs that give none.

    Raises:
        InputError: BAD_INPUT, NOT_FINITE or OBJECT_UNKNOWN, naming the entry.
    """

    objects: tuple[RigidObject, ...]
    gravity: Array = field(default_factory=lambda: np.array([0.0, 0.0, -STANDARD_GRAVITY]))
    friction: float | None = 0.5
    friction_pairs: tuple[FrictionPair, ...] = ()
    rolling: float = ROLLING
    friction_deviation: float = 0.0

    def __post_init__(self) -> None:
        _require_distinct(self.objects)
        ids = {item.id for item in self.objects}
        if not any(item.fixed for item in self.objects):
            raise InputError(ErrorCode.BAD_INPUT, "objects: none is fixed; mark the floor or tray with fixed: true")
        check_range("gravity", float(np.linalg.norm(vectors("direction", [self.gravity], where="gravity: "))))
        if self.friction is not None:
            check_range("friction", self.friction)
        check_range("rolling", self.rolling)
        check_range("friction", self.friction_deviation, "friction_deviation: ")
        for pair in self.friction_pairs:
            where = f"friction_pairs of {pair.objects[0]} and {pair.objects[1]}"
            check_range("friction", [pair.coefficient, pair.deviation], f"{where}: ")
            if pair.rolling is not None:
                check_range("rolling", pair.rolling, f"{where}: ")
            for name in pair.objects:
                if name not in ids:
                    raise InputError(ErrorCode.OBJECT_UNKNOWN, f"{where}: there is no object {name}", object=name)
            if len(set(pair.objects)) < 2:
                raise InputError(ErrorCode.BAD_INPUT, f"{where}: these are one object; name the two that touch")
        if len(self._pairs) < len(self.friction_pairs):
            first, second = sorted(_repeated([frozenset(pair.objects) for pair in self.friction_pairs])[0])
            raise InputError(ErrorCode.BAD_INPUT, f"friction_pairs of {first} and {second}: given twice; leave one out")

    @property
    def notes(self) -> tuple[str, ...]:
        """What was repaired in the meshes, one sentence each, with the name of the object."""
        return tuple(f"object {item.id}: {note}" for item in self.objects for note in getattr(item.shape, "notes", ()))

    @cached_property
    def index(self) -> Mapping[str, int]:
        """The place of each id in `objects`."""
        return {item.id: i for i, item in enumerate(self.objects)}

    @cached_property
    def _pairs(self) -> Mapping[frozenset[str], FrictionPair]:
        return {frozenset(pair.objects): pair for pair in self.friction_pairs}

    def friction_between(self, first: str, second: str) -> float:
        """Coulomb coefficient between two objects, by id.

        Raises:
            InputError: BAD_INPUT when it is not given.
        """
        pair = self._pairs.get(frozenset((first, second)))
        if pair is not None:
            return pair.coefficient
        if self.friction is None:
            raise InputError(
                ErrorCode.BAD_INPUT,
                f"friction of {first} and {second} is not given: give a friction pair, or friction for all pairs",
            )
        return self.friction

    def rolling_between(self, first: str, second: str) -> float:
        """Coefficient of rolling resistance between two objects, by id."""
        pair = self._pairs.get(frozenset((first, second)))
        return self.rolling if pair is None or pair.rolling is None else pair.rolling

    @property
    def largest_friction(self) -> float:
        """The largest coefficient of any pair."""
        return max(self.friction or 0.0, *(pair.coefficient for pair in self.friction_pairs), 0.0)

    def place_of(self, name: str) -> int:
        """The place of an id in `objects`.

        Raises:
            InputError: OBJECT_UNKNOWN.
        """
        if name not in self.index:
            known = ", ".join(list(self.index)[:8])
            raise InputError(ErrorCode.OBJECT_UNKNOWN, f"there is no object {name!r}; there are {known}", object=name)
        return self.index[name]

    def with_object(self, *items: RigidObject, pairs: Sequence[FrictionPair] = ()) -> "Assembly":
        """The assembly with objects and friction pairs added, or put in the place of those of the same ids.

        Raises:
            InputError: BAD_INPUT when one of them is given twice; as `Assembly`.
        """
        _require_distinct(items)
        objects = {item.id: item for item in self.objects} | {item.id: item for item in items}
        given = {frozenset(pair.objects) for pair in pairs}
        kept = [pair for pair in self.friction_pairs if frozenset(pair.objects) not in given]
        return replace(self, objects=tuple(objects.values()), friction_pairs=(*kept, *pairs))

    def without(self, name: str) -> "Assembly":
        """The assembly without an object and the friction pairs that name it."""
        self.place_of(name)
        return replace(
            self,
            objects=tuple(item for item in self.objects if item.id != name),
            friction_pairs=tuple(pair for pair in self.friction_pairs if name not in pair.objects),
        )


def _require_distinct(items: Sequence[RigidObject]) -> None:
    if twice := _repeated([item.id for item in items]):
        raise InputError(ErrorCode.BAD_INPUT, f"objects: the id {min(twice)} is given twice; rename one")


def _repeated(values: Iterable[_Value]) -> list[_Value]:
    return [value for value, count in Counter(values).items() if count > 1]


def check_density(item: RigidObject) -> None:
    """Raise an InputError, OBJECT_INVALID, for a density that no matter has: lengths in mm, or masses in g."""
    if not item.fixed:
        sides = np.ptp(item.shape.polyhedron.vertices, axis=0)
        check_range("mass per volume of the bounding box", float(item.mass / np.prod(sides)), f"object {item.id}: ")


def _is_inertia(matrix: Array) -> bool:
    """Symmetric, positive, and no principal moment above the sum of the others (a flat body reaches it)."""
    if np.shape(matrix) != (3, 3):
        return False
    # Rounding is relative to the largest entry: a rotated tensor has off-diagonal entries far smaller than that.
    rounding = _INERTIA_ROUNDING * float(np.abs(matrix).max())
    if float(np.abs(matrix - np.transpose(matrix)).max()) > rounding:
        return False
    moments = np.linalg.eigvalsh(matrix)
    return bool(moments[0] >= -rounding and moments[0] + moments[1] >= moments[2] - rounding)
