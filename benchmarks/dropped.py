"""Bodies dropped into a bin in MuJoCo, and taken from there: whether they stand, beside MuJoCo in finer steps.

`python -m benchmarks.dropped --scenes 10 --seed 3`: boxes, or boxes and cylinders with rolling resistance.
"""

import argparse
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np

from poise.assembly import Analysis, Assembly, Box, Cylinder, RigidObject
from poise.errors import PoiseError
from poise.geometry import Pose, rotation_of_quaternion, unit

BIN, HIGH, FRICTION = 0.5, 0.6, 0.5
SIZES = (4, 8, 12)
MOVES = 1e-3
"""m of a body in `_LONGER` s more, from where it is said to move."""
_SECONDS, _LONGER = 8.0, 8.0


def walls() -> list[RigidObject]:
    """A floor and four walls."""
    half = BIN / 2 + 0.05
    boxes = {
        "floor": ((2.0, 2.0, 0.1), (0.0, 0.0, -0.05)),
        **{f"x{s}": ((0.1, BIN, HIGH), (s * half, 0.0, HIGH / 2)) for s in (1, -1)},
        **{f"y{s}": ((BIN, 0.1, HIGH), (0.0, s * half, HIGH / 2)) for s in (1, -1)},
    }
    return [
        RigidObject(name, Box(size), Pose(np.eye(3), np.array(at)), fixed=True) for name, (size, at) in boxes.items()
    ]


def bodies(count: int, round_share: float, rng: np.random.Generator) -> list[RigidObject]:
    """Boxes and cylinders above each other, turned at random."""
    found = []
    for number in range(count):
        x, y, z = rng.uniform(0.04, 0.12, 3).tolist()
        shape = Cylinder(x / 2, y) if rng.random() < round_share else Box((x, y, z))
        place = np.array([*rng.uniform(-BIN / 3, BIN / 3, 2), 0.3 + 0.16 * number])
        pose = Pose(rotation_of_quaternion(unit(rng.normal(size=4))), place)
        found.append(RigidObject(f"body{number}", shape, pose, mass=float(rng.uniform(0.2, 2))))
    return found


def _geom(item: RigidObject) -> str:
    if isinstance(item.shape, Box):
        kind, sizes = "box", [side / 2 for side in item.shape.size]
    else:
        kind, sizes = "cylinder", [item.shape.radius, item.shape.length / 2]  # type: ignore[attr-defined]
    return f'type="{kind}" size="{" ".join(map(str, sizes))}" friction="{FRICTION} 0 5e-5" condim="6"'


def _model(items: list[RigidObject], step: float, ratio: int) -> Any:
    import mujoco

    text = ""
    for item in items:
        x, y, z, *turn, w = item.pose.vector.tolist()
        at = f'pos="{x} {y} {z}" quat="{w} {" ".join(map(str, turn))}"'
        free = "" if item.fixed else "<freejoint/>"
        mass = "" if item.fixed else f'mass="{item.mass}"'
        text += f"<body {at}>{free}<geom {_geom(item)} {mass}/></body>"
    option = f'<option timestep="{step}" cone="elliptic" impratio="{ratio}" integrator="implicitfast"/>'
    default = '<default><geom solref="0.004 1" solimp="0.95 0.99 0.0005"/></default>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{option}{default}<worldbody>{text}</worldbody></mujoco>")


def _after(items: list[RigidObject], seconds: float, step: float, ratio: int) -> list[RigidObject]:
    """Where bodies are after a time."""
    import mujoco

    model = _model(items, step, ratio)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=round(seconds / step))
    places = iter(data.qpos.reshape(-1, 7))
    moved = []
    for item in items:
        if not item.fixed:
            x, y, z, w, *turn = next(places).tolist()
            item = replace(item, pose=Pose.from_vector(np.array([x, y, z, *turn, w])))
        moved.append(item)
    return moved


def judged(items: list[RigidObject]) -> str:
    """What Poise and MuJoCo say of bodies as they lie."""
    try:
        stands = Analysis.of(Assembly(tuple(items), np.array([0, 0, -9.81]), FRICTION)).stability().stable
    except PoiseError as error:
        return f"refused ({error.code.name})"
    later = _after(items, _LONGER, 0.0005, 100)
    far = max(np.linalg.norm(a.pose.translation - b.pose.translation) for a, b in zip(items, later, strict=True))
    return f"{'stands' if stands else 'falls'}, {'moves' if far > MOVES else 'rests'} in MuJoCo"


def main() -> None:
    """Drop, ask and count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=5, help="of each size and kind")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    for kind, share in (("boxes", 0.0), ("boxes and cylinders", 0.5)):
        counts: Counter[str] = Counter()
        for size in SIZES:
            for number in range(given.scenes):
                rng = np.random.default_rng([given.seed, size, number])
                items = _after([*walls(), *bodies(size, share, rng)], _SECONDS, 0.001, 10)
                inside = [item for item in items if item.fixed or np.abs(item.pose.translation[:2]).max() < BIN / 2]
                counts[judged(inside)] += 1
        print(f"{kind}: {', '.join(f'{count} {what}' for what, count in sorted(counts.items()))}", flush=True)


if __name__ == "__main__":
    main()
