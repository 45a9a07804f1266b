"""Whether an object can be taken where it lies and put where it shall stand: room for the hand, and for the arm."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin

from poise.assembly.analysis import Analysis
from poise.assembly.geometry import Array, unit
from poise.assembly.scene import RigidObject
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.manipulation.approach import approach_directions
from poise.manipulation.arm import Arm
from poise.manipulation.bodies import geometry_of, overlap, se3_of
from poise.manipulation.cell import MARGIN, Cell
from poise.manipulation.grasps import antipodal_grasps
from poise.manipulation.hand import Grasp
from poise.manipulation.inverse import follow, solutions
from poise.placement.validation import Test

STRAIGHT = 0.08
"""m of the straight ways to and from an object."""
STRAIGHT_STEP = 0.01
TOUCHING = 0.01
"""m from its support over which what is held is not asked whether it touches: it does."""
FAR = 0.04
"""m from all contacts: far enough."""
FIRM = 20.0
"""m/s2 that a grip bears: firm enough."""
LEAST_HOLD = 1.0
"""m/s2 that a grip has to bear besides gravity."""
MOST_GRASPS = 16
"""Grasps that the arm is asked about for one place, of those with room for the hand."""
DIRECTIONS = 4
"""Directions of approach that are tried, the most forgiving first."""


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
        hold: m/s2 that the grip bears.
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
        gravity = float(np.linalg.norm(before.assembly.gravity))
        holds = (
            (g, arm.hand.acceleration_limit(item, g.object_tcp, gravity))
            for g in antipodal_grasps(item.shape, arm.hand)
        )
        self._grasps = [
            (grasp, hold) for grasp, hold in holds if hold > LEAST_HOLD and self._hand_is_clear(grasp, item)
        ]
        self._picks: dict[int, End | None] = {}
        self._known: dict[bytes, Ends | None] = {}

    def require_free_start(self) -> None:
        """Check that the arm, where it is, keeps its distance from everything.

        Raises:
            NoAnswerError: INTERPENETRATION, naming two shapes.
        """
        touching = Cell(self.arm, (*self.around, self.item), 0.0).touching(self.start)
        if touching is not None:
            raise NoAnswerError(
                ErrorCode.INTERPENETRATION,
                f"where the arm is, {touching[0]} touches {touching[1]}, or nearly: move it away, or mend base",
            )

    @property
    def tests(self) -> tuple[tuple[str, Test], ...]:
        """For `Options.tests`: the cheap one first."""
        return (("leaves no room for the hand", self.has_room), ("out of the arm's reach", self.is_reachable))

    def has_room(self, _: Analysis, placed: RigidObject) -> bool:
        """Whether the hand fits to the object, at its place, by a grasp that fits where it lies."""
        return next(self._with_room(placed, np.zeros((0, 3))), None) is not None

    def is_reachable(self, after: Analysis, placed: RigidObject) -> bool:
        """Whether the arm can put the object there."""
        return self.ends(after, placed) is not None

    def ends(self, after: Analysis, placed: RigidObject) -> Ends | None:
        """The best grasp and what goes with it, or None; found once for every place."""
        key = placed.pose.vector.tobytes()
        if key not in self._known:
            self._known[key] = next(self.all_ends(after, placed), None)
        return self._known[key]

    def all_ends(self, after: Analysis, placed: RigidObject) -> Iterator[Ends]:
        """Grasps that serve at both ends, those far from the contacts and firm ones first."""
        contacts = _contacts(after, placed)
        directions = approach_directions(self.before, after, placed)[:DIRECTIONS]
        for number, (index, turned, grasp, hold) in enumerate(self._with_room(placed, contacts)):
            if number >= 2 * MOST_GRASPS:
                return
            pick = self._pick(2 * index + turned, grasp)
            if pick is None:
                continue
            found = next(self._end(grasp, placed, [-way for way, _ in directions], pick.object_away[-1]), None)
            if found is not None:
                yield Ends(grasp, pick, found[0], *directions[found[1]], hold)

    def _with_room(self, placed: RigidObject, contacts: Array) -> Iterator[tuple[int, bool, Grasp, float]]:
        """Grasps with room for the hand at the place, in order, each both ways round."""

        def score(entry: tuple[Grasp, float]) -> float:
            grasp, hold = entry
            spot = placed.pose.apply(np.array(grasp.object_tcp.translation))
            nearest = np.linalg.norm(contacts - spot, axis=1).min(initial=FAR)
            return float(nearest / FAR + 0.5 * min(hold, FIRM) / FIRM)

        scores = np.array([score(entry) for entry in self._grasps])
        for index in np.argsort(-scores, kind="stable").tolist():
            grasp, hold = self._grasps[index]
            if self._hand_is_clear(grasp, placed):
                yield index, False, grasp, hold
                yield index, True, grasp.turned, hold

    def _hand_is_clear(self, grasp: Grasp, item: RigidObject) -> bool:
        """Whether the open hand touches neither the object nor what stands around."""
        hand = self.arm.hand
        tool = se3_of(item.pose) * grasp.object_tcp
        parts = [*self.arm.palm, *hand.fingers(hand.opening(grasp.width))]
        return not any(
            overlap(shape, tool * place, geometry_of(other.shape), se3_of(other.pose), MARGIN)
            for other in (item, *self.around)
            for shape, place in parts
        )

    def _pick(self, key: int, grasp: Grasp) -> End | None:
        if key not in self._picks:
            self._picks[key] = next((end for end, _ in self._end(grasp, self.item, [self._up], self.start)), None)
        return self._picks[key]

    def _end(self, grasp: Grasp, item: RigidObject, aways: Sequence[Array], start: Array) -> Iterator[tuple[End, int]]:
        """The arm at a grasp, with free ways back for the hand alone, and for the object in one of some directions."""
        tool = se3_of(item.pose) * grasp.object_tcp
        open_hand = self.open_cell(grasp, item)
        bare, carrying = (Cell(self.arm, self.around, grasp.width, held) for held in (None, (item, grasp)))
        rng = np.random.default_rng(self._seed)
        for q in solutions(self.arm, tool, [start, self.start], rng):
            if not open_hand.free(q):
                continue
            hand_away = follow(self.arm, q, _straight(tool, -np.array(tool.rotation[:, 2])))
            if hand_away is None or not is_free(hand_away, open_hand):
                continue
            for number, away in enumerate(aways):
                object_away = follow(self.arm, q, _straight(tool, away))
                if object_away is None or not bare.free_between(q, object_away[1]):
                    continue
                if is_free(object_away[1:], carrying):
                    yield End(hand_away, object_away), number

    def open_cell(self, grasp: Grasp, item: RigidObject) -> Cell:
        """The arm with the hand open for a grasp, and the object standing there."""
        return Cell(self.arm, (*self.around, item), self.arm.hand.opening(grasp.width))


def require_room(analysis: Analysis, item: RigidObject) -> None:
    """Check that an object, where it lies, overlaps nothing of an assembly and is no part of it.

    Raises:
        InputError: BAD_INPUT, INTERPENETRATION.
    """
    if item.id in analysis.assembly.index or item.fixed:
        raise InputError(
            ErrorCode.BAD_INPUT, f"object {item.id}: give it a mass and an id that is not in the scene yet"
        )
    try:
        analysis.with_object(item)
    except InputError as error:
        if error.code is not ErrorCode.FLOATING:  # it may lie on something that the scene does not have
            raise


def is_free(way: Array, cell: Cell) -> bool:
    """Whether a way (N, J) touches nothing, its first point included."""
    return cell.free(way[0]) and all(cell.free_between(a, b) for a, b in pairwise(way))


def _straight(tool: pin.SE3, direction: Array) -> list[pin.SE3]:
    """Poses of the tool along a straight way."""
    offsets = np.append(np.arange(TOUCHING, STRAIGHT, STRAIGHT_STEP), STRAIGHT)
    return [pin.SE3(tool.rotation, tool.translation + offset * direction) for offset in offsets]


def _contacts(analysis: Analysis, item: RigidObject) -> Array:
    """(N, 3) corners of where an object touches others, m."""
    place = analysis.assembly.place_of(item.id)
    points = [i.points for i in analysis.structure.interfaces if place in (i.first, i.second)]
    return np.concatenate(points) if points else np.zeros((0, 3))
