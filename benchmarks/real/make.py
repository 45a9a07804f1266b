"""Convert the published files into recordings: `python -m benchmarks.real.make OUT --data DATA`.

DATA holds the folders `tx40`, `ur10_unisa` and `so101` that benchmarks/real/README.md lists; a rig whose files are not
there is left out. EMPS and KUKA lie in this repository.
"""

import argparse
import os
from pathlib import Path

from benchmarks.real.rigs import RIGS
from poise.errors import InputError

DATA = "POISE_REAL_RECORDINGS"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    default = os.environ.get(DATA)
    parser.add_argument("--data", type=Path, default=Path(default) if default else None, help=f"default: ${DATA}")
    arguments = parser.parse_args()
    for rig in RIGS:
        target: Path = arguments.out / rig.name
        target.mkdir(parents=True, exist_ok=True)
        try:
            rig.convert(arguments.data or Path("none"), target)
            print(f"{rig.title}: {', '.join(sorted(path.name for path in target.iterdir()))}")
        except (InputError, OSError) as error:
            print(f"{rig.title}: left out, {error}")


if __name__ == "__main__":
    main()
