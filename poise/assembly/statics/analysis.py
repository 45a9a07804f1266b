"""An assembly prepared for many questions: its blocks, with solvers that are built when first needed and kept."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from poise.assembly.contact import CONTACT_MARGIN, ContactBlock, Interface, RoundTouch, Structure
from poise.assembly.scene import Assembly, FrictionPair, RigidObject
from poise.assembly.statics.block import BlockGeometry
from poise.assembly.statics.block_solvers import BlockKey, BlockSolvers
from poise.assembly.statics.deadline import NO_DEADLINE, Deadline
from poise.assembly.statics.pushes import Loads
from poise.assembly.statics.single_patch import SinglePatch
from poise.assembly.statics.symmetry import Symmetry
from poise.errors import ErrorCode, NoAnswerError
from poise.geometry import cross
from poise.types import Array, Indices

_STILL, _ELASTIC = 1e-4, 3e-3
"""Bodies slower than this share of the fastest are at rest in a mechanism; on elastic contacts all move a little."""


@dataclass(frozen=True, eq=False)
class BlockAnalysis:
    """One block of the contact interface graph in an assembly, with its solvers.

    Args:
        structure: of the assembly.
        block: which part of its graph.
        solvers: of the block; analyses of similar assemblies may share them.
    """

    structure: Structure
    block: ContactBlock
    solvers: BlockSolvers

    @property
    def geometry(self) -> BlockGeometry:
        return self.solvers.geometry

    @cached_property
    def interfaces(self) -> list[Interface]:
        return [self.structure.interfaces[number] for number in self.block.interfaces]

    @cached_property
    def body_of(self) -> dict[int, int]:
        """The body of the block that moves with each object, by its place in `Assembly.objects`."""
        return {place: body for body, members in enumerate(self.block.members) for place in members}

    def bodies_of(self, place: Indices) -> Indices:
        """(N,) the body of the block that moves with each object, by places (N,) in `Assembly.objects`; -1 for none."""
        body = np.full(len(self.structure.assembly.objects), -1, dtype=np.int64)
        body[list(self.body_of)] = list(self.body_of.values())
        return np.asarray(body[place])

    def loads(self, loads: Loads) -> tuple[np.ndarray, Array]:
        """The questions (q,) that load this block, and the loads (q, 6 n) in its units."""
        bodies = self.bodies_of(loads.place)
        rows = np.flatnonzero(bodies >= 0)
        questions, row = np.unique(loads.question[rows], return_inverse=True)
        body = bodies[rows]
        total = np.zeros((len(questions), self.geometry.count, 6))
        np.add.at(total, (row, body), self.geometry.units.of_wrench(loads.wrench[rows]))
        return questions, total.reshape(len(questions), 6 * self.geometry.count)


class Mechanism:
    """The motion of a block at collapse.

    Args:
        block: which.
        twist: (6 n,) in the block's units, of any scale.
        still: bodies slower than this share of the fastest are at rest.
    """

    def __init__(self, block: BlockAnalysis, twist: Array, still: float = _STILL) -> None:
        self.block = block
        self._twist, self._still = twist, still

    @classmethod
    def elastic(cls, block: BlockAnalysis, twist: Array) -> "Mechanism":
        """Of a block that collapses on elastic contacts."""
        return cls(block, twist, _ELASTIC)

    @property
    def twist(self) -> Array:
        """(6 n,) in the block's units."""
        return self._twist

    def image(self, symmetry: Symmetry) -> "Mechanism":
        """The mechanism that a symmetry of its block carries it into."""
        return Mechanism(self.block, symmetry.of_bodies(self.twist), self._still)

    def _moving(self) -> list[tuple[int, int]]:
        """Bodies of the block that move, and each object that moves with them."""
        speeds, groups = np.abs(self.twist.reshape(-1, 6)).max(axis=1), self.block.block.members
        bodies = np.flatnonzero(speeds > self._still * speeds.max()).tolist()
        return [(body, place) for body in bodies for place in groups[body]]

    @property
    def places(self) -> tuple[int, ...]:
        """Objects that move, by their places in `Assembly.objects`."""
        return tuple(place for _, place in self._moving())

    @cached_property
    def velocities(self) -> dict[int, Array]:
        """For each object that moves, its place in `Assembly.objects`: (6,) velocity of its com, angular velocity."""
        velocities = self.block.geometry.units.velocity(self.twist.reshape(-1, 6))
        objects, moving = self.block.structure.assembly.objects, self._moving()
        rows = velocities[[body for body, _ in moving]]
        # v + omega x com, for all at once
        com = np.array([objects[place].com_in_world for _, place in moving]).reshape(-1, 3)
        rows[:, :3] += cross(rows[:, 3:], com)
        return {place: row for (_, place), row in zip(moving, rows, strict=True)}

    @cached_property
    def mode(self) -> str:
        """slip, topple, roll or mixed: what happens at the interfaces that part.

        An interface topples when its corners part at different speeds (more so than the dilatancy of limit analysis
        asks of a patch that turns in its plane), and slips when the corner that parts least slides without leaving.
        Round sides roll where they turn about their line or point without leaving it.
        """
        geometry = self.block.geometry
        relative = (geometry.grasp.T @ self.twist).reshape(-1, 3)
        slide = np.linalg.norm(relative[:, 1:], axis=1)
        scale = max(float(np.abs(relative).max(initial=0.0)), 1e-300)
        found: dict[str, bool] = dict.fromkeys(("slip", "topple", "roll"), False)
        for number, interface in enumerate(self.block.interfaces):
            corners = geometry.interface == number
            parting, sliding = relative[corners, 0], slide[corners]
            dilatancy = geometry.friction[corners] * sliding
            last = int((parting - dilatancy).argmin())
            # Friction parts elastic contacts at no speed, those of limit analysis at that of dilatancy.
            leaving = parting[last] - (dilatancy[last] if self._still == _STILL else 0.0)
            stays = leaving < 0.03 * sliding[last]
            found["slip"] |= bool(sliding[last] > 1e-2 * scale and stays)
            if interface.touch is not None:
                parting, speed = self._on_touch(number, interface.touch, interface.normal)
                found["roll"] |= speed > 1e-2 * scale and parting.min() < 2 * interface.rolling * speed + 1e-3 * scale
            found["topple"] |= bool(np.ptp(parting) > 1.5 * np.ptp(dilatancy) + 1e-3 * scale)
        modes = [mode for mode, seen in found.items() if seen]
        return modes[0] if len(modes) == 1 else "mixed" if modes else "topple"

    def _on_touch(self, number: int, touch: RoundTouch, normal: Array) -> tuple[Array, float]:
        """(K,) how fast a round side leaves the points at which it touches, and how fast it rolls, in block units."""
        units = self.block.geometry.units
        twists = np.vstack([self.twist.reshape(-1, 6), np.zeros(6)])  # FIXED_NODE is the last
        first, second = self.block.geometry.supports[number]
        motion = twists[second] - twists[first]
        points = (touch.points - units.origin) / units.length
        leaves = (motion[:3] + np.cross(motion[3:], points)) @ normal
        turning = np.cross(motion[3:], normal)
        rate = float(np.linalg.norm(turning) if touch.across is None else abs(turning @ touch.across))
        return leaves, rate * float(touch.radii.mean()) / units.length


class PatchMechanism(Mechanism):
    """The motion of a block on one interface at collapse under a wrench (6,), N and N m; computed when first used."""

    def __init__(self, block: BlockAnalysis, patch: SinglePatch, wrench: Array, factor: float, slips: bool) -> None:
        self.block, self._still = block, _STILL
        self._patch = patch
        self._give_way = wrench, factor, slips

    @cached_property
    def twist(self) -> Array:
        """(6,) in the block's units."""
        return self.block.geometry.units.of_velocity(self._patch.mechanism(*self._give_way))


@dataclass(frozen=True)
class Stability:
    """Whether an assembly stands by itself.

    Args:
        margin: N by which every interface could press less and still hold; 0 on the verge of moving; negative when it
            falls: how hard every interface would have to pull, or how much of the weight nothing carries.
        falling: ids of what falls, or is on the verge of it.
        doubtful: elastic contacts were not asked in time where contact forces have a choice; the margin is then at
            most 0, although some contact forces keep everything at rest.
    """

    margin: float
    falling: tuple[str, ...]
    doubtful: bool

    @property
    def stable(self) -> bool:
        """It stands, with something to spare: what is on the verge of moving does not."""
        return self.margin > 0


@dataclass(frozen=True, eq=False)
class Analysis:
    """An assembly, its contacts, and one solver per block. For one thread at a time."""

    structure: Structure
    _shared: Mapping[BlockKey, BlockSolvers] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls,
        assembly: "Assembly | Structure | Analysis",
        margin: float = CONTACT_MARGIN,
        deadline: Deadline = NO_DEADLINE,
    ) -> "Analysis":
        """Prepare an assembly; an `Analysis` is returned unchanged.

        Raises:
            InputError: INTERPENETRATION or FLOATING.
            NoAnswerError: DEADLINE, when it passes before all contacts are found.
        """
        if isinstance(assembly, Analysis):
            return assembly
        if isinstance(assembly, Structure):
            return cls(assembly)
        return cls(Structure.of(assembly, margin, lambda: deadline.passed))

    def with_object(self, *items: RigidObject, pairs: Sequence[FrictionPair] = ()) -> "Analysis":
        """The analysis with objects added, or moved, and friction changed: only the blocks these change are new.

        Raises:
            InputError: INTERPENETRATION, FLOATING; OBJECT_UNKNOWN in a friction pair.
        """
        return Analysis(self.structure.with_object(*items, pairs=pairs), self._solvers)

    def without(self, name: str) -> "Analysis":
        """The analysis when one object is taken away. Others may float then: see `stability`.

        Raises:
            InputError: OBJECT_UNKNOWN.
        """
        return Analysis(self.structure.without(name), self._solvers)

    @cached_property
    def _solvers(self) -> dict[BlockKey, BlockSolvers]:
        return {BlockSolvers.key(self.structure, block.block): block.solvers for block in self.blocks}

    @property
    def assembly(self) -> Assembly:
        return self.structure.assembly

    @cached_property
    def blocks(self) -> tuple[BlockAnalysis, ...]:
        found = []
        for block in self.structure.blocks:
            shared = self._shared.get(BlockSolvers.key(self.structure, block)) if self._shared else None
            found.append(BlockAnalysis(self.structure, block, shared or BlockSolvers(self.structure, block)))
        return tuple(found)

    def stability(self, deadline: Deadline = NO_DEADLINE) -> Stability:
        """Whether and how safely the assembly stands by itself; floating objects fall."""
        objects = self.assembly.objects
        margin = -np.inf if self.structure.floating else np.inf
        falling = [objects[place].id for place in self.structure.floating]
        doubtful = False
        for block in self.blocks:
            standing, known = block.solvers.standing(deadline)
            if not known:
                doubtful, margin = True, min(margin, 0.0)
                continue
            margin = min(margin, standing.margin * block.geometry.units.weight)
            if standing.margin <= 0:
                falling += [objects[place].id for place in Mechanism(block, standing.twist).velocities]
        return Stability(margin, tuple(dict.fromkeys(falling)), doubtful and not falling)

    def require_stable(self, deadline: Deadline = NO_DEADLINE) -> Stability:
        """How it stands; raise NoAnswerError UNSTABLE, with what falls and by what margin, when it does not."""
        found = self.stability(deadline)
        if not (found.stable or found.doubtful):
            raise unstable(found.falling, found.margin)
        return found


def unstable(falling: Sequence[str], margin: float) -> NoAnswerError:
    """UNSTABLE: what falls, or is on the verge of it, and by what margin, N."""
    names = ", ".join(falling[:5])
    return NoAnswerError(
        ErrorCode.UNSTABLE,
        f"the assembly does not stand by itself: {names} would move (margin {margin:.4g} N); "
        "check poses, centres of mass and friction, or support it",
        objects=list(falling),
        margin=margin,
    )
