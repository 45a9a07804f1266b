"""Open the seals and score the answers: `python -m benchmarks.concealed.score DIR DIR.seals.json [--out FOLDER]`."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console

from benchmarks.concealed.confusion import draw
from benchmarks.concealed.run import ANSWERS, TIMES
from benchmarks.concealed.seals import open_seals
from benchmarks.concealed.table import rendered, score
from benchmarks.concealed.tally import Verdict, judge


def judge_all(folder: Path, private: Path) -> list[Verdict]:
    """The verdict on every case; one without an answer counts as wrong.

    Raises:
        ValueError: as `open_seals`.
    """
    return [
        judge(case, label, read_json(folder / ANSWERS / f"{case}.json"))
        for case, label in sorted(open_seals(folder, private).items())
    ]


def document(verdicts: list[Verdict], rows: list[Any]) -> dict[str, Any]:
    """What is kept of a score: the table, and each case in short."""
    short = [
        {
            "case": v.case,
            "kind": v.kind,
            "strength": v.strength,
            "truth": list(v.truth),
            "verdict": v.verdict,
            "named": list(v.named),
            "right": v.right,
            "errors": {f"{name}.{stem}": round(error, 4) for (name, stem), error in v.errors.items()},
        }
        for v in verdicts
    ]
    return {"table": [asdict(row) for row in rows], "cases": short}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("seals", type=Path)
    parser.add_argument("--out", type=Path, help="folder for score.json and confusion.png; default: DIR/answers")
    parser.add_argument("--wrong", action="store_true", help="list the cases that were not right")
    arguments = parser.parse_args()
    try:
        verdicts = judge_all(arguments.folder, arguments.seals)
    except (OSError, ValueError) as error:
        parser.error(str(error))
    rows = score(verdicts, read_json(arguments.folder / ANSWERS / TIMES) or {})
    console = Console(width=110)
    console.print(rendered(rows))
    if arguments.wrong:
        for v in verdicts:
            if not v.right or v.extra:
                console.print(f"{v.case} {v.kind} {v.strength:g}: {', '.join(v.truth) or '-'} -> {v.verdict} {v.named}")
    out = arguments.out or arguments.folder / ANSWERS
    out.mkdir(parents=True, exist_ok=True)
    (out / "score.json").write_text(json.dumps(document(verdicts, rows), indent=1) + "\n", encoding="utf-8")
    draw(out / "confusion.png", verdicts)
    console.print(f"score.json and confusion.png are in {out}")


def read_json(path: Path) -> dict[str, Any] | None:
    """What a file holds; None when there is none."""
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


if __name__ == "__main__":
    main()
