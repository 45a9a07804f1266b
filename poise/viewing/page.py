"""What every report has: a page that stands on its own, where its numbers come from, and the pictures in it."""

import base64
import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup

import poise
from poise.files import sha256_of
from poise.viewing.canvas import Panel
from poise.viewing.inline_svg import inline_svg
from poise.viewing.wording import readable

_HERE = Path(__file__).parent


@dataclass(frozen=True)
class Finding:
    """One line under the headline; mark: good, warn or note."""

    mark: str
    text: str


def render_page(
    template: str, *, title: str, provenance: Sequence[tuple[str, str]], data: dict[str, Any], **content: Any
) -> str:
    """A report's HTML.

    The page loads nothing and forbids itself the network (Content-Security-Policy); what comes from outside is
    escaped.

    Args:
        template: file of this room that extends `page.html.j2`.
        title: heading, any text.
        provenance: (name, value) lines at its end.
        data: the numbers at full precision, for the JSON in the page; NaN becomes null.
        content: what else the template names.
    """
    script = (_HERE / "report.js").read_text(encoding="utf-8")
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_HERE), autoescape=True, undefined=jinja2.StrictUndefined
    )
    return environment.get_template(template).render(
        title=readable(title),
        # Markup: these two files are ours; everything else is escaped.
        style=Markup((_HERE / "report.css").read_text(encoding="utf-8")),
        script=Markup(script),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        provenance=[(name, readable(value, 1000)) for name, value in provenance],
        data=_without_nan(json.loads(json.dumps(data, default=lambda value: np.asarray(value).tolist()))),
        **content,
    )


def drawn(panels: Sequence[Panel]) -> list[dict[str, Any]]:
    """Panels as (key, svg), for the template's pictures."""
    return [{"key": panel.key, "svg": Markup(inline_svg(panel))} for panel in panels]


def origin(source: str) -> list[tuple[str, str]]:
    """The recording, with the SHA-256 of a file."""
    digest = sha256_of(Path(source))
    return [("Recording", source), *([("SHA-256", digest)] if digest else [])]


def making(command: str, now: datetime) -> list[tuple[str, str]]:
    """Version, command line and date."""
    return [
        ("Poise", poise.__version__),
        ("Command", command),
        ("Date", now.astimezone(UTC).strftime("%Y-%m-%d %H:%M:%S UTC")),
    ]


def _without_nan(value: Any) -> Any:
    """None for every number that is not finite, in nested lists and mappings."""
    if isinstance(value, dict):
        return {name: _without_nan(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
