"""Which objects stand in the assembly, which one is in the hand, which are lost: the state, and what may change it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from types import MappingProxyType

import numpy as np

from poise.assembly import Assembly, FrictionPair, RigidObject
from poise.assembly.scene import ROLLING
from poise.assembly.statics import same_object
from poise.errors import ErrorCode, InputError
from poise.geometry import GRAVITY_IN_WORLD, Pose
from poise.types import Array
from poise.world.weights import lifted_weight

_EARLY = 0.5
"""s before the grasp at which the payload may have begun to change: a change is dated with such an error."""
_MASS_TOLERANCE = 0.03
"""Share by which the mass of an estimate may be off the mass that was lifted, besides three standard deviations."""
_SIGMAS = 3.0
_SAME_VOLUME = 0.25
"""Share by which the volumes of two scans of one object differ at most."""


class Whereabouts(IntEnum):
    """Where an object is; the numbers of poise_msgs/WorldObject."""

    STANDING = 0
    HELD = 1
    LOST = 2


class WeightSource(IntEnum):
    """Where the weight of an object is from; the numbers of poise_msgs/WorldObject."""

    GIVEN = 0
    ASSUMED = 1
    WEIGHED = 2


@dataclass(frozen=True, eq=False)
class KnownObject:
    """One object.

    Args:
        item: shape, weight, and pose in `frame`.
        frame: of the assembly while it stands, of the hand while it is held.
        where: it is.
        source: of its weight.
        changed: ns, time of the last change.
        lifted: kg and standard deviation, by the wrench at the lift, or as known before the last scan; None: neither.
        notes: what to read it with, one sentence each.
    """

    item: RigidObject
    frame: str
    where: Whereabouts = Whereabouts.STANDING
    source: WeightSource = WeightSource.GIVEN
    changed: int = 0
    lifted: tuple[float, float] | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class World:
    """All objects. Every transition gives another world, or raises an InputError and changes nothing.

    Args:
        frame: of the assembly.
        version: of the assembly, counted up with each change of what stands.
        objects: by id.
        gravity: (3,) m/s2 in the frame of the assembly.
        friction, pairs: of the assembly; pairs of objects that do not stand are kept for when they do.
        newest_event, newest_scan: ns, stamps of the newest grasp event and of the newest scan.
        rolling, friction_deviation: of the assembly.
    """

    frame: str
    version: int = 0
    objects: Mapping[str, KnownObject] = field(default_factory=dict)
    gravity: Array = field(default_factory=lambda: np.array(GRAVITY_IN_WORLD))
    friction: float | None = 0.5
    pairs: tuple[FrictionPair, ...] = ()
    newest_event: int = 0
    newest_scan: int = 0
    rolling: float = ROLLING
    friction_deviation: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "objects", MappingProxyType(dict(self.objects)))

    @cached_property
    def assembly(self) -> Assembly | None:
        """Of what stands; None when nothing is fixed."""
        items = {name: known.item for name, known in self.objects.items() if known.where is Whereabouts.STANDING}
        if not any(item.fixed for item in items.values()):
            return None
        pairs = tuple(pair for pair in self.pairs if all(name in items for name in pair.objects))
        settings = self.gravity, self.friction, pairs, self.rolling, self.friction_deviation
        return Assembly(tuple(items.values()), *settings)

    @property
    def held(self) -> KnownObject | None:
        """What is in the hand."""
        return next((known for known in self.objects.values() if known.where is Whereabouts.HELD), None)

    # -- the assembly as others set it, and scans -------------------------------------------------------------------

    def with_assembly(self, assembly: Assembly, frame: str, now: int) -> "World":
        """An assembly is set. What is held stays held; what was lost and stands in it is found.

        Raises:
            InputError: BAD_INPUT when it has the object that is held.
        """
        held = self.held
        if held is not None and held.item.id in assembly.index:
            raise InputError(
                ErrorCode.BAD_INPUT, f"object {held.item.id} is in the hand: place it first, or leave it out"
            )
        kept = {name: known for name, known in self.objects.items() if known.where is not Whereabouts.STANDING}
        objects: dict[str, KnownObject] = {}
        for item in assembly.objects:
            known = self.objects.get(item.id)
            same = known is not None and known.where is Whereabouts.STANDING and same_object(known.item, item)
            kept_one = replace(known, frame=frame) if known is not None and same else None
            objects[item.id] = kept_one or KnownObject(item, frame, changed=now)
        absent = {frozenset(pair.objects): pair for pair in self.pairs if set(pair.objects) & set(kept)}
        pairs = absent | {frozenset(pair.objects): pair for pair in assembly.friction_pairs}
        return replace(
            self,
            frame=frame,
            version=self.version + 1,
            objects=objects | {name: known for name, known in kept.items() if name not in objects},
            gravity=np.asarray(assembly.gravity),
            friction=assembly.friction,
            pairs=tuple(pairs.values()),
            rolling=assembly.rolling,
            friction_deviation=assembly.friction_deviation,
        )

    def scanned(self, item: RigidObject, stamp: int, notes: Sequence[str] = ()) -> "World":
        """An object was scanned where it stands; the weight of one that is known stays, as far as it still fits.

        Args:
            item: in the frame of the assembly, with a weight that is assumed.
            stamp: ns of the scan; one that is not newer than the last scan, or than the last change of the object,
                changes nothing.
            notes: of the scan.

        Raises:
            InputError: EMPTY without an assembly, BAD_INPUT when the object is held or fixed.
        """
        before = self.objects.get(item.id)
        if stamp <= max(self.newest_scan, 0 if before is None else before.changed):
            return self
        if self.assembly is None:
            raise InputError(
                ErrorCode.EMPTY, "no assembly has been set: set the table or tray first, on which scanned objects stand"
            )
        source, remarks, lifted = WeightSource.ASSUMED, list(notes), None
        if before is not None:
            if before.where is Whereabouts.HELD:
                raise InputError(ErrorCode.BAD_INPUT, f"object {item.id} is in the hand: scan under another id")
            if before.item.fixed:
                raise InputError(ErrorCode.BAD_INPUT, f"object {item.id} is fixed: scan under another id")
            volume = before.item.shape.volume
            if abs(item.shape.volume / volume - 1) > _SAME_VOLUME:
                remarks.append("its volume is another one than before: it is taken for another object, and not weighed")
            elif before.source is not WeightSource.ASSUMED or before.lifted is not None:
                # The new object frame lies elsewhere in the object: of the weight, the mass alone still holds.
                lifted = before.item.mass, _mass_std(before.item)
                item = lifted_weight(item, *lifted)
                remarks.append("its mass is the one from before this scan; its centre of mass is not known")
        known = KnownObject(item, self.frame, source=source, changed=stamp, lifted=lifted, notes=tuple(remarks))
        return replace(self._with(known), newest_scan=stamp)

    # -- the hand ---------------------------------------------------------------------------------------------------

    def grasped(
        self,
        name: str,
        pose_hand_object: Pose,
        hand: str,
        stamp: int,
        item: RigidObject | None = None,
        lifted: tuple[float, float] | None = None,
    ) -> "World":
        """The fingers closed on an object. Something else that was held is lost: the hand holds one object.

        Args:
            name: its id.
            pose_hand_object: of the object frame in the hand's.
            hand: frame of the hand.
            stamp: ns of the event; one that is not newer than the last one changes nothing.
            item: the object, where the world does not know it.
            lifted: kg and standard deviation, by the wrench; None: not measured.

        Raises:
            InputError: OBJECT_UNKNOWN, BAD_INPUT for an object that is fixed.
        """
        if stamp <= self.newest_event:
            return self
        known = self.objects.get(name)
        if known is not None:
            item = known.item
        if item is None:
            raise InputError(ErrorCode.OBJECT_UNKNOWN, f"there is no object {name!r} to be held; scan or set it first")
        if item.fixed:
            raise InputError(ErrorCode.BAD_INPUT, f"object {name} is fixed, and cannot be in the hand")
        world, held = self, self.held
        if held is not None and held.item.id != name:
            gone = replace(held, where=Whereabouts.LOST, changed=stamp, notes=("it left the hand unseen",))
            world = world._with(gone)
        source = WeightSource.GIVEN if known is None else known.source
        notes = () if known is None else known.notes
        if lifted is not None:
            item, source, notes = _lifted(item, source, notes, lifted)
        since, again = stamp, known is not None and known.where is Whereabouts.HELD
        if known is not None and again:  # the same grasp, as its lift verified it
            since, lifted = known.changed, lifted or known.lifted
        held = KnownObject(replace(item, pose=pose_hand_object), hand, Whereabouts.HELD, source, since, lifted, notes)
        return replace(world._with(held), newest_event=stamp)

    def released(self, name: str, pose: Pose, stamp: int) -> "World":
        """The fingers opened, and the object stands.

        Args:
            name: its id.
            pose: of the object frame, in the frame of the assembly.
            stamp: as for `grasped`.

        Raises:
            InputError: OBJECT_UNKNOWN.
        """
        if stamp <= self.newest_event:
            return self
        known = self._movable(name)
        standing = replace(
            known, item=replace(known.item, pose=pose), frame=self.frame, where=Whereabouts.STANDING, changed=stamp
        )
        return replace(self._with(standing), newest_event=stamp)

    def lost(self, name: str, stamp: int, why: str) -> "World":
        """The object is neither in the hand nor known to stand anywhere; the arguments are those of `released`.

        Raises:
            InputError: OBJECT_UNKNOWN.
        """
        if stamp <= self.newest_event:
            return self
        gone = replace(self._movable(name), where=Whereabouts.LOST, changed=stamp, notes=(why,))
        return replace(self._with(gone), newest_event=stamp)

    def passed(self, stamp: int) -> "World":
        """An event of the hand was refused: the ones before it, which may still come, are history all the same."""
        return self if stamp <= self.newest_event else replace(self, newest_event=stamp)

    def weighed(self, item: RigidObject, since: int) -> "World":
        """The held object has the weight of an estimate.

        Args:
            item: the object with that weight and its covariance.
            since: ns, the oldest sample of the estimate.

        Raises:
            InputError: OBJECT_UNKNOWN when another object or none is held; SENSOR_STALE when samples from before the
                grasp are in it; NOT_CONSISTENT when it is not the mass that was lifted.
        """
        held = self.held
        if held is None or held.item.id != item.id:
            raise InputError(ErrorCode.OBJECT_UNKNOWN, f"object {item.id} is not in the hand: it was not weighed")
        if since < held.changed - _EARLY * 1e9:
            raise InputError(
                ErrorCode.SENSOR_STALE,
                f"the estimate has samples from before {item.id} was grasped: wait",
            )
        if held.lifted is not None:
            mass, std = held.lifted
            most = _SIGMAS * float(np.hypot(std, _mass_std(item))) + _MASS_TOLERANCE * mass
            if abs(item.mass - mass) > most:
                raise InputError(
                    ErrorCode.NOT_CONSISTENT,
                    f"the estimate is {item.mass:.3g} kg, and {mass:.3g} kg were lifted with {item.id}: zero the sensor"
                    " with the empty hand, so that the estimate is of the object alone",
                )
        item = replace(item, pose=held.item.pose)
        return self._with(replace(held, item=item, source=WeightSource.WEIGHED, notes=()))

    def _movable(self, name: str) -> KnownObject:
        known = self.objects.get(name)
        if known is None or known.item.fixed:
            what = "there is no object" if known is None else "it is fixed:"
            raise InputError(ErrorCode.OBJECT_UNKNOWN, f"{what} {name!r}; scan or set it first")
        return known

    def _with(self, known: KnownObject) -> "World":
        before = self.objects.get(known.item.id)
        stood = before is not None and before.where is Whereabouts.STANDING
        changes = stood or known.where is Whereabouts.STANDING
        objects = {**self.objects, known.item.id: known}
        return replace(self, objects=objects, version=self.version + changes)


def _mass_std(item: RigidObject) -> float:
    """kg; 0 for a weight that is known exactly."""
    return 0.0 if item.covariance is None else float(np.sqrt(max(item.covariance[0, 0], 0.0)))


def _lifted(
    item: RigidObject, source: WeightSource, notes: tuple[str, ...], lifted: tuple[float, float]
) -> tuple[RigidObject, WeightSource, tuple[str, ...]]:
    """The object with what its lift says; a weight that agrees stays."""
    mass, std = lifted
    most = _SIGMAS * float(np.hypot(std, _mass_std(item))) + _MASS_TOLERANCE * item.mass
    if source is not WeightSource.ASSUMED and abs(mass - item.mass) <= most:
        return item, source, notes
    remark = "its mass was measured at the lift; its centre of mass was not"
    if source is not WeightSource.ASSUMED:
        remark = f"{mass:.3g} kg were lifted, and {item.mass:.3g} kg were believed: the lifted mass holds"
    return lifted_weight(item, mass, std), WeightSource.ASSUMED, (*notes, remark)
