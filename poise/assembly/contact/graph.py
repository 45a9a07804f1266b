"""The contact interface graph: which bodies hold which, cut into blocks that can be solved one by one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

from poise.assembly.contact.contacts import CONTACT_MARGIN, Interface, find_interfaces, margin_of
from poise.assembly.contact.penetration import distance_between
from poise.assembly.scene import Assembly, FrictionPair, RigidObject
from poise.errors import ErrorCode, InputError

FIXED_NODE = -1
"""Stands for all fixed bodies: they never move relative to each other, so the graph has one node for them."""


@dataclass(frozen=True, eq=False)
class ContactBlock:
    """A part of the graph that no single body separates, with everything that rests on it.

    A body that is connected to the fixed bodies only through another body moves with it and transmits its load
    unchanged, for all contact forces. So blocks are independent problems, and the robustness to a push is that of the
    weakest block between the push and the fixed bodies. A stack is a chain of blocks of one body; cycles stay together.

    Args:
        members: for each body of the block, the places in `Assembly.objects` of it (first) and of all that hangs on it.
        interfaces: numbers in `Structure.interfaces`.
        supports: (number of interfaces, 2) block bodies on the first and second side, or FIXED_NODE.
    """

    members: tuple[tuple[int, ...], ...]
    interfaces: tuple[int, ...]
    supports: tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class Structure:
    """An assembly with its contact interfaces and its blocks.

    Args:
        assembly: the objects.
        interfaces: where they touch; cycles are allowed.
        margin: what counts as touching, m; at thin objects less, see `margin_of`.
    """

    assembly: Assembly
    interfaces: tuple[Interface, ...]
    margin: float = CONTACT_MARGIN

    @classmethod
    def of(
        cls, assembly: Assembly, margin: float = CONTACT_MARGIN, late: Callable[[], bool] = lambda: False
    ) -> "Structure":
        """Find the contacts of an assembly; `late`: whether time is up.

        Raises:
            InputError: INTERPENETRATION; FLOATING for objects that touch nothing that leads to a fixed body.
            NoAnswerError: DEADLINE.
        """
        structure = cls(assembly, tuple(find_interfaces(assembly, margin, late=late)), margin)
        structure._check_connected()
        return structure

    def with_object(self, *items: RigidObject, pairs: Sequence[FrictionPair] = ()) -> "Structure":
        """The structure with objects added, or moved, and friction changed: only their contacts are looked for.

        Raises:
            InputError: INTERPENETRATION, FLOATING.
        """
        assembly = self.assembly.with_object(*items, pairs=pairs)
        names = frozenset(item.id for item in items)
        kept = self._renumbered(assembly, names)
        found = find_interfaces(assembly, self.margin, only=names) if names else []
        structure = Structure(assembly, tuple(kept + found), self.margin)
        structure._check_connected()
        return structure

    def without(self, name: str) -> "Structure":
        """The structure when one object is taken away. Objects may float afterwards: see `floating`."""
        assembly = self.assembly.without(name)
        return Structure(assembly, tuple(self._renumbered(assembly, frozenset([name]))), self.margin)

    def _renumbered(self, assembly: Assembly, names: frozenset[str]) -> list[Interface]:
        """The interfaces that do not touch some objects, with the places and friction of another assembly."""
        ids = [item.id for item in self.assembly.objects]
        kept = []
        for old in self.interfaces:
            first, second = ids[old.first], ids[old.second]
            if not names & {first, second}:
                places = assembly.index[first], assembly.index[second]
                friction, rolling = assembly.friction_between(first, second), assembly.rolling_between(first, second)
                kept.append(old.with_friction(friction, rolling, *places))
        return kept

    @cached_property
    def movable(self) -> tuple[int, ...]:
        """Places in `Assembly.objects` of the bodies that can move."""
        return tuple(i for i, item in enumerate(self.assembly.objects) if not item.fixed)

    @cached_property
    def edges(self) -> dict[tuple[int, int], list[int]]:
        """The graph: for each pair of nodes (places, or FIXED_NODE) the numbers of the interfaces between them."""
        edges: dict[tuple[int, int], list[int]] = {}
        for number, interface in enumerate(self.interfaces):
            a, b = sorted(self.node(place) for place in (interface.first, interface.second))
            edges.setdefault((a, b), []).append(number)
        return edges

    def node(self, place: int) -> int:
        """The node of a body: its place, or FIXED_NODE."""
        return FIXED_NODE if self.assembly.objects[place].fixed else place

    @cached_property
    def neighbours(self) -> dict[int, list[int]]:
        """For each node those it touches."""
        neighbours: dict[int, list[int]] = {node: [] for node in (FIXED_NODE, *self.movable)}
        for a, b in self.edges:
            neighbours[a].append(b)
            neighbours[b].append(a)
        return neighbours

    @cached_property
    def floating(self) -> tuple[int, ...]:
        """Bodies from which no path of contacts leads to a fixed body."""
        reached, queue = {FIXED_NODE}, [FIXED_NODE]
        while queue:
            for other in self.neighbours[queue.pop()]:
                if other not in reached:
                    reached.add(other)
                    queue.append(other)
        return tuple(node for node in self.movable if node not in reached)

    def _check_connected(self) -> None:
        if self.floating:
            names = [self.assembly.objects[place].id for place in self.floating]
            margin = margin_of(self.assembly.objects[self.floating[0]], self.margin)
            raise InputError(
                ErrorCode.FLOATING,
                f"nothing holds {', '.join(names[:5])}: no contact within {margin * 1e3:.3g} mm leads to a fixed "
                f"body; {self._gap_below()}; check the poses, or give pose_std for poses of a camera",
                objects=names,
            )

    def _gap_below(self) -> str:
        """How far the first object that floats is from the nearest one that does not."""
        objects = self.assembly.objects
        item = objects[self.floating[0]]
        held = [other for place, other in enumerate(objects) if place not in set(self.floating)]
        distance, nearest = min((distance_between(item, other), other.id) for other in held)
        return f"{item.id} is {distance * 1e3:.3g} mm from {nearest}"

    @cached_property
    def blocks(self) -> tuple[ContactBlock, ...]:
        """The biconnected components of the graph, with what hangs on each of their bodies."""
        components, behind = _biconnected(self.neighbours)
        blocks = []
        for parent, nodes in components:
            heads = sorted(nodes - {parent})
            where = {head: i for i, head in enumerate(heads)} | {parent: FIXED_NODE}
            numbers = sorted(n for (a, b), found in self.edges.items() if {a, b} <= nodes for n in found)
            sides = [
                (where[self.node(self.interfaces[n].first)], where[self.node(self.interfaces[n].second)])
                for n in numbers
            ]
            members = tuple((head, *sorted(_hanging(head, behind) - {head})) for head in heads)
            blocks.append(ContactBlock(members, tuple(numbers), tuple(sides)))
        return tuple(blocks)


def _biconnected(neighbours: dict[int, list[int]]) -> tuple[list[tuple[int, set[int]]], dict[int, list[set[int]]]]:
    """Components that no single node separates, seen from FIXED_NODE (Hopcroft, Tarjan 1973), without recursion.

    Returns:
        (node nearest to FIXED_NODE, all nodes) of each component; and for each node, the components that hang on it
        (their nodes without it).
    """
    order, low = {FIXED_NODE: 0}, {FIXED_NODE: 0}
    components: list[tuple[int, set[int]]] = []
    behind: dict[int, list[set[int]]] = {}
    path: list[int] = []
    stack = [(FIXED_NODE, FIXED_NODE, iter(neighbours[FIXED_NODE]))]
    while stack:
        node, parent, rest = stack[-1]
        for other in rest:
            if other not in order:
                order[other] = low[other] = len(order)
                path.append(other)
                stack.append((other, node, iter(neighbours[other])))
                break
            if other != parent:
                low[node] = min(low[node], order[other])
        else:
            stack.pop()
            if not stack:
                break
            low[parent] = min(low[parent], low[node])
            if low[node] >= order[parent]:
                cut = path.index(node)
                nodes = set(path[cut:])
                del path[cut:]
                components.append((parent, nodes | {parent}))
                behind.setdefault(parent, []).append(nodes)
    return components, behind


def _hanging(head: int, behind: dict[int, list[set[int]]]) -> set[int]:
    """A node and all that reaches FIXED_NODE only through it."""
    found, queue = {head}, [head]
    while queue:
        for nodes in behind.get(queue.pop(), []):
            found |= nodes
            queue.extend(nodes)
    return found
