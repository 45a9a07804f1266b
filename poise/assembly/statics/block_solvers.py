"""The solvers of one block of the contact interface graph, built when first needed and kept."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from poise.assembly.contact import ContactBlock, Interface, Structure
from poise.assembly.statics.block import BlockGeometry, block_geometry, gravity_wrenches
from poise.assembly.statics.coulomb import CoulombBlock
from poise.assembly.statics.deadline import NO_DEADLINE, Deadline
from poise.assembly.statics.elastic_state import ElasticState
from poise.assembly.statics.elimination import Elimination
from poise.assembly.statics.equilibrium import Held, Standing, held_at_once, resists, stability
from poise.assembly.statics.limit import limit_program
from poise.assembly.statics.load_factor import LoadFactorProgram
from poise.assembly.statics.patch import PatchProgram
from poise.assembly.statics.single_patch import SinglePatch
from poise.assembly.statics.solvers import SOLVER_TOLERANCE
from poise.assembly.statics.symmetry import Symmetry, symmetries
from poise.types import Array

_FEW, _ROUGH = 8, 1e-6
"""Bodies up to which limit analysis is solved to the solver's tolerance; what it is solved to otherwise."""

_STEPS, _PER_SECOND = 20, 8e9
"""Steps that such a program takes, and multiplications in a second in which each factors its system."""

BlockKey = tuple[object, ...]
"""Equal for blocks that are the same problem: the same objects held in the same places, with the same friction."""


@dataclass(eq=False)
class BlockSolvers:
    """All that is computed about one block, apart from places in `Assembly.objects`.

    Analyses of other assemblies share it as long as the block has the same `key`. It keeps the structure that it was
    built for, so the identities in its key stay valid.

    Args:
        structure: of an assembly with the block.
        block: as numbered in that structure.
        start: (6 n,) displacement near which elastic contacts are at rest, where one is known.
    """

    structure: Structure
    block: ContactBlock
    start: Array | None = None
    _standing: Standing | None = field(default=None, init=False)
    _held: Held | None = field(default=None, init=False)

    @staticmethod
    def key(structure: Structure, block: ContactBlock) -> BlockKey:
        """The `BlockKey` of a block."""
        objects = structure.assembly.objects
        members = tuple(tuple(id(objects[place]) for place in group) for group in block.members)
        interfaces = (structure.interfaces[number] for number in block.interfaces)
        return members, tuple((id(interface.points), interface.friction) for interface in interfaces), block.supports

    @cached_property
    def geometry(self) -> BlockGeometry:
        return block_geometry(self.structure, self.block)

    @cached_property
    def interfaces(self) -> list[Interface]:
        return [self.structure.interfaces[number] for number in self.block.interfaces]

    @cached_property
    def order(self) -> Elimination:
        """In which its bodies are eliminated from linear systems."""
        return Elimination.of(self.geometry.supports, self.geometry.count)

    @cached_property
    def limit(self) -> LoadFactorProgram:
        """Model `limit`; to a millionth for many bodies, where elastic contacts decide in the end."""
        return limit_program(self.geometry, SOLVER_TOLERANCE, self.order) if self._few else self.rough_limit

    @property
    def _few(self) -> bool:
        return self.geometry.count <= _FEW

    @cached_property
    def rough_limit(self) -> LoadFactorProgram:
        """Model `limit` to a millionth, for maps."""
        return limit_program(self.geometry, _ROUGH, self.order)

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
        """For several bodies or interfaces; None when uniformly spread friction cannot hold the block at rest."""
        if self.geometry.statically_determinate:
            return None
        program = PatchProgram(self.geometry, self.interfaces, self.order)
        return program if program.holds else None

    @cached_property
    def coulomb(self) -> CoulombBlock:
        return CoulombBlock(self.geometry, self.interfaces, self.order)

    @cached_property
    def symmetries(self) -> tuple[Symmetry, ...]:
        """What carries the block into itself, apart from the identity; looking for it takes one or two milliseconds."""
        return symmetries(self.geometry, self.coulomb.contacts)

    @cached_property
    def balance(self) -> Standing:
        """How safely the block stands if contact forces may be any that balance."""
        return self._stability(self.geometry)

    def _stability(self, geometry: BlockGeometry) -> Standing:
        return stability(geometry, order=self.order, tolerance=SOLVER_TOLERANCE if self._few else _ROUGH / 10)

    @property
    def settled(self) -> ElasticState | None:
        """At rest on elastic contacts, once that was asked."""
        return None if self._standing is None else self.coulomb.rest

    def standing(self, deadline: Deadline = NO_DEADLINE) -> tuple[Standing, bool]:
        """How safely the block stands. Where contact forces have a choice, those of elastic contacts count.

        Returns:
            How safely, and whether elastic contacts were checked where necessary, before the deadline.
        """
        if self.geometry.statically_determinate:
            return (self.balance, True) if self._balances_in(deadline) else (self._unknown, False)
        if self._standing is None:
            state = self._at_rest(deadline)
            if not state.known:
                known = self._balances_in(deadline) and self.balance.margin < 0
                return (self.balance, True) if known else (self._unknown, False)
            if state.stands and not self._in_time(deadline):
                return self._unknown, False
            if state.stands:
                self._standing = self._by_itself()
            elif self.balance.margin < 0:
                self._standing = self.balance
            else:
                self._standing = Standing(-state.unbalanced, state.displacement)
        return self._standing, True

    def _at_rest(self, deadline: Deadline) -> ElasticState:
        """The state on elastic contacts under gravity; kept where it is known."""
        if "rest" in self.coulomb.__dict__:
            return self.coulomb.rest
        state = self.coulomb.settle(self.geometry.gravity.ravel(), self.start, deadline)
        if state.known or not deadline.passed:
            self.coulomb.rest = state
        return state

    def held(self, enough: float) -> Held:
        """Whether contacts resist every motion, and the margin if contact forces may be any that balance.

        Args:
            enough: a larger margin need not be found: forces that prove this one are looked for first.
        """
        if self._held is None or self._held.margin < enough:
            self._held = held_at_once(self.geometry, enough) if self._few else resists(self.geometry)
            if "balance" in self.__dict__ or self._held.margin < enough:
                self._held = replace(self._held, margin=self.balance.margin)
        return self._held

    def stands_by(self, least: float) -> bool:
        """Whether `standing` has at least this margin, in block weights; the exact one is found only in doubt."""
        if self.geometry.statically_determinate:
            return self.held(least).margin >= least
        if self._standing is None and self._few:
            state = self._at_rest(NO_DEADLINE)
            if state.known and state.stands and held_at_once(self._pressing, least).margin >= least:
                return True
        standing, known = self.standing()
        return known and standing.margin >= least

    @property
    def _unknown(self) -> Standing:
        """In place of an answer for which there was no time."""
        return Standing(0.0, np.zeros(6 * self.geometry.count))

    def _balances_in(self, deadline: Deadline) -> bool:
        """Whether it is known how safely the block stands if contact forces may be any, or there is time for that."""
        return "balance" in self.__dict__ or self._in_time(deadline)

    def _in_time(self, deadline: Deadline) -> bool:
        """Whether there is time for a program that says how safely the block stands: it cannot be interrupted.

        Of a few bodies it takes less than a millisecond, for which there always is.
        """
        left = deadline.remaining
        return left is None or self._few or left > _STEPS * self.order.work / _PER_SECOND

    def _by_itself(self) -> Standing:
        """How safely a block stands without what only touches: that could not be pressed less, and does not help."""
        pressing = self._pressing
        return self.balance if pressing is self.geometry else self._stability(pressing)

    @property
    def _pressing(self) -> BlockGeometry:
        """The block without the contact points of what only touches at rest."""
        idle = ~self.coulomb.pressed_at_rest
        return self.geometry.without(idle) if idle.any() else self.geometry
