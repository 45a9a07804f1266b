"""Whether an object can be taken where it lies and put where it shall stand: room for the hand, and for the arm."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from poise.assembly import Analysis, RigidObject
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import unit
from poise.manipulation.approach import approach_directions
from poise.manipulation.arm import Arm
from poise.manipulation.bodies import geometry_of, overlap, se3_of
from poise.manipulation.cell import HELD_CLEARANCE, ROBOT_CLEARANCE, Cell
from poise.manipulation.grasps import APPROACH_SIDES, antipodal_grasps
from poise.manipulation.hand import Grasp
from poise.manipulation.inverse import follow, solutions
from poise.manipulation.probing import probed_grasps
from poise.placement import PlacementTest, PoseTest, require_new
from poise.types import Array

_STRAIGHT_STEP = 0.01
TOUCHING = 0.01
"""m from its support over which what is held is not asked whether it touches: it does."""
_FAR = 0.04
"""m from all contacts: far enough."""
_FIRM = 20.0
"""m/s2 that a grip withstands: firm enough."""
_LEAST_HOLD = 1.0
"""m/s2 that a grip has to bear besides gravity."""
_MOST_GRASPS = 16
"""Grasps that the arm is asked about for one place, of those with room for the hand."""
_DIRECTIONS = 4
"""Directions of approach that are tried, the most forgiving first."""

Margins = tuple[float, float]
"""m, of the robot and of what it holds from everything else, on the straight ways."""
NARROW: Margins = (ROBOT_CLEARANCE, HELD_CLEARANCE)


class GraspSearch(NamedTuple):
    """How hard it is tried to pick something up.

    Args:
        sides: from which each place of the object is grasped.
        tries: starts of the inverse kinematics.
        straight: m of the ways to and from the object.
    """

    sides: int
    tries: int
    straight: float


_USUAL = GraspSearch(APPROACH_SIDES, 8, 0.08)
UTMOST = GraspSearch(24, 24, 0.05)
"""When nothing else picks it up. The way is longer than the fingers still."""


@dataclass(frozen=True, eq=False)
class End:
    """The arm at one end of a transfer, with the straight ways that begin there.

    Args:
        hand_away: (N, J) from the grasp back along the hand, fingers open.
        object_away: (N, J) from the grasp to where the object is clear of its support.
    """

    hand_away: Array
    object_away: Array


@dataclass(frozen=True, eq=False)
class Ends:
    """A grasp that serves at both ends.

    Args:
        grasp: of the object.
        pick, place: the arm there.
        approach: (3,) unit vector along which the object comes to its place.
        forgiving: N, least robustness of its neighbours to pushes along it.
        hold: m/s2 that the grip withstands.
    """

    grasp: Grasp
    pick: End
    place: End
    approach: Array
    forgiving: float
    hold: float


class Reach:
    """Asks for one object, at the pose where it lies; remembers what it has found out about grasps there.

    Args:
        arm: the robot.
        before: the assembly without the object.
        item: the object where it is picked up.
        others: what else stands around.
        start: (J,) where the arm is; None: the middle of its range.
        seed: of the inverse kinematics.
    """

    held = False
    """It is in the hand."""

    def __init__(
        self,
        arm: Arm,
        before: Analysis,
        item: RigidObject,
        others: Sequence[RigidObject] = (),
        start: Array | None = None,
        seed: int = 0,
    ) -> None:
        self.arm, self.item, self.before = arm, item, before
        self.around = (*before.assembly.objects, *others)
        self.start = (arm.lower + arm.upper) / 2 if start is None else start
        self._seed = seed
        self._up = -unit(np.asarray(before.assembly.gravity))
        self._known: dict[bytes, Ends | None] = {}
        self._fits: dict[bytes, bool] = {}
        for self._effort in (_USUAL, UTMOST):
            self._firm = self._firm_grasps(self._effort.sides)
            self._picks: dict[tuple[int, Margins], End | None] = {}
            if self.can_pick():
                break

    @property
    def looks(self) -> tuple[tuple[str, PoseTest], ...]:
        """For `Options.looks`: what is known before contacts are."""
        return (("leaves no room for the hand", self.fits_hand),)

    def require_free_start(self) -> None:
        """Check that the arm, where it is, keeps its distance from everything.

        Raises:
            NoAnswerError: INTERPENETRATION, naming two shapes.
        """
        touching = Cell(self.arm, (*self.around, self.item), 0.0).touching(self.start)
        if touching is not None:
            raise NoAnswerError(
                ErrorCode.INTERPENETRATION,
                f"where the arm is, {touching[0]} touches {touching[1]}, or nearly: move it away, or correct base",
            )

    @property
    def tests(self) -> tuple[tuple[str, PlacementTest], ...]:
        """For `Options.tests`: the cheap one first."""
        return (("leaves no room for the hand", self.has_room), ("out of the arm's reach", self.is_reachable))

    def can_pick(self) -> bool:
        """Whether the arm can take the object from where it lies."""
        return any(self._pick(number, NARROW) is not None for number in range(2 * len(self._firm)))

    def picks(self, margins: Margins = NARROW) -> Iterator[tuple[Grasp, float, End]]:
        """Grasps that the arm can take it with from where it lies, and the m/s2 that they bear; the firm ones first."""
        holds = np.array([hold for _, hold in self._firm])
        for index in np.argsort(-np.minimum(holds, _FIRM), kind="stable").tolist():
            for number in (2 * index, 2 * index + 1):
                pick = self._pick(number, margins)
                if pick is not None:
                    yield self._grasp(number), float(holds[index]), pick

    def require_pick(self) -> None:
        """PoseTest whether the object can be picked up: when it cannot, there is no need to look for a place.

        Raises:
            NoAnswerError: UNREACHABLE, with data `step`: grasping, and `cause`: too_wide, too_heavy, no_room_for_hand
                or out_of_reach.
        """
        if not self.can_pick():
            cause, why = self._no_grasp
            if self._firm:
                cause, why = "out_of_reach", f"none of {len(self._firm)} grasps can be reached"
            message = f"{self.item.id} cannot be picked up where it lies: {why}; make room there, or move the arm"
            raise NoAnswerError(ErrorCode.UNREACHABLE, message, step="grasping", cause=cause)

    def fits_hand(self, placed: RigidObject) -> bool:
        """Whether the hand fits to the object, there, by a grasp that the arm can pick it up with; found once."""
        key = placed.pose.vector.tobytes()
        if key not in self._fits:
            self._fits[key] = self._finds_room(placed)
        return self._fits[key]

    def _finds_room(self, placed: RigidObject) -> bool:
        if not self.can_pick():  # then the arm is to blame, and not the place
            return any(self._hand_is_clear(grasp, placed) for grasp, _ in self._firm)
        return next(self._serving(placed, np.zeros((0, 3)), NARROW), None) is not None

    def has_room(self, _: Analysis, placed: RigidObject) -> bool:
        """As `fits_hand`, for who asks tests only."""
        return self.fits_hand(placed)

    def is_reachable(self, after: Analysis, placed: RigidObject) -> bool:
        """Whether the arm can put the object there."""
        return self.ends(after, placed) is not None

    def ends(self, after: Analysis, placed: RigidObject) -> Ends | None:
        """The best grasp and what goes with it, or None; found once for every place."""
        key = placed.pose.vector.tobytes()
        if key not in self._known:
            self._known[key] = next(self.all_ends(after, placed), None)
        return self._known[key]

    def all_ends(self, after: Analysis, placed: RigidObject, margins: Margins = NARROW) -> Iterator[Ends]:
        """Grasps that serve at both ends, those far from the contacts and firm ones first."""

        @cache
        def directions() -> list[tuple[Array, float]]:
            return approach_directions(self.before, after, placed, _DIRECTIONS)

        def aways() -> list[Array]:
            return [-way for way, _ in directions()]

        serving = self._serving(placed, _contacts(after, placed), margins)
        for number, (grasp, hold, pick) in enumerate(serving):
            if number >= 2 * _MOST_GRASPS:
                return
            found = next(self._end(grasp, placed, aways, pick.object_away[-1], margins), None)
            if found is not None:
                yield Ends(grasp, pick, found[0], *directions()[found[1]], hold)

    def _firm_grasps(self, sides: int) -> list[tuple[Grasp, float]]:
        """Grasps that hold it, with room for the hand where it lies, and the m/s2 that they bear."""
        gravity = float(np.linalg.norm(self.before.assembly.gravity))
        hand, item = self.arm.hand, self.item
        grasps = antipodal_grasps(item.shape, hand, sides)
        grasps += probed_grasps(item.shape, hand, item.pose.rotation.T @ self._up)
        holds = [(grasp, hand.acceleration_limit(item, grasp.object_tcp, gravity)) for grasp in grasps]
        firm = [(grasp, hold) for grasp, hold in holds if hold > _LEAST_HOLD]
        self._no_grasp = "no_room_for_hand", f"there is no room for the hand at any of its {len(firm)} grasps"
        if not grasps:
            self._no_grasp = (
                "too_wide",
                f"too wide: it has no flat opposite faces at most {1e3 * hand.widest:.0f} mm apart, as far as the"
                " fingers open",
            )
        elif not firm:
            self._no_grasp = "too_heavy", f"too heavy: with {item.mass:.3g} kg it slips from the fingers at every grasp"
        return [(grasp, hold) for grasp, hold in firm if self._hand_is_clear(grasp, item)]

    def _serving(self, placed: RigidObject, contacts: Array, margins: Margins) -> Iterator[tuple[Grasp, float, End]]:
        """Grasps that it can be picked up with and with room for the hand at the place, in order, and the pick."""

        def score(entry: tuple[Grasp, float]) -> float:
            grasp, hold = entry
            spot = placed.pose.apply(np.array(grasp.object_tcp.translation))
            nearest = np.linalg.norm(contacts - spot, axis=1).min(initial=_FAR)
            return float(nearest / _FAR + 0.5 * min(hold, _FIRM) / _FIRM)

        scores = np.array([score(entry) for entry in self._firm])
        for index in np.argsort(-scores, kind="stable").tolist():
            grasp, hold = self._firm[index]
            if not self._hand_is_clear(grasp, placed):
                continue
            for number in (2 * index, 2 * index + 1):
                pick = self._pick(number, margins)
                if pick is not None:
                    yield self._grasp(number), hold, pick

    def _hand_is_clear(self, grasp: Grasp, item: RigidObject) -> bool:
        """Whether the open hand touches neither the object nor what stands around."""
        hand = self.arm.hand
        tool = se3_of(item.pose) * grasp.object_tcp
        parts = [*self.arm.palm, *hand.fingers(hand.opening(grasp.width))]
        return not any(
            overlap(shape, tool * place, geometry_of(other.shape), se3_of(other.pose), ROBOT_CLEARANCE)
            for other in (item, *self.around)
            for shape, place in parts
        )

    def _grasp(self, number: int) -> Grasp:
        """Each of the firm grasps comes twice: both ways round."""
        grasp = self._firm[number // 2][0]
        return grasp.turned if number % 2 else grasp

    def _pick(self, number: int, margins: Margins) -> End | None:
        """The arm at a grasp where the object lies; found once."""
        key = number, margins
        if key not in self._picks:
            found = self._end(self._grasp(number), self.item, lambda: [self._up], self.start, margins)
            self._picks[key] = next((end for end, _ in found), None)
        return self._picks[key]

    def _end(
        self, grasp: Grasp, item: RigidObject, aways: Callable[[], list[Array]], start: Array, margins: Margins
    ) -> Iterator[tuple[End, int]]:
        """The arm at a grasp, with free ways back for the hand alone, and for the object in one of some directions."""
        tool = se3_of(item.pose) * grasp.object_tcp

        @cache
        def open_hand() -> Cell:
            return self.open_cell(grasp, item, margins)

        @cache
        def closed() -> list[Cell]:
            return [Cell(self.arm, self.around, grasp.width, held, margins) for held in (None, (item, grasp))]

        rng = np.random.default_rng(self._seed)
        for q in solutions(self.arm, tool, [start, self.start], rng, self._effort.tries):
            if not open_hand().free(q):
                continue
            hand_away = follow(self.arm, q, self._straight(tool, -np.array(tool.rotation[:, 2])))
            if hand_away is None or not is_free(hand_away, open_hand()):
                continue
            bare, carrying = closed()
            for number, away in enumerate(aways()):
                object_away = follow(self.arm, q, self._straight(tool, away))
                if object_away is None or not bare.free_between(q, object_away[1]):
                    continue
                if is_free(object_away[1:], carrying):
                    yield End(hand_away, object_away), number

    def _straight(self, tool: pin.SE3, direction: Array) -> list[pin.SE3]:
        """Poses of the tool along a straight way."""
        length = self._effort.straight
        offsets = np.append(np.arange(TOUCHING, length - 1e-9, _STRAIGHT_STEP), length)
        return [pin.SE3(tool.rotation, tool.translation + offset * direction) for offset in offsets]

    def open_cell(self, grasp: Grasp, item: RigidObject, margins: Margins = NARROW) -> Cell:
        """The arm with the hand open for a grasp, and the object standing there."""
        return Cell(self.arm, (*self.around, item), self.arm.hand.opening(grasp.width), margins=margins)


def require_room(analysis: Analysis, item: RigidObject) -> None:
    """Check that an object, where it lies, overlaps nothing of an assembly and is no part of it.

    Raises:
        InputError: BAD_INPUT, INTERPENETRATION.
    """
    require_new(analysis.assembly.objects, item)
    try:
        analysis.with_object(item)
    except InputError as error:
        if error.code is not ErrorCode.FLOATING:  # it may lie on something that the scene does not have
            raise


def is_free(way: Array, cell: Cell) -> bool:
    """Whether a way (N, J) touches nothing, its first point included."""
    return cell.free(way[0]) and all(cell.free_between(a, b) for a, b in pairwise(way))


def _contacts(analysis: Analysis, item: RigidObject) -> Array:
    """(N, 3) corners of where an object touches others, m."""
    place = analysis.assembly.place_of(item.id)
    points = [i.points for i in analysis.structure.interfaces if place in (i.first, i.second)]
    return np.concatenate(points) if points else np.zeros((0, 3))
