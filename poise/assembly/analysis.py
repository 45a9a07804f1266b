"""An assembly made ready for questions: its blocks with their solvers, built when first needed and kept."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from poise.assembly.block import BlockGeometry, block_geometry, gravity_wrenches
from poise.assembly.contacts import CONTACT_MARGIN, Interface
from poise.assembly.coulomb import CoulombBlock
from poise.assembly.equilibrium import Standing, has_self_stress, stability
from poise.assembly.gauge import GaugeProgram
from poise.assembly.geometry import Array
from poise.assembly.graph import Block, Structure
from poise.assembly.limit import limit_program
from poise.assembly.patch import PatchProgram
from poise.assembly.pushes import Loads
from poise.assembly.scene import Assembly
from poise.assembly.single_patch import SinglePatch
from poise.errors import ErrorCode, NoAnswerError

STILL = 1e-4
"""Bodies slower than this share of the fastest are at rest in a mechanism."""


@dataclass(frozen=True, eq=False)
class BlockAnalysis:
    """One block of the contact interface graph and all that is asked of it."""

    structure: Structure
    block: Block

    @cached_property
    def geometry(self) -> BlockGeometry:
        return block_geometry(self.structure, self.block)

    @cached_property
    def interfaces(self) -> list[Interface]:
        return [self.structure.interfaces[number] for number in self.block.interfaces]

    @cached_property
    def limit(self) -> GaugeProgram:
        return limit_program(self.geometry)

    @cached_property
    def single_patch(self) -> SinglePatch | None:
        """For one body on one interface."""
        if not self.geometry.statically_determinate:
            return None
        faces_body = self.block.supports[0][1] == 0
        resting = gravity_wrenches(self.structure, self.block)[0]
        return SinglePatch(self.interfaces[0], faces_body, resting)

    @cached_property
    def patch(self) -> PatchProgram | None:
        """For more than that; None when friction spread uniformly cannot even hold the block at rest."""
        if self.geometry.statically_determinate:
            return None
        program = PatchProgram(self.geometry, self.interfaces)
        return program if program.holds else None

    @cached_property
    def coulomb(self) -> CoulombBlock:
        return CoulombBlock(self.geometry, self.interfaces)

    @cached_property
    def self_stress(self) -> bool:
        return has_self_stress(self.geometry)

    @cached_property
    def standing(self) -> Standing:
        """How safely it stands; where it might be held by forces that nothing presses into being, checked for that."""
        standing = stability(self.geometry)
        if standing.margin >= 0 and self.self_stress:
            settled = self.coulomb.settle(self.geometry.gravity.ravel())
            if not settled.stands:
                return Standing(-settled.unbalanced, settled.displacement)
        return standing

    def loads(self, loads: Loads) -> tuple[np.ndarray, Array]:
        """The questions (q,) that load this block, and the loads (q, 6 n) in its units."""
        inside = np.array([place in self.geometry.place_of for place in loads.place], dtype=bool)
        rows = np.flatnonzero(inside)
        questions, row = np.unique(loads.question[rows], return_inverse=True)
        body = np.array([self.geometry.place_of[place] for place in loads.place[rows].tolist()], dtype=np.int64)
        total = np.zeros((len(questions), self.geometry.count, 6))
        np.add.at(total, (row, body), self.geometry.units.of_wrench(loads.wrench[rows]))
        return questions, total.reshape(len(questions), 6 * self.geometry.count)


class Mechanism:
    """How a block gives way.

    Args:
        block: which.
        twist: (6 n,) in the block's units, of any scale.
    """

    def __init__(self, block: BlockAnalysis, twist: Array) -> None:
        self.block = block
        self._twist = twist

    @property
    def twist(self) -> Array:
        """(6 n,) in the block's units."""
        return self._twist

    @cached_property
    def velocities(self) -> dict[int, Array]:
        """For each object that moves, its place in `Assembly.objects`: (6,) velocity of its com, angular velocity."""
        twists = self.twist.reshape(-1, 6)
        speeds = np.abs(twists).max(axis=1)
        found = {}
        for speed, velocity, members in zip(
            speeds, self.block.geometry.units.velocity(twists), self.block.block.members, strict=True
        ):
            if speed <= STILL * speeds.max():
                continue
            for place in members:
                com = self.block.structure.assembly.objects[place].com_in_world
                found[place] = np.concatenate([velocity[:3] + np.cross(velocity[3:], com), velocity[3:]])
        return found

    @cached_property
    def mode(self) -> str:
        """slip, topple or mixed: what happens at the interfaces that part.

        An interface topples when its corners part at different speeds (more so than the dilatancy of limit analysis
        asks of a patch that turns in its plane), and slips when the corner that parts least slides.
        """
        geometry = self.block.geometry
        relative = (geometry.grasp.T @ self.twist).reshape(-1, 3)
        slide = np.linalg.norm(relative[:, 1:], axis=1)
        scale = max(float(np.abs(relative).max(initial=0.0)), 1e-300)
        slips = topples = False
        for number in range(len(self.block.interfaces)):
            corners = geometry.interface == number
            parting, sliding = relative[corners, 0], slide[corners]
            dilatancy = geometry.friction[corners] * sliding
            topples |= bool(np.ptp(parting) > 1.5 * np.ptp(dilatancy) + 1e-3 * scale)
            slips |= bool(sliding[(parting - dilatancy).argmin()] > 1e-2 * scale)
        return "mixed" if slips and topples else "slip" if slips else "topple"


class PatchMechanism(Mechanism):
    """How the one interface of a block gives way to a wrench (6,), N and N m; worked out when asked for."""

    def __init__(self, block: BlockAnalysis, patch: SinglePatch, wrench: Array, factor: float, slips: bool) -> None:
        self.block = block
        self._patch = patch
        self._give_way = wrench, factor, slips

    @cached_property
    def twist(self) -> Array:
        """(6,) in the block's units."""
        return self.block.geometry.units.of_velocity(self._patch.mechanism(*self._give_way))


@dataclass(frozen=True, eq=False)
class Analysis:
    """An assembly, its contacts, and one solver per block. For one thread at a time."""

    structure: Structure

    @classmethod
    def of(cls, assembly: "Assembly | Structure | Analysis", margin: float = CONTACT_MARGIN) -> "Analysis":
        """Prepare an assembly; what is prepared already is kept.

        Raises:
            InputError: INTERPENETRATION or FLOATING.
        """
        if isinstance(assembly, Analysis):
            return assembly
        return cls(assembly if isinstance(assembly, Structure) else Structure.of(assembly, margin))

    @property
    def assembly(self) -> Assembly:
        return self.structure.assembly

    @cached_property
    def blocks(self) -> tuple[BlockAnalysis, ...]:
        return tuple(BlockAnalysis(self.structure, block) for block in self.structure.blocks)

    @cached_property
    def margin(self) -> float:
        """N: by how much every interface could press less and still hold; 0 on the verge, negative when it falls."""
        margins = [block.standing.margin * block.geometry.units.weight for block in self.blocks]
        return min(margins, default=np.inf)

    @cached_property
    def falling(self) -> tuple[str, ...]:
        """Ids of the objects that move, or are on the verge of it, when nothing pushes them."""
        names: list[str] = []
        for block in self.blocks:
            if block.standing.margin <= 0:
                names += [
                    self.assembly.objects[place].id for place in Mechanism(block, block.standing.twist).velocities
                ]
        return tuple(dict.fromkeys(names))

    @property
    def stable(self) -> bool:
        return self.margin >= 0

    def require_stable(self) -> None:
        """Raise NoAnswerError UNSTABLE, with what falls and by what margin, when the assembly does not stand."""
        if not self.stable:
            names = ", ".join(self.falling[:5])
            raise NoAnswerError(
                ErrorCode.UNSTABLE,
                f"the assembly does not stand by itself: {names} would move (margin {self.margin:.4g} N); "
                "check poses, centres of mass and friction, or support it",
                objects=list(self.falling),
                margin=self.margin,
            )
