"""Was the object seen from all sides? Checks of a carved solid against its cloud."""

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.shape.missing import Missing
from poise.shape.solid import Solid

_BARE_ERROR, _BARE_NOTE = 0.06, 0.045
"""Shares of points without anything behind them: of 490 whole clouds 8 had more than the first, of which 5 were very
uneven and 3 too small by a sixth to a third; 0.2 of half surfaces."""
_SINGLE_ERROR = 0.14
"""Share of the surface that is one layer: of 490 whole clouds only those of a ruler as thin as the noise, and one that
was a fifth of its volume, had more; of what one view shows all."""
_STD_ERROR, _STD_NOTE = 0.5, 0.2
"""The same of the volume's deviation over the volume."""
_INSIDE_NOTE = 0.08
"""Share of points inside the solid: of solid objects at most 0.07."""
_LAYERS_NOTE = 0.45
"""Spread besides the noise, over it: of random clouds with noise at most 0.43, with a layer inside 0.44 to 0.8."""
_THIN_WALL = 3.0
"""Thickness of a wall, in sigmas, of which few points look like noise."""
_SMALL_PIECE = 0.03
_REMEDY = "scan it from the other sides too, or complete its bottom on the support plane"


def check_coverage(
    carved: Solid, solid: Solid, missing: Missing, inside: float = 0.0, layers: float = 0.0, blur: float = 0.0
) -> tuple[str, ...]:
    """Sentences about a solid that is not quite trusted.

    Args:
        carved: of the points.
        solid: the same, moved to what explains them, with the uncertainty of its volume.
        missing: surface that the points do not show.
        inside: share of the points that lie deep inside.
        layers: how much the points spread about the surface besides the noise, over the noise.
        blur: m, noise that few points cannot distinguish from thin walls; 0 where it is known.

    Raises:
        InputError: SCAN_INCOMPLETE when the points show only some sides of the object.
    """
    _refuse(carved, solid, missing)
    notes = []
    doubt = solid.volume_std / max(solid.volume, 1e-12)
    if missing.bare > _BARE_NOTE or doubt > _STD_NOTE:
        notes.append(f"the volume is uncertain by {doubt:.0%}; if a side of the object was not seen, {_REMEDY}")
    notes += _sentences(solid, missing)
    if inside > _INSIDE_NOTE:
        notes.append(
            f"{inside:.0%} of the points lie inside: the object is hollow, with an opening that is too narrow for their"
            " spacing, or the cloud has inner faces; its volume is then too large: give more points, or the outside"
        )
    if layers > _LAYERS_NOTE:
        notes.append(
            "points lie in layers, which white noise does not explain (inner faces of a model, or views that do not"
            " agree); the volume may be too small: state the noise (--noise), or give points of the outside alone"
        )
    if blur > 0:
        notes.append(
            f"the points seem to have a noise of {1e3 * blur:.2g} mm, but are too few to distinguish it from walls and"
            f" gaps below {1e3 * _THIN_WALL * blur:.1g} mm: if the object is hollow or has such, its volume is wrong;"
            " give more points, or state the noise (--noise)"
        )
    pieces = carved.pieces()[0] / carved.volume
    large = int(np.sum(pieces > _SMALL_PIECE))
    if large > 1:
        notes.append(f"the points form {large} pieces that do not touch; if they are several objects, give one")
    return tuple(notes)


def wide_gap(solid: Solid) -> tuple[str, ...]:
    """The sentence about a wide gap that the points leave, with the volume of the finished solid; none without one."""
    if solid.between is None:
        return ()
    opening, hole, taken = (f"{1e6 * volume:.3g}" for volume in (*solid.between, solid.volume))
    return (
        f"the points leave a wide gap: the volume is about {opening} cm3 if it is an opening, as that of a cup, and"
        f" about {hole} cm3 if the surface there was not sampled; {taken} cm3 was taken: give more points",
    )


def _sentences(solid: Solid, missing: Missing) -> list[str]:
    """What is said of surface that the points do not show, or show twice."""
    notes = []
    for face in missing.faces[:1]:
        place = ", ".join(f"{1e3 * value:.0f}" for value in face.middle)
        notes.append(
            f"a flat face of {1e4 * face.area:.2g} cm2 at ({place}) mm has no points: the object was closed there, but"
            f" it may go on, which volume_std includes; {_REMEDY}"
        )
    if missing.image:
        notes.append(
            "one half of the solid has fewer points, and is the mirror image of the other half: if a glossy table shows"
            f" the object again below it, the volume is {1e6 * solid.volume / 2:.3g} cm3; leave out what is below"
        )
    return notes


def _refuse(carved: Solid, solid: Solid, missing: Missing) -> None:
    """Raise what `check_coverage` raises; arguments as there."""
    bare, doubt = missing.bare, carved.volume_std / carved.volume
    if bare > _BARE_ERROR or doubt > _STD_ERROR:
        raise InputError(
            ErrorCode.SCAN_INCOMPLETE,
            f"cloud: {bare:.0%} of its points have nothing behind them and the volume is uncertain by {doubt:.0%}: "
            f"some sides of the object are missing; {_REMEDY}",
            bare=bare,
        )
    if missing.single > _SINGLE_ERROR or (missing.share > 0 and solid.volume_std > solid.volume):
        raise InputError(
            ErrorCode.SCAN_INCOMPLETE,
            f"cloud: {missing.single:.0%} of the surface is one layer of points: it was seen from one side only, or is"
            f" as thin as the noise; {_REMEDY}, or give points with less noise",
            single=missing.single,
        )
