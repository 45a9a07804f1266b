"""Why views do not agree: a clock, a camera that sits elsewhere on the hand, or an object that moved; each is tried."""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from poise.errors import InputError
from poise.geometry import Pose
from poise.scanning.conventions import other_meaning
from poise.scanning.flatness import FLAT, PIXELS, few_of, noise_of_table, table_spread
from poise.scanning.frames import View
from poise.scanning.fusion import coarse_points, pixels_of
from poise.scanning.placing import Sweep, turned_in_hand
from poise.scanning.support import find_plane
from poise.types import Array

_DELAYS, _NEARBY = np.linspace(-2.0, 2.0, 41), np.linspace(-0.1, 0.1, 9)
"""s that are tried, and around the best of them, in steps that move a slow camera by a mm or two."""
_TURNED, _SHIFTED = np.deg2rad(20.0), 0.1
"""rad and m up to which a camera is said to sit elsewhere: more fits anything, as another clock."""
_ALIASES = 3
"""Best delays of which the shortest is taken, if it is as good."""
_CURED = 0.5
"""Of the spread, that what is tried has to leave at the most."""
_ONE_TABLE = 8e-3
"""m, spread of a table in one view, above which it shows none."""
_LENGTH = 0.3
"""m, which turns an angle of the camera into a motion of what it sees."""


def likely_cause(sweep: Sweep, up: Array, farthest: float, poses: bool = False) -> str:
    """A sentence: what would make the views of a table agree; empty when nothing does.

    The table is seen by all views, and flat. Other meanings of the poses or of depth have no unknown, a delay has one
    and a pose of the camera on the hand six, so they are tried in this order. Views that agree about the table, but not
    about the object, show that this one moved.

    Args:
        sweep: whose views disagree.
        up: (3,) against gravity.
        farthest: m from the camera up to which it is looked at.
        poses: whether the views agree better about the object with other poses.
    """
    now = table_spread(sweep.views, up, farthest)
    noise = noise_of_table(sweep.views, up, farthest)
    flat = now < noise + FLAT and noise < _ONE_TABLE
    if flat and poses:
        return (
            "all views agree about the table, and better about the object with other poses of the camera: the hand-eye"
            " transform, the scale of depth or the clocks do not fit (poise calibrate)"
        )
    if flat:
        return (
            "all views agree about the table: the object moved, or was touched, during the sweep, or the camera smooths"
            " its depth or sees the object's surface at wrong places"
        )
    meant = other_meaning(sweep.views, up, farthest, now)
    if meant:
        return meant
    delay, delayed = _best_delay(sweep, up, farthest)
    mounted, rest = _mounting(sweep.views, up, farthest)
    if delayed - noise < _CURED * (now - noise) and delayed < rest + FLAT:
        return (
            f"the views agree when the images' stamps are taken as {1e3 * delay:+.0f} ms late: the clocks of camera and"
            f" joint states differ, or the driver stamps late; give it (--delay {delay:.3f})"
        )
    turn, shift = float(np.linalg.norm(mounted[:3])), float(np.linalg.norm(mounted[3:]))
    if rest - noise < _CURED * (now - noise) and turn < _TURNED and shift < _SHIFTED:
        return (
            f"the views agree when the camera is turned by {np.rad2deg(turn):.1f} deg and moved by {1e3 * shift:.0f} mm"
            " on the hand: the hand-eye transform is not this camera's; calibrate it (poise calibrate)"
        )
    return ""


def _best_delay(sweep: Sweep, up: Array, farthest: float) -> tuple[float, float]:
    """The delay, s, with which the views show the flattest table, and the spread left, m."""

    def spread(delay: float) -> float:
        views = sweep.delayed(delay)
        return table_spread(views, up, farthest) if len(views) > len(sweep.views) / 2 else float("inf")

    coarse = np.array([spread(float(delay)) for delay in _DELAYS])
    around = np.pad(coarse, 1, constant_values=np.inf)
    lowest = np.flatnonzero((coarse <= around[:-2]) & (coarse < around[2:]))
    lowest = lowest[np.argsort(coarse[lowest])[:_ALIASES]]  # a camera that sways looks alike after a period
    found = []
    for number in lowest:
        left = {float(delay): spread(float(delay)) for delay in _DELAYS[number] + _NEARBY}
        delay = min(left, key=lambda one: left[one])
        found.append((delay, left[delay]))
    flat = min(left for _, left in found) + FLAT
    return min((one for one in found if one[1] <= flat), key=lambda one: abs(one[0]))


def _mounting(views: Sequence[View], up: Array, farthest: float) -> tuple[Array, float]:
    """(6,) rotation vector and shift, m, of the camera on the hand that flatten the table; and the spread left, m."""
    few = few_of(views)
    pixels = [view.in_camera(pixels_of(view, PIXELS, farthest)).astype(np.float64) for view in few]
    if not few or min(map(len, pixels)) < 10:
        return np.zeros(6), float("inf")
    try:
        plane = find_plane(coarse_points(few[:1], farthest), up, np.random.default_rng(0))
        start = np.append(plane.normal[:2] / plane.normal[2], plane.offset / plane.normal[2])
    except InputError:
        start = np.array([0.0, 0.0, float(np.median(np.concatenate([p[:, 2] for p in _world(few, pixels, None)])))])

    def heights(unknowns: Array) -> Array:
        change = Pose(Rotation.from_rotvec(unknowns[:3] / _LENGTH).as_matrix(), unknowns[3:6])
        points = np.concatenate(_world(few, pixels, change))
        return np.asarray(points[:, 2] - points[:, :2] @ -unknowns[6:8] - unknowns[8])

    unknowns = np.concatenate([np.zeros(6), start])
    found = least_squares(heights, unknowns, loss="soft_l1", f_scale=2e-3, max_nfev=40)
    left = 1.4826 * float(np.median(np.abs(heights(found.x))))
    return np.concatenate([found.x[:3] / _LENGTH, found.x[3:6]]), left


def _world(views: Sequence[View], pixels: Sequence[Array], change: Pose | None) -> list[Array]:
    moved = views if change is None else [turned_in_hand(view, change) for view in views]
    return [
        points @ view.rotation_world_camera.T + view.translation_world_camera
        for view, points in zip(moved, pixels, strict=True)
    ]
