"""What two assemblies have in common: an analysis for the second that starts from that of the first."""

import numpy as np

from poise.assembly.scene import Assembly, Mesh, RigidObject, Shape
from poise.assembly.statics.analysis import Analysis
from poise.types import Array


def analysis_after(before: Analysis | None, assembly: Assembly) -> Analysis:
    """The analysis of an assembly, that keeps contacts, programs and solutions which are unchanged from another one.

    Raises:
        InputError: INTERPENETRATION, FLOATING.
    """
    if before is None or not _same_setting(before.assembly, assembly):
        return Analysis.of(assembly)
    known = before.assembly.index
    gone = [item.id for item in before.assembly.objects if item.id not in assembly.index]
    changed = [
        item
        for item in assembly.objects
        if item.id not in known or not same_object(item, before.assembly.objects[known[item.id]])
    ]
    stays = any(item.fixed for item in before.assembly.objects if item.id not in gone)
    if len(gone) + len(changed) == len(assembly.objects) or not stays:
        return Analysis.of(assembly)
    analysis = before
    for name in gone:
        analysis = analysis.without(name)
    # Also when nothing is new: what floats now is an error.
    same = set(before.assembly.friction_pairs) == set(assembly.friction_pairs)
    return before if same and not (gone or changed) else analysis.with_object(*changed, pairs=assembly.friction_pairs)


def begin_near(before: Analysis, after: Analysis) -> None:
    """Let the blocks of an analysis settle near where those of a similar one have settled."""
    known: dict[str, Array] = {}
    objects = before.assembly.objects
    for block in before.blocks:
        if block.solvers.settled is not None:
            moved = block.solvers.coulomb.in_world(block.solvers.settled.displacement)
            known |= {objects[group[0]].id: row for group, row in zip(block.block.members, moved, strict=True)}
    objects = after.assembly.objects
    for block in after.blocks:
        heads = [objects[group[0]].id for group in block.block.members]
        if block.solvers.settled is None and not block.geometry.statically_determinate and known:
            rows = np.array([known.get(head, np.zeros(6)) for head in heads])
            block.solvers.start = block.solvers.coulomb.of_world(rows)


def _same_setting(first: Assembly, second: Assembly) -> bool:
    """Equal gravity, friction and rolling resistance, and no friction pair of objects that stay is left out."""
    return (
        np.array_equal(first.gravity, second.gravity)
        and (first.friction, first.rolling) == (second.friction, second.rolling)
        and {pair for pair in _names(first) if pair <= set(second.index)} <= _names(second)
    )


def same_object(first: RigidObject, second: RigidObject) -> bool:
    """Whether two objects are equal in every number."""
    return (
        (first.id, first.fixed, first.fixed or first.mass) == (second.id, second.fixed, second.fixed or second.mass)
        and np.array_equal(first.pose.rotation, second.pose.rotation)
        and np.array_equal(first.pose.translation, second.pose.translation)
        and all(_same(getattr(first, name), getattr(second, name)) for name in ("com", "inertia", "covariance"))
        and _same_shape(first.shape, second.shape)
    )


def _names(assembly: Assembly) -> set[frozenset[str]]:
    """The objects of each friction pair."""
    return {frozenset(pair.objects) for pair in assembly.friction_pairs}


def _same(first: Array | None, second: Array | None) -> bool:
    return first is second if first is None or second is None else np.array_equal(first, second)


def _same_shape(first: Shape, second: Shape) -> bool:
    if isinstance(first, Mesh) and isinstance(second, Mesh):
        return np.array_equal(first.vertices, second.vertices) and np.array_equal(first.triangles, second.triangles)
    return first == second
