"""Results as Markdown, for the pages of the documentation: means with the standard error of their trials."""

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

COLUMNS = {"mass": "e_m %", "com": "e_c %", "inertia": "e_I %"}
OTHERS = ("riemannian", "consistent", "effort", "nees", "covered", "delay_error", "failed")
HEADINGS = (
    "",
    *COLUMNS.values(),
    "e_Rie",
    "consistent %",
    "effort %",
    "NEES/10",
    "95 % holds",
    "delay ms",
    "no answer %",
)


def page(path: Path) -> str:
    """A table per scenario of a result file that `run` has written."""
    content = json.loads(path.read_text())
    groups: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for trial in content["trials"]:
        groups.setdefault(trial["scenario"], {}).setdefault(trial["method"], []).append(trial)
    lines = [f"### {content['title']}", ""]
    for scenario, methods in groups.items():
        lines += [f"**{scenario}**", "", f"| {' | '.join(HEADINGS)} |", f"|---{'|--:' * (len(HEADINGS) - 1)}|"]
        lines += [f"| {name} | {' | '.join(_cells(trials))} |" for name, trials in methods.items()]
        lines.append("")
    return "\n".join(lines)


def _cells(trials: list[dict[str, Any]]) -> list[str]:
    answers = [trial for trial in trials if not trial["failure"]]

    def values(name: str) -> list[float]:
        return [trial[name] for trial in answers if trial[name] is not None]

    is_bound = not any(values("seconds"))
    cells = [_with_error(values(name)) for name in COLUMNS]
    if is_bound:
        return cells + [""] * len(OTHERS)
    whole = len(values("riemannian")) == len(answers)  # of what cannot exist there is no e_Rie
    means = [
        _mean(values("riemannian")) if whole else "",
        f"{100 * np.mean(values('consistent')):.0f}" if answers else "",
    ]
    means += [_mean(values("effort")), _mean(values("nees"), 0.1), _mean(values("covered"))]
    means += [_mean(values("delay_error"), 1e3), f"{100 * (1 - len(answers) / len(trials)):.0f}"]
    return cells + means


def _mean(values: list[float], scale: float = 1.0) -> str:
    return _short(scale * float(np.mean(values))) if values else ""


def _with_error(values: list[float]) -> str:
    if not values:
        return ""
    mean, error = float(np.mean(values)), float(np.std(values, ddof=1) / math.sqrt(len(values)))
    return ">500" if mean > 500 else f"{_short(mean)} ± {_short(error)}"


def _short(value: float) -> str:
    return f"{value:.{2 if value < 10 else 1 if value < 100 else 0}f}"


if __name__ == "__main__":
    for name in sys.argv[1:]:
        print(page(Path(name)))
