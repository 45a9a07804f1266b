"""Poses and depth that mean something else than REP-103 and REP-118 say: each usual other meaning is tried."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from poise.scanning.camera import Camera
from poise.scanning.flatness import FLAT, few_of, noise_of_table, table_spread
from poise.scanning.frames import View
from poise.types import Array

_CURED, _FLATTEST = 0.5, 4e-3
"""Share of the table's spread, and m, that the other meaning has to leave at the most."""
_FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""An optical frame in a body whose x is forward and z up."""


def other_meaning(views: Sequence[View], up: Array, farthest: float, now: float) -> str:
    """A sentence: with which other meaning of the poses or of depth the views show one table; empty with none.

    Args:
        views: that show none.
        up: (3,) against gravity.
        farthest: m from the camera up to which it is looked at.
        now: m, spread of their table.
    """
    few = few_of(views)
    for meant, sentence in _MEANINGS:
        others = [meant(view) for view in few]
        left = table_spread(others, up, farthest)
        if left < min(_CURED * now, _FLATTEST) and left < noise_of_table(others, up, farthest) + FLAT:
            return sentence
    return ""


def _inverse(view: View) -> View:
    turn = view.rotation_world_camera.T
    return replace(view, rotation_world_camera=turn, translation_world_camera=-turn @ view.translation_world_camera)


def _turned(turn: Array) -> Callable[[View], View]:
    return lambda view: replace(view, rotation_world_camera=view.rotation_world_camera @ turn)


def _along_axis(view: View) -> View:
    """With its depth taken as the distance from the camera."""
    depth = (view.frame.depth / ray_lengths(view.frame.camera)).astype(np.float32)
    return replace(view, frame=replace(view.frame, depth=depth))


def ray_lengths(camera: Camera) -> Array:
    """(H, W) distance of what each pixel sees, over its depth along the optical axis."""
    x = (np.arange(camera.width) - camera.cx) / camera.fx
    y = (np.arange(camera.height) - camera.cy) / camera.fy
    return np.asarray(np.sqrt(1 + x**2 + y[:, None] ** 2))


_MEANINGS: tuple[tuple[Callable[[View], View], str], ...] = (
    (
        _along_axis,
        "the views agree if depth is the distance from the camera: give the depth along the optical axis (REP-118)",
    ),
    (_inverse, "the views agree if the poses are inverted: give those of the camera in the world, not the reverse"),
    (
        _turned(np.diag([1.0, -1.0, -1.0])),
        "the views agree if the camera's z points backwards and y up, as in OpenGL: give poses of the optical frame,"
        " z forward and y down (REP-103)",
    ),
    (
        _turned(_FORWARD),
        "the views agree if the camera's x points forward: give poses of the optical frame, z forward and y down"
        " (REP-103), or its transform from camera_link",
    ),
)
