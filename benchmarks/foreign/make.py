"""Make sealed cases: `python -m benchmarks.foreign.make --seed-set dev|final --n N --out DIR`."""

import argparse
from pathlib import Path

from rich.progress import track

from benchmarks.foreign.case import make_case
from benchmarks.foreign.plan import SEEDS, plans
from benchmarks.foreign.seals import seal

QUICK = 5
"""Cases of --quick."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed-set", choices=sorted(SEEDS), required=True)
    parser.add_argument("--n", type=int, default=200, help="number of cases")
    parser.add_argument("--out", type=Path, required=True, help="an empty or new folder")
    parser.add_argument("--seconds", type=float, help="length of each recording; default: as its profile has it")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} cases of 10 s")
    arguments = parser.parse_args()
    folder: Path = arguments.out
    if folder.exists() and any(folder.iterdir()):
        parser.error(f"{folder} is not empty: cases of different runs must not mix")
    folder.mkdir(parents=True, exist_ok=True)
    labels = {}
    planned = list(plans(arguments.seed_set, QUICK if arguments.quick else arguments.n))
    for number, plan in enumerate(track(planned, description="cases"), start=1):
        name = f"case_{number:04d}"
        case = make_case(plan, 10.0 if arguments.quick else arguments.seconds)
        case.write(folder / name)
        labels[name] = case.label
    seal(folder, labels)
    print(f"{len(labels)} cases are in {folder}")


if __name__ == "__main__":
    main()
