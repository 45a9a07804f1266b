"""Make cases: `python -m benchmarks.weighing.make --seed-set dev|final --out DIR`; the truth lies beside DIR."""

import argparse
from collections.abc import Iterator
from pathlib import Path

from rich.progress import track

from benchmarks.foreign.seals import seal
from benchmarks.weighing.case import WAYS, Plan, make_case
from benchmarks.weighing.kinds import KINDS
from benchmarks.weighing.objects import OBJECTS

SEEDS = {"dev": 41207, "final": 530917462}


def plans(seeds: str, kinds: tuple[str, ...], count: int, healthy: int) -> Iterator[Plan]:
    """Cases of a set of seeds; more cases of a kind begin with the same ones.

    Args:
        seeds: name in SEEDS. kinds: names. count: cases of each, in turn over motions and objects; 15 are all pairs.
        healthy: recordings without trouble, every second one of the other generator; spread evenly, so that the first
            cases of a set are a fair part of it.
    """
    every = [kind.name for kind in KINDS]
    items, ways = list(OBJECTS), list(WAYS)
    for number in range(count):
        for name in kinds:
            row = every.index(name)
            item, way = items[(row + number + number // 15) % len(items)], ways[(row + number) % len(ways)]
            yield Plan((SEEDS[seeds], row + 1, number), name, item, way)
        yield from (_healthy(seeds, i) for i in range(number * healthy // count, (number + 1) * healthy // count))


def _healthy(seeds: str, number: int) -> Plan:
    items, ways = list(OBJECTS), list(WAYS)
    item, way = items[number // 2 % len(items)], ways[number // 2 % len(ways)]
    return Plan((SEEDS[seeds], 0, number), "healthy", item, way, ("robot", "tf")[number % 2])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed-set", choices=sorted(SEEDS), required=True)
    parser.add_argument("--kinds", nargs="*", default=[kind.name for kind in KINDS], help="names; default: all")
    parser.add_argument("--n", type=int, default=15, help="cases of each kind: 15 are 5 objects x 3 motions")
    parser.add_argument("--healthy", type=int, default=200, help="recordings without trouble")
    parser.add_argument("--out", type=Path, required=True, help="an empty or new folder")
    parser.add_argument("--seconds", type=float, help="length of each recording; default: 13 to 19 s")
    arguments = parser.parse_args()
    folder: Path = arguments.out
    unknown = set(arguments.kinds) - {kind.name for kind in KINDS}
    if unknown:
        parser.error(f"{', '.join(sorted(unknown))}: the kinds are {', '.join(kind.name for kind in KINDS)}")
    if folder.exists() and any(folder.iterdir()):
        parser.error(f"{folder} is not empty: cases of different runs must not mix")
    folder.mkdir(parents=True, exist_ok=True)
    labels = {}
    planned = list(plans(arguments.seed_set, tuple(arguments.kinds), arguments.n, arguments.healthy))
    for number, plan in enumerate(track(planned, description="cases"), start=1):
        name = f"case_{number:04d}"
        case = make_case(plan, arguments.seconds)
        case.write(folder / name)
        labels[name] = case.label
    seal(folder, labels)
    print(f"{len(labels)} cases are in {folder}")


if __name__ == "__main__":
    main()
