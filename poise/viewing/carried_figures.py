"""The picture of a scene on a base that moves: its load over time, and how far the objects moved."""

from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from poise.mismatch.carried import CarriedAnswer, CarriedRecording
from poise.viewing.canvas import PALETTE, Panel, add_axes

_SIZE = (720, 190)
_COLOURS = ("axis-x", "axis-y", "axis-z", "accent", "rejected")


def carried_panels(recording: CarriedRecording, found: CarriedAnswer) -> list[Panel]:
    """The load of the scene as declared, and the displacement of each object."""
    return [_load(found), _displacement(recording, found)]


def _load(found: CarriedAnswer) -> Panel:
    def draw(figure: FigureBase) -> None:
        axes = add_axes(figure, "Load: acceleration over the limit of the scene as declared")
        axes.plot(found.seconds, found.loading.load, color=PALETTE["accent"], linewidth=1.2)
        axes.axhline(1.0, color=PALETTE["rejected"], linewidth=1.0)
        axes.set_ylim(0.0, max(1.2, min(float(found.most), 3.0)) * 1.05)
        _marks(axes, found)

    return Panel("load", f"The load reaches {found.most:.2f}; from 1 on something moves.", draw, _SIZE)


def _displacement(recording: CarriedRecording, found: CarriedAnswer) -> Panel:
    def draw(figure: FigureBase) -> None:
        axes = add_axes(figure, "Objects, mm from where they stood on the base")
        for number, (name, track) in enumerate(recording.objects.items()):
            colour = PALETTE[_COLOURS[number % len(_COLOURS)]]
            axes.plot(track.seconds, 1e3 * track.moved, color=colour, linewidth=1.1, label=name)
        axes.set_ylim(0.0, 60.0)
        axes.legend(loc="upper left", fontsize=10, frameon=False)
        _marks(axes, found)

    names = ", ".join(one.object for one in found.seen) or "nothing"
    return Panel("objects", f"How far the objects moved on the base: {names} moved.", draw, _SIZE)


def _marks(axes: Axes, found: CarriedAnswer) -> None:
    """When the first object moved, and when it was predicted to."""
    if found.predicted is not None:
        axes.axvline(found.predicted.time, color=PALETTE["muted"], linewidth=1.0, linestyle="--")
        axes.text(found.predicted.time, axes.get_ylim()[1], " predicted", va="top", fontsize=10, color=PALETTE["muted"])
    if found.seen:
        axes.axvline(found.seen[0].time, color=PALETTE["ink"], linewidth=1.0)
        axes.text(
            found.seen[0].time, 0.85 * axes.get_ylim()[1], " recorded", va="top", fontsize=10, color=PALETTE["ink"]
        )
