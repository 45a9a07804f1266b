"""Make the cases: `python -m benchmarks.concealed.make --seeds development|final --cases N --out DIR`.

With `--effects NAME ...`, `--cases` of each of these effects, at 1.0 and 0.3 in turn; they have seeds of their own.
"""

import argparse
import functools
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from benchmarks.concealed.case import Plan, make_case
from benchmarks.concealed.changes import LIBRARY
from benchmarks.concealed.plan import SEEDS, draw_plans, plans_of
from benchmarks.concealed.seals import Sealed, private_file, sealed, write_seals


def make_one(folder: Path, numbered: tuple[int, Plan]) -> tuple[str, Sealed]:
    """Write one case's bag and model.yaml; its name and its sealed label."""
    number, plan = numbered
    name = f"case_{number + 1:04d}"
    case = make_case(plan)
    case.write(folder, name)
    return name, sealed(case.label.document())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    chosen = parser.add_mutually_exclusive_group(required=True)
    chosen.add_argument("--seeds", choices=sorted(SEEDS))
    chosen.add_argument("--effects", nargs="+", choices=sorted(LIBRARY), metavar="NAME", help="of these alone")
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--out", type=Path, required=True, help="a folder that is not there yet, or empty")
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    folder: Path = arguments.out
    if folder.exists() and any(folder.iterdir()):
        parser.error(f"{folder} is not empty: bags and labels of different runs must not mix")
    folder.mkdir(parents=True, exist_ok=True)
    cases: int = arguments.cases
    drawn = plans_of(arguments.effects, cases) if arguments.effects else draw_plans(arguments.seeds, cases)
    plans = list(enumerate(drawn))
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns) as progress, ProcessPoolExecutor(arguments.processes) as pool:
        made = progress.track(pool.map(functools.partial(make_one, folder), plans), len(plans), description="cases")
        write_seals(folder, dict(made))
    print(f"{len(plans)} cases in {folder}; their labels, to be opened by the scorer alone: {private_file(folder)}")


if __name__ == "__main__":
    main()
