"""Contact interfaces of an assembly: which objects touch, where, and with what friction."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from poise.assembly.contact.patches import patches_between
from poise.assembly.contact.penetration import penetration_depth, winding_number
from poise.assembly.contact.placed import ContactPatch, PlacedBody, RoundTouch, hull_corners, placed, triangle_areas
from poise.assembly.contact.round_touch import joint_touch, mesh_touch, resting_normal, widened
from poise.assembly.contact.touching import FACE_ANGLE, NO_TRIANGLES
from poise.assembly.scene import Assembly, RigidObject
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import unit
from poise.types import Array, Indices

_Kept = TypeVar("_Kept")
CONTACT_MARGIN = 1.5e-3
"""Gaps and overlaps up to this, in m, count as touching: what a scan leaves between bodies that touch."""
_WALL = 0.5
"""Share of the thickness of a body that may be a gap or an overlap: more, and it would touch what is behind it."""
_FLUSH = 1e-5
"""m; a wider gap may be filled by other bodies."""
_ROWS, _SOON = 500, 100
"""Objects whose bounds are compared with those of all others at once, and pairs searched for contacts in any case."""


@dataclass(frozen=True, eq=False)
class Interface:
    """All places in one plane where two objects touch.

    The forces that the corners can transmit are all the forces that the region can (a force at an inner point is
    a sum of forces of the same direction at the corners), so limit analysis needs no others.

    Args:
        first, second: places in `Assembly.objects`; the first presses on the second along the normal.
        normal: (3,) from first into second.
        points: (K, 3) corners of the convex hull of the region, in order, m; two for a line, one for a point.
        triangles: (T, 3, 3) the region touched; empty for lines and points.
        gap: m, negative where they overlap.
        friction: Coulomb coefficient.
        touch: the line or point at which a round side touches; `points` are then the corners of the narrow region
            around it in which rolling resistance lets the contact force act.
        rolling: coefficient of rolling resistance.
        kept: what has been computed about the region, by name; copies of the interface with other places share it.
    """

    first: int
    second: int
    normal: Array
    points: Array
    triangles: Array
    gap: float
    friction: float
    touch: RoundTouch | None = None
    rolling: float = 0.0
    kept: dict[str, Any] = field(default_factory=dict, repr=False)

    @property
    def area(self) -> float:
        """m2; 0 for lines and points."""
        return self.once("area", lambda: float(triangle_areas(self.triangles).sum()))

    def with_friction(
        self, friction: float, rolling: float, first: int | None = None, second: int | None = None
    ) -> "Interface":
        """The interface with other coefficients, and of bodies at other places (None: the same ones)."""
        one = self.first if first is None else first
        other = self.second if second is None else second
        normal, points, triangles, gap, touch = self.normal, self.points, self.triangles, self.gap, self.touch
        if touch is None or rolling == self.rolling:
            if (friction, one, other) == (self.friction, self.first, self.second):
                return self
            return Interface(one, other, normal, points, triangles, gap, friction, touch, self.rolling, self.kept)
        points = widened(touch, normal, rolling)
        return Interface(one, other, normal, points, triangles, gap, friction, touch, rolling)

    def once(self, name: str, compute: Callable[[], _Kept]) -> _Kept:
        """What has been computed about the region under a name; computed now if it has not."""
        if name not in self.kept:
            self.kept[name] = compute()
        found: _Kept = self.kept[name]
        return found


def margin_of(item: RigidObject, margin: float = CONTACT_MARGIN) -> float:
    """m that counts as touching at an object: of thin ones, less of `CONTACT_MARGIN` than of others."""
    return margin - max(CONTACT_MARGIN - _WALL * item.shape.polyhedron.thickness, 0.0)


def find_interfaces(
    assembly: Assembly,
    margin: float = CONTACT_MARGIN,
    only: frozenset[str] | None = None,
    late: Callable[[], bool] = lambda: False,
) -> list[Interface]:
    """Find where objects touch. Pairs of fixed objects are left out.

    Args:
        assembly: the objects.
        margin: gaps and overlaps up to this count as touching, m; at thin objects less, see `margin_of`.
        only: look at pairs with one of these ids alone.
        late: whether time is up; asked before each pair but the first ones.

    Raises:
        InputError: INTERPENETRATION, naming the two objects and the depth.
        NoAnswerError: DEADLINE.
    """
    bodies = [placed(item) for item in assembly.objects]
    wanted = None if only is None else np.flatnonzero([item.id in only for item in assembly.objects])
    interfaces: list[Interface] = []
    pairs, bounds = _pairs_near(bodies, margin, wanted), np.array([body.bounds for body in bodies])
    for number, (i, j) in enumerate(pairs):
        if number >= _SOON and late():
            raise NoAnswerError(
                ErrorCode.DEADLINE,
                f"the time was over after {number} of {len(pairs)} pairs of near objects had been searched for "
                f"contacts ({len(bodies)} objects); give a longer deadline, or the part of the scene that matters",
                pairs=number,
                of=len(pairs),
            )
        first, second = bodies[i], bodies[j]
        near = min(margin_of(first.item, margin), margin_of(second.item, margin))
        _check_overlap(first, second, near)
        names = first.item.id, second.item.id
        friction, rolling = assembly.friction_between(*names), assembly.rolling_between(*names)
        for group in _by_plane(patches_between(first, second, near), near):
            found = _merged(group, i, j, (first, second))
            if found.gap <= _FLUSH or not _filled(found, bodies, bounds):
                interfaces.append(found.with_friction(friction, rolling))
    return interfaces


def _filled(interface: Interface, bodies: list[PlacedBody], bounds: Array) -> bool:
    """Whether other bodies, of bounds (N, 2, 3), fill a gap everywhere: its bodies touch those, not each other."""
    middle = interface.points.mean(axis=0)
    spots = [middle + 0.98 * (interface.points - middle), interface.triangles.mean(axis=1).reshape(-1, 3), middle[None]]
    heights = interface.gap * np.array([-0.31, 0.0, 0.27])  # from the middle of the gap
    left = (np.concatenate(spots)[:, None] + heights[:, None] * interface.normal).reshape(-1, 3)
    low, high = left.min(axis=0), left.max(axis=0)
    for place in np.flatnonzero(np.all((bounds[:, 0] <= high) & (bounds[:, 1] >= low), axis=1)).tolist():
        if place not in (interface.first, interface.second):
            left = left[winding_number(left, bodies[place].corners, bodies[place].triangle_bounds) <= 0]
    return not len(left)


def overlapping(assembly: Assembly, allowed: Array | float = 0.0) -> list[tuple[int, int, float]]:
    """Places of objects that overlap by more than contacts may, and by how much, m; the deepest first.

    Args:
        assembly: the objects.
        allowed: (N,) m, by how much more each may.
    """
    bodies, reach = [placed(item) for item in assembly.objects], np.broadcast_to(allowed, len(assembly.objects))
    found = []
    for i, j in _pairs_near(bodies, 0.0):
        margin = min(margin_of(bodies[place].item) for place in (i, j)) + float(reach[i] + reach[j])
        depth = _overlap(bodies[i], bodies[j], margin)
        if depth > margin:
            found.append((i, j, depth))
    return sorted(found, key=lambda each: -each[2])


def _pairs_near(bodies: list[PlacedBody], margin: float, wanted: Indices | None = None) -> list[tuple[int, int]]:
    """Pairs, the first earlier in the list, whose bounds come within the margin; not both fixed.

    Args:
        bodies: all.
        margin: m.
        wanted: places of bodies of which one is in each pair; None: any.
    """
    bounds = np.array([body.bounds for body in bodies]).reshape(-1, 2, 3)
    fixed = np.array([body.item.fixed for body in bodies], dtype=bool)
    low, high, pairs = bounds[:, 0], bounds[:, 1] + margin, [np.zeros((0, 2), dtype=np.int64)]

    def near(rows: Indices, others: Indices) -> Indices:
        """(K, 2) bodies of the rows, and others near them, which are not the same."""
        close = np.all((low[rows, None] <= high[others]) & (low[others] <= high[rows, None]), axis=2)
        close &= ~(fixed[rows, None] & fixed[others]) & (rows[:, None] != others)
        first, second = np.nonzero(close)
        return np.stack([rows[first], others[second]], axis=1)

    if wanted is not None:
        pairs.append(near(wanted, np.arange(len(bodies))))
    else:
        order = np.argsort(low[:, 0], kind="stable")  # swept along x: what begins behind the end of some is not near
        for begin in range(0, len(bodies), _ROWS):
            rows = order[begin : begin + _ROWS]
            end = int(np.searchsorted(low[order, 0], high[rows, 0].max(), side="right"))
            pairs.append(near(rows, order[begin:end]))
    found = np.sort(np.concatenate(pairs), axis=1)
    return [divmod(pair, len(bodies)) for pair in np.unique(found @ [len(bodies), 1]).tolist()]


def _overlap(first: PlacedBody, second: PlacedBody, margin: float) -> float:
    """m by which two bodies overlap; 0 where their bounds do not by the margin."""
    low = np.maximum(first.bounds[0], second.bounds[0])
    high = np.minimum(first.bounds[1], second.bounds[1])
    return 0.0 if np.any(high - low <= margin) else penetration_depth(first, second)


def _check_overlap(first: PlacedBody, second: PlacedBody, margin: float) -> None:
    depth = _overlap(first, second, margin)
    if depth > margin:
        names = first.item.id, second.item.id
        raise InputError(
            ErrorCode.INTERPENETRATION,
            f"objects {names[0]} and {names[1]} overlap by {depth * 1e3:.3g} mm (up to {margin * 1e3:.3g} mm is taken "
            "as touching); move one of them, or state how uncertain the poses are (pose_std)",
            objects=names,
            depth=depth,
        )


def _by_plane(patches: list[ContactPatch], margin: float) -> list[list[ContactPatch]]:
    """Patches in groups that lie in one plane, the largest first."""
    groups: list[list[ContactPatch]] = []
    for patch in sorted(patches, key=lambda patch: -patch.area):
        for group in groups:
            lead = group[0]
            flat = lead.normal @ patch.normal > np.cos(FACE_ANGLE)
            if flat and np.all(np.abs((patch.points - lead.points[0]) @ lead.normal) <= margin):
                group.append(patch)
                break
        else:
            groups.append([patch])
    return groups


def _merged(group: list[ContactPatch], first: int, second: int, bodies: tuple[PlacedBody, PlacedBody]) -> Interface:
    """One interface of patches in one plane: the corners of their common hull, and their whole region."""
    areas = np.array([patch.area for patch in group])
    weights = areas if areas.sum() > 0 else np.ones(len(group))
    lead = group[0]
    if len(group) == 1:
        normal, gap = lead.normal, lead.gap
        points = lead.points if len(lead.points) <= 4 else hull_corners(lead.points, normal)
    else:
        normal = unit(np.sum([w * patch.normal for w, patch in zip(weights, group, strict=True)], axis=0))
        points = hull_corners(np.concatenate([patch.points for patch in group]), normal)
        gap = float(np.average([patch.gap for patch in group], weights=weights))
    touch = joint_touch(group, normal)
    if touch is None:
        on_plane = resting_normal(bodies, group, normal)
        touch = mesh_touch(bodies, group, on_plane, points)
        normal = normal if touch is None else on_plane
    if touch is not None:
        return Interface(first, second, normal, touch.points, NO_TRIANGLES, gap, 0.0, touch)
    triangles = np.concatenate([patch.triangles for patch in group])
    return Interface(first, second, normal, points, triangles, gap, 0.0)
