"""matplotlib figures as SVG that lives inside an HTML page: its text, its colours, its identifiers."""

import html
import io
import json
import math
import re
from typing import Any

import matplotlib

from poise.viewing.canvas import PALETTE, STYLE, Panel


def inline_svg(panel: Panel) -> str:
    """Draw a panel as an <svg> element; the same panel gives the same text.

    Colours of the palette become CSS variables (`var(--accent)`), so that the page's light or dark scheme rules them;
    text takes the page's font; identifiers get the panel's key in front, so that many fit on one page.
    The attribute `data-plot` gives the page's script the position and the range of the axes.
    """
    with matplotlib.rc_context(STYLE):
        figure = panel.figure()
        file = io.StringIO()
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(file, format="svg", transparent=True, metadata=nothing)
    text = file.getvalue()
    body = text[text.index(">", text.index("<svg")) + 1 : text.rindex("</svg>")]
    body = re.sub(r"<style.*?</style>|<metadata>.*?</metadata>|<!--.*?-->", "", body, flags=re.DOTALL)
    body = re.sub(r"font: ([\d.]+)px[^;\"]*", r"font-size: \1px", body)
    # A hundredth of a pixel is enough for coordinates; the text between the tags keeps its digits.
    body = re.sub(r'="[^"]*"', lambda attribute: re.sub(r"(\.\d\d)\d+", r"\1", attribute[0]), body)
    body = body.replace("xlink:href", "href")
    body = body.replace('id="', f'id="{panel.key}-').replace("url(#", f"url(#{panel.key}-")
    body = body.replace('href="#', f'href="#{panel.key}-')
    body = re.sub(r"\n\s*", "\n", body)
    for role, colour in PALETTE.items():
        body = body.replace(colour, f"var(--{role})")
    width, height = panel.size
    return (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{html.escape(panel.alt)}" '
        f"data-plot='{html.escape(json.dumps(_axes_of(figure, height)))}'>{body}</svg>"
    )


def _axes_of(figure: Any, height: int) -> dict[str, Any]:
    """Where the axes that carry series lie (points from the top left) and what they span; empty without such."""
    for axes in figure.axes:
        if axes.get_gid() == "plot":
            box = axes.get_window_extent()
            area = [box.x0, height - box.y0, box.x1, height - box.y1]
            log = axes.get_yscale() == "log"
            span = [*axes.get_ylim()]
            plot = {"area": [round(float(v), 2) for v in area], "x": [*axes.get_xlim()]}
            return {**plot, "y": [math.log10(v) for v in span], "log": True} if log else {**plot, "y": span}
    return {}
