"""The world of a simulated robot: objects that its hand grasps, carries and puts down, quasi-statically."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from poise.assembly import Analysis, Assembly, RigidObject
from poise.errors import ErrorCode, InputError
from poise.fake_robots.grip import Pads, Squeeze, squeeze
from poise.fake_robots.settling import Surroundings, come_to_rest
from poise.geometry import Pose, rotation_about
from poise.inertia import InertialParameters
from poise.types import Array

_OPENED = 2e-4
"""m by which the fingers have to open to let go."""
_STIFFNESS = 2e4
"""N/m of hand and support together, where a held body still touches something."""
_NEAR = 0.004
"""m over a support from which on the reaction is looked for."""
_LEAN = 0.05
"""rad of a change of attitude after which what stands on the held body is looked at."""
_CALM, _SAME = 0.05, 0.02
"""m/s2 of the base below which it dislodges nothing, and between which accelerations count as one."""
_PIVOTING = 4.0
"""rad/s of a body that turns between the pads."""


class Hand(NamedTuple):
    """What the hand does at a time, s.

    Args:
        time: s.
        tool, base: poses of the tool frame, and of the base that carries objects, in the world.
        opening: m between the fingers.
        force: N with which they press when something stops them; 0: they do not close.
    """

    time: float
    tool: Pose
    base: Pose
    opening: float
    force: float


class Held(NamedTuple):
    """What hand and sensor feel at a time.

    Args:
        time: s.
        id: of the body between the fingers; empty: none.
        opening: m at which it stops the fingers.
        phi_in_tool: (10,) m, m c, I of the body about the tool frame's origin.
        reaction: N upwards that something under it still exerts on it.
        point: (3,) m in the world, where.
    """

    time: float
    id: str = ""
    opening: float = 0.0
    phi_in_tool: Array = np.zeros(10)
    reaction: float = 0.0
    point: Array = np.zeros(3)


class World(Protocol):
    """Objects around a hand, moved on in steps of time."""

    remarks: list[str]
    """What happened to them, a sentence each, since they were read last."""

    def reset(self) -> None:
        """Be as at the beginning."""

    def advance(self, hand: Hand) -> Held:
        """Go on to the time of the hand's state."""

    @property
    def objects(self) -> Mapping[str, RigidObject]:
        """All objects that are left, at their poses in the world."""


@dataclass
class _Grasp:
    """A body between the pads."""

    tool_object: Pose
    squeeze: Squeeze
    upright: Array  # (3,) of the world in the tool frame, when what stands on the body was looked at last
    lifted: bool = False
    pressed: float = 0.0  # m that the support is pressed together by the body's own weight
    loads: set[str] = field(default_factory=set)  # what stands on it, and moves with it


class QuasistaticWorld:
    """Bodies without momentum: what nothing holds falls to where it rests, at once.

    After each change the assembly engine decides which bodies stand; those that do not fall. Between the pads a body
    bears what two discs bear (Howe and Cutkosky 1996); more torque turns it, more force takes it out. Only the body
    in the hand is moved by the hand: what it bumps into stays.

    Args:
        assembly: at the beginning, in the world frame, whose z axis points up.
        pads: of the fingers.
        riding: ids of fixed objects that the base carries. What stands on them rides along, as long as the assembly
            engine finds it stable under the acceleration of the base; else it slides, with the friction of the scene.
    """

    def __init__(self, assembly: Assembly, pads: Pads, riding: tuple[str, ...] = ()) -> None:
        for name in riding:
            assembly.place_of(name)
        self._beginning, self._pads, self._first_riders = assembly, pads, riding
        self.remarks: list[str] = []
        self.reset()

    def reset(self) -> None:
        """Be as at the beginning."""
        self._bodies = {item.id: item for item in self._beginning.objects}
        self._riders = set(self._first_riders)
        self._held: str = ""
        self._grasp: _Grasp | None = None
        self._widest = np.inf  # m between the fingers when they began to close
        self._before: tuple[Hand | None, Hand | None] = (None, None)
        self._sliding: dict[str, Array] = {}  # velocities of what the base has dislodged, m/s
        self._stands: dict[tuple[Any, ...], set[str]] = {}  # which riders an acceleration dislodges
        self._velocity = np.zeros(3)
        self._riders = self._standing_on(self._riders)

    @property
    def objects(self) -> Mapping[str, RigidObject]:
        """All objects that are left, at their poses in the world."""
        return self._bodies

    def advance(self, hand: Hand) -> Held:
        """Go on to the time of the hand's state."""
        first, before, self._before = self._before[0] or hand, self._before[1] or hand, (self._before[1] or hand, hand)
        self._ride((hand.base, before.base, first.base), max(hand.time - before.time, 1e-6))
        if self._grasp is not None and hand.opening > self._grasp.squeeze.width + _OPENED:
            self._let_go("the fingers opened")
        if self._grasp is not None:
            self._carry(before, hand)
        elif hand.force > 0 and hand.opening < before.opening:
            self._close(self._widest, hand)
        else:
            self._widest = hand.opening
        return self._felt(hand)

    # -- between the pads -----------------------------------------------------------------------------------------

    def _close(self, widest: float, hand: Hand) -> None:
        """Look whether both fingers touch a body; widest: m, where they began to close."""
        for name, item in self._bodies.items():
            if item.fixed or np.linalg.norm(item.com_in_world - hand.tool.translation) > 1.0:
                continue
            corners = hand.tool.undo(item.vertices)[item.shape.polyhedron.triangles]
            found = squeeze(corners, self._pads)
            if found is None or found.width < hand.opening or max(-found.low, found.high) > widest / 2 + _OPENED:
                continue  # it is not there, not reached yet, or not between the fingers
            if not found.firm:
                self.remarks.append(f"{hand.time:.2f} s: {name} slips out of the closing fingers")
                continue
            # The finger that comes first pushes it until both touch.
            middle = (found.low + found.high) / 2
            centred = Pose(item.pose.rotation, item.pose.translation - middle * hand.tool.rotation[:, 1])
            moved = replace(item, pose=centred)
            at_middle = replace(found, centre=found.centre - [0.0, middle, 0.0])
            gap = self._gap_under(moved)
            rests = abs(gap) < 5e-4
            self._bodies[name] = moved
            self._held = name
            weight = item.mass * self._gravity
            grasp = _Grasp(
                hand.tool.inverse @ centred,
                at_middle,
                hand.tool.rotation[2],
                not rests,
                weight / _STIFFNESS + gap if rests else 0.0,
            )
            grasp.loads = self._borne_by(name)
            self._grasp = grasp
            return

    def _carry(self, before: Hand, hand: Hand) -> None:
        grasp, item = self._grasp, self._bodies[self._held]
        if grasp is None:
            return
        step = max(hand.time - before.time, 1e-6)
        velocity = (hand.tool.translation - before.tool.translation) / step
        acceleration, self._velocity = (velocity - self._velocity) / step, velocity
        share, torque = self._load_on_pads(item, grasp, hand, acceleration)
        if share > 1 and grasp.lifted:
            self._let_go("it is too heavy for the grip")
            return
        if abs(torque) > 1 and grasp.lifted:
            turn = rotation_about(np.array([0.0, 1.0, 0.0]), np.sign(torque) * _PIVOTING * step)
            centre = grasp.squeeze.centre
            turned = Pose(turn, centre - turn @ centre)
            grasp.tool_object = turned @ grasp.tool_object
        moved = hand.tool @ grasp.tool_object
        for name in grasp.loads & self._bodies.keys():
            self._bodies[name] = replace(self._bodies[name], pose=moved @ item.pose.inverse @ self._bodies[name].pose)
        self._bodies[self._held] = replace(item, pose=moved)
        if grasp.loads and hand.tool.rotation[2] @ grasp.upright < np.cos(_LEAN):
            grasp.upright = hand.tool.rotation[2]
            self._settle()
            grasp.loads &= self._standing_on({self._held})

    def _load_on_pads(self, item: RigidObject, grasp: _Grasp, hand: Hand, acceleration: Array) -> tuple[float, float]:
        """Shares of the force across, and of the torque about the closing direction, that the pads bear."""
        force = item.mass * (np.array([0.0, 0.0, -self._gravity]) - acceleration)
        in_tool = force @ hand.tool.rotation
        lever = hand.tool.undo(item.com_in_world) - grasp.squeeze.centre
        torque = lever[2] * in_tool[0] - lever[0] * in_tool[2]
        most = max(2 * self._pads.friction * hand.force, 1e-9)
        share = float(np.hypot(in_tool[0], in_tool[2]) / most)
        return share, float(torque / (most * 2 / 3 * self._pads.radius * np.sqrt(max(1 - min(share, 1.0) ** 2, 1e-6))))

    def _let_go(self, why: str) -> None:
        name, self._held, self._grasp = self._held, "", None
        self._velocity = np.zeros(3)
        self.remarks.append(f"{name} is released: {why}")
        self._fall(name)
        self._settle()

    def _felt(self, hand: Hand) -> Held:
        grasp = self._grasp
        if grasp is None:
            return Held(hand.time)
        item = self._bodies[self._held]
        loads = [self._bodies[name] for name in grasp.loads if name in self._bodies] if grasp.lifted else []
        phi = np.sum([self._phi_in_tool(each, hand.tool) for each in (item, *loads)], axis=0)
        gap = self._gap_under(item)
        reaction = _STIFFNESS * max(grasp.pressed - gap, 0.0) if gap < _NEAR else 0.0
        if reaction == 0.0 and not grasp.lifted:
            grasp.lifted, grasp.pressed = True, 0.0
            self._riders -= {self._held, *grasp.loads}
            self._settle()  # what leaned on it
            grasp.loads &= self._standing_on({self._held})
        point = np.array([*item.com_in_world[:2], item.vertices[:, 2].min()])
        return Held(hand.time, self._held, grasp.squeeze.width, phi, reaction, point)

    def _phi_in_tool(self, item: RigidObject, tool: Pose) -> Array:
        about_com = tool.rotation.T @ item.inertia_in_world @ tool.rotation
        return InertialParameters(item.mass, tool.undo(item.com_in_world), about_com).phi

    # -- of the others --------------------------------------------------------------------------------------------

    @property
    def _gravity(self) -> float:
        return float(np.linalg.norm(self._beginning.gravity))

    def _gap_under(self, item: RigidObject) -> float:
        """m to what is under a body; what lies on it does not count."""
        middle = item.com_in_world[2]
        under = [body for name, body in self._bodies.items() if name != item.id and body.vertices[:, 2].min() < middle]
        return Surroundings(under).gap(item, _NEAR)

    def _fall(self, name: str) -> None:
        others = [item for other, item in self._bodies.items() if other != name]
        rested = come_to_rest(self._bodies[name], others)
        if rested is None:
            self.remarks.append(f"{name} has fallen out of the world")
            del self._bodies[name]
        else:
            self._bodies[name] = rested
        self._riders.discard(name)

    def _settle(self) -> None:
        """Let fall what does not stand, the lowest first, until everything stands."""
        for _ in range(len(self._bodies)):
            falling = [name for name in self._falling() if name in self._bodies]
            if not falling:
                break
            lowest = min(falling, key=lambda name: self._bodies[name].com_in_world[2])
            before = self._bodies[lowest].pose.vector
            self._fall(lowest)
            if lowest in self._bodies and np.allclose(before, self._bodies[lowest].pose.vector, atol=1e-3):
                break  # it rests, although not by the engine's account
        self._riders = self._standing_on({name for name in self._riders if name in self._first_riders})

    def _falling(self) -> tuple[str, ...]:
        # What is held stands as far as the others are concerned.
        standing = tuple(
            replace(item, fixed=True) if name == self._held else item for name, item in self._bodies.items()
        )
        pairs = [pair for pair in self._beginning.friction_pairs if self._bodies.keys() >= set(pair.objects)]
        try:
            analysis = Analysis.of(replace(self._beginning, objects=standing, friction_pairs=tuple(pairs)))
            return analysis.stability().falling
        except InputError as error:
            if error.code is ErrorCode.FLOATING:
                return tuple(error.data["objects"])
            self.remarks.append(error.message)  # of bodies that overlap, nothing can be said
            return ()

    # -- on the base ----------------------------------------------------------------------------------------------

    def _borne_by(self, name: str) -> set[str]:
        """What stands on a body, and on nothing else."""
        loads = self._standing_on({name}) - {name}
        while True:
            others = [item for other, item in self._bodies.items() if other not in {name, *loads}]
            around = Surroundings(others)
            shared = {load for load in loads if abs(around.gap(self._bodies[load], 1e-3)) < 5e-4}
            if not shared:
                return loads
            loads -= shared

    def _standing_on(self, carriers: set[str]) -> set[str]:
        """The carriers, and what touches one of them from above, and so on."""
        found = set(carriers)
        while True:
            around = Surroundings([self._bodies[name] for name in found if name in self._bodies])
            more = {
                name
                for name, item in self._bodies.items()
                if name not in found and not item.fixed and name != self._held and abs(around.gap(item, 1e-3)) < 5e-4
            }
            if not more:
                return found
            found |= more

    def _ride(self, bases: tuple[Pose, Pose, Pose], step: float) -> None:
        """Move what rides along with the base; what its acceleration dislodges slides.

        Args:
            bases: its poses now and at the two times before, latest first.
            step: s between them.
        """
        now, before, first = bases
        riders = self._riders & self._bodies.keys()
        if not riders or all(pose is now for pose in bases):
            return
        middle = np.mean([self._bodies[name].com_in_world for name in riders], axis=0)
        own = before.undo(middle)
        velocity = (now.apply(own) - middle) / step
        acceleration = (velocity - (middle - first.apply(own)) / step) / step
        if np.linalg.norm(acceleration) > _CALM:
            for name in self._dislodged(before, acceleration, riders) - self._sliding.keys():
                self._sliding[name] = (middle - first.apply(own)) / step
                self.remarks.append(f"{name} is dislodged at {np.linalg.norm(acceleration):.2f} m/s2 of the base")
        motion = now @ before.inverse
        for name in riders - self._sliding.keys():
            self._bodies[name] = replace(self._bodies[name], pose=motion @ self._bodies[name].pose)
        self._slide(velocity, step)

    def _dislodged(self, base: Pose, acceleration: Array, riders: set[str]) -> set[str]:
        """Which riders do not stand while the base accelerates (3,) m/s2."""
        key = (*np.round(base.inverse.rotation @ acceleration / _SAME), *sorted(riders), len(self._sliding))
        if key not in self._stands:
            gravity = np.asarray(self._beginning.gravity) - acceleration
            bodies = tuple(self._bodies[name] for name in sorted(riders))
            pairs = [pair for pair in self._beginning.friction_pairs if riders >= set(pair.objects)]
            shaken = replace(self._beginning, objects=bodies, friction_pairs=tuple(pairs), gravity=gravity)
            try:
                self._stands[key] = set(Analysis.of(shaken).stability().falling)
            except InputError as error:  # what has slid off stands elsewhere
                self._stands[key] = set(error.data.get("objects", ()))
        return self._stands[key]

    def _slide(self, velocity: Array, step: float) -> None:
        """Bodies that the base has dislodged: friction takes them up to its velocity (3,), m/s; then they rest."""
        most = (self._beginning.friction or 0.0) * self._gravity * step
        for name, own in list(self._sliding.items()):
            behind = velocity - own
            length = float(np.linalg.norm(behind))
            own = own + behind * min(1.0, most / max(length, 1e-12))
            item = self._bodies[name]
            self._bodies[name] = replace(item, pose=Pose(item.pose.rotation, item.pose.translation + own * step))
            self._sliding[name] = own
            if length <= most:
                del self._sliding[name]
                self._fall(name)
        if not self._sliding and self._stands:
            self._stands.clear()
            self._settle()
