"""Links that are fixed to each other, as one body."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from poise.geometry import Pose
from poise.inertia import InertialParameters
from poise.worlds.assembling import combined
from poise.worlds.base import WorldBody, WorldSolid

WORLD = "world"
"""The name of what does not move, in joints of URDF and SDFormat."""


@dataclass(frozen=True, eq=False)
class WorldLink:
    """A link of a model: its solids and its inertia in its own frame.

    Args:
        name: in the model; `nested::name` in a nested one.
        pose: in the world.
        solids: may be none.
        inertial: None: it has no mass.
        fixed: it does not move.
    """

    name: str
    pose: Pose
    solids: tuple[WorldSolid, ...]
    inertial: InertialParameters | None
    fixed: bool = False


def grouped(
    model: str, links: Sequence[WorldLink], joined: Iterable[tuple[str, str]], notes: list[str]
) -> list[WorldBody]:
    """The bodies of a model, or of a world. A model of one body gives it its name.

    Args:
        model: its name; empty for a world, in which the names of links begin with those of their models.
        links: of the model, and of those nested in it.
        joined: pairs of links that are fixed to each other; `WORLD` does not move.
        notes: gets a sentence for each link without solids.
    """
    leader = {name: name for name in [WORLD, *(link.name for link in links)]}

    def first(name: str) -> str:
        while leader[name] != name:
            name = leader[name]
        return name

    for one, other in joined:
        if one in leader and other in leader:
            a, b = first(one), first(other)
            leader[b if a == first(WORLD) else a] = a if a == first(WORLD) else b
    groups: dict[str, list[WorldLink]] = {}
    for link in links:
        groups.setdefault(first(link.name), []).append(link)
    solid = {name: group for name, group in groups.items() if any(link.solids for link in group)}
    names = {key: f"{model}::{group[0].name}" if model else group[0].name for key, group in groups.items()}
    models = {key: model or name.rpartition("::")[0] for key, name in names.items()}
    for key in groups.keys() - solid.keys():
        name = names[key].removeprefix(f"{models[key]}::")
        notes.append(f"{models[key]}: {name} has no collision shape; left out")
    alone = Counter(models[key] for key in solid)
    return [
        _body(
            models[key] if alone[models[key]] == 1 else names[key],
            group,
            key == first(WORLD) or any(link.fixed for link in group),
        )
        for key, group in solid.items()
    ]


def _body(name: str, group: Sequence[WorldLink], fixed: bool) -> WorldBody:
    """One body in the frame of the group's first link."""
    pose = group[0].pose
    solids, inertials = [], []
    for link in group:
        pose_body_link = pose.inverse @ link.pose
        solids += [WorldSolid(each.shape, pose_body_link @ each.pose, each.friction) for each in link.solids]
        if link.inertial is not None:
            inertials.append(link.inertial.in_frame(pose_body_link.rotation, pose_body_link.translation))
    return WorldBody(name, pose, tuple(solids), fixed, combined(inertials))
