"""Why poses cannot be settled: which objects are too far apart, or overlap too much, for their uncertainty."""

from collections.abc import Sequence

import numpy as np

from poise.assembly.contact import distance_between
from poise.assembly.scene import RigidObject
from poise.assembly.settling.belief import SeenBodies
from poise.assembly.settling.rows import DistanceRows
from poise.errors import ErrorCode, InputError
from poise.types import Array

_FIX = "check the poses and the sizes, or state a larger pose_std"


def not_carried(items: Sequence[RigidObject], place: int, loose: Sequence[int], sigmas: float) -> InputError:
    """The error for an object that nothing holds, naming the nearest one that could.

    Args:
        items: all objects.
        place: of the object.
        loose: places of all objects that nothing holds; an object that lies on this one is nearer than its support.
        sigmas: accepted.
    """
    item = items[place]
    if len(items) < 2:
        return InputError(ErrorCode.FLOATING, f"nothing holds {item.id}: there is no other object", objects=[item.id])
    others = set(range(len(items))).difference(loose) or set(range(len(items))).difference([place])
    distances = [distance_between(item, other) if k in others else np.inf for k, other in enumerate(items)]
    nearest = int(np.argmin(distances))
    distance, other = float(distances[nearest]), items[nearest]
    explained = sigmas * sum(_position_std(one) for one in (item, other))
    where = (
        f"{distance * 1e3:.1f} mm away" if distance > 0 else f"in contact with it, but no face of it carries {item.id}"
    )
    return InputError(
        ErrorCode.FLOATING,
        f"nothing holds {item.id}: the nearest object that could, {other.id}, is {where}, and the stated "
        f"uncertainty explains {explained * 1e3:.1f} mm; {_FIX}",
        objects=[item.id],
        nearest=other.id,
        distance=distance,
    )


def _position_std(item: RigidObject) -> float:
    known = item.fixed or item.pose_covariance is None
    return 0.0 if known else float(np.sqrt(np.max(np.diag(np.asarray(item.pose_covariance))[:3])))


def still_overlapping(first: RigidObject, second: RigidObject, depth: float) -> InputError:
    """The error for two objects that overlap at the most likely poses, m."""
    return InputError(
        ErrorCode.INTERPENETRATION,
        f"objects {first.id} and {second.id} overlap by {depth * 1e3:.2f} mm at the most likely poses, settled with "
        "the stated uncertainty; check their poses and sizes, and whether one object was seen twice",
        objects=(first.id, second.id),
        depth=depth,
    )


def moved_too_far(
    items: Sequence[RigidObject],
    bodies: SeenBodies,
    rows: DistanceRows,
    lacking: Array,
    moved: tuple[str, float],
    sigmas: float,
) -> InputError:
    """The error for an object that would have to move too far, naming the pair that is the farthest off.

    Args:
        items: all objects.
        bodies: where they were seen.
        rows: distances that were brought to their bounds.
        lacking: (R,) m by which each missed its bound where the objects were seen; negative when it was too large.
        moved: the object's id, and by how many sigmas.
        sigmas: accepted.
    """
    spread = np.maximum(bodies.spread(rows)[0], 1e-9)
    place = next(place for place, item in enumerate(items) if item.id == moved[0])
    own = (rows.first == place) | (rows.second == place)
    worst = int(np.argmax(np.abs(lacking) / spread * np.where(own, 1.0, 1e-6)))
    names = items[rows.first[worst]].id, items[rows.second[worst]].id
    overlap = lacking[worst] > 0
    what = "overlap by" if overlap else "should touch, but are apart by"
    return InputError(
        ErrorCode.INTERPENETRATION if overlap else ErrorCode.FLOATING,
        f"objects {names[0]} and {names[1]} {what} {abs(lacking[worst]) * 1e3:.1f} mm: poses that touch would move "
        f"{moved[0]} by {moved[1]:.1f} standard deviations (up to {sigmas:.1f} are accepted); {_FIX}",
        objects=names,
        distance=float(-lacking[worst]),
        sigmas=moved[1],
    )
