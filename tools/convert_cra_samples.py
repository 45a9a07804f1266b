"""Makes test/assembly/cra_samples.json: sample assemblies of compas_cra, and its own verdicts on them.

Run with the Python of an environment that has compas_cra (PyPI, MIT): `pip install compas_cra`, some minutes.
"""

import contextlib
import io
import json
import sys
from pathlib import Path

import compas
import compas_cra
from compas_cra.algorithms import assembly_interfaces_numpy
from compas_cra.datastructures import CRA_Assembly
from compas_cra.equilibrium import cra_solve

SAMPLES = Path(compas_cra.__file__).parent / "data" / "samples"
TARGET = Path(__file__).resolve().parents[1] / "test" / "assembly" / "cra_samples.json"
FRICTIONS = (0.84, 0.3)
# Fixed blocks, and turns about an axis in degrees, as in the examples of compas_cra.
UPRIGHT = {
    "A": (0, 1),
    "H": (0, 1),
    "cubes": (0,),
    "concave-long": (0,),
    "concave-short": (0,),
    **{f"shelf{kind}": (0,) for kind in ("", "-s1", "-s2", "-s3", "-stable")},
}
WEDGES = tuple(f"type-{kind}" for kind in "abcd")
TURNS = (("y", 0), ("y", 90), ("x", 90), ("x", 40))
CASES = [(name, fixed, "y", 0) for name, fixed in UPRIGHT.items()]
CASES += [(name, (0, 1), axis, degrees) for name in WEDGES for axis, degrees in TURNS]
NOTICE = (
    "Geometry of the samples of compas_cra, Copyright (c) 2020-2022 ETH Zurich, Block Research Group, "
    "Gene Ting-Chun Kao; MIT License: Permission is hereby granted, free of charge, to any person obtaining a copy of "
    'this software and associated documentation files (the "Software"), to deal in the Software without restriction, '
    "including without limitation the rights to use, copy, modify, merge, publish, distribute, sublicense, and/or "
    "sell copies of the Software, and to permit persons to whom the Software is furnished to do so, subject to the "
    "following conditions: The above copyright notice and this permission notice shall be included in all copies or "
    'substantial portions of the Software. THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR '
    "IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND "
    "NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER "
    "LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM, OUT OF OR IN CONNECTION WITH THE "
    "SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE."
)


def geometry(name: str) -> dict[str, object]:
    """Vertices (m) and faces (loops of vertex numbers, counter-clockwise from outside) of each block, by its key."""
    nodes = json.loads((SAMPLES / f"{name}.json").read_text())["data"]["graph"]["data"]["node"]
    blocks = {}
    for key, node in nodes.items():
        data = node["block"]["data"]
        number = {int(vertex): i for i, vertex in enumerate(data["vertex"])}
        vertices = [[round(place[axis], 9) for axis in "xyz"] for place in data["vertex"].values()]
        blocks[key] = {"vertices": vertices, "faces": [[number[v] for v in loop] for loop in data["face"].values()]}
    return blocks


def verdict(name: str, fixed: tuple[int, ...], axis: str, degrees: float, friction: float) -> bool | None:
    """Whether CRA finds a solution; None when its solver gave up without a verdict."""
    assembly = compas.json_load(str(SAMPLES / f"{name}.json")).copy(cls=CRA_Assembly)
    assembly.set_boundary_conditions(list(fixed))
    assembly_interfaces_numpy(assembly, nmax=10, amin=1e-4, tmax=1e-3)
    if degrees:
        assembly.rotate_assembly([0, 0, 0], [1, 0, 0] if axis == "x" else [0, 1, 0], degrees)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            cra_solve(assembly, mu=friction, density=1.0)
    except ValueError as error:
        return False if "infeasible" in str(error) else None
    return True


def main() -> None:
    """Convert, judge and write."""
    cases = []
    for name, fixed, axis, degrees in CASES:
        for friction in FRICTIONS:
            found = verdict(name, fixed, axis, degrees, friction)
            sys.stderr.write(f"{name} {axis} {degrees} {friction}: {found}\n")
            case = {"sample": name, "fixed": fixed, "axis": axis, "degrees": degrees, "friction": friction}
            cases.append({**case, "stands": found})
    samples = {name: geometry(name) for name in [*UPRIGHT, *WEDGES]}
    content = {"notice": NOTICE, "version": compas_cra.__version__, "samples": samples, "cases": cases}
    TARGET.write_text(json.dumps(content, separators=(",", ":")) + "\n")


if __name__ == "__main__":
    main()
