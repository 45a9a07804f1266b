"""How often the truth lies in 95 % intervals: `python -m benchmarks.weighing.coverage --seed-set dev --objects 100`.

Random tools of known parts and materials are weighed on recordings of the second generator (`still_air`), in each way
of moving. What is known of the shape differs: nothing, its bodies, its outer surface, or a cloud.
"""

import argparse
import json
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.spatial.transform import Rotation

from benchmarks.foreign import bag
from benchmarks.foreign.load import Body
from benchmarks.random_objects import Composite, make_composite
from benchmarks.weighing.case import WAYS
from benchmarks.weighing.still_air import fly
from poise.errors import InputError, NoAnswerError
from poise.inertia import InertialEstimate, InertialParameters, identify
from poise.inertia.bayes import SHAPE_ACCURACY
from poise.inertia.model import ObjectShape, Parts, load_object
from poise.recording import Recording, open_recording
from poise.shape.mesh_repair import repair
from poise.types import Array

SEEDS = {"dev": 0, "final": 174_000}
"""The first of the objects' seeds."""
SECONDS = (5.0, 9.0)
INNER = 40_000
"""Points in each piece: the truth of an object is good to 0.2 %."""
CLOUD_NOISE, CAMERA_NOISE = 3e-4, 1e-3
"""m, of a good scan and of a depth camera, at `POINTS` of the surface."""
POINTS = 2000
LIGHT = (0.009, 0.035)
"""kg."""
HALF = 1.959964
"""Standard deviations: half the width of a 95 % interval."""
GROUPS = {"mass": slice(0, 1), "com": slice(1, 4), "inertia": slice(4, 10)}

Knowledge = Callable[["Held", np.random.Generator], ObjectShape | None]


@dataclass(frozen=True, eq=False)
class Held:
    """An object as the sensor holds it.

    Args:
        made: the object, in its own frame, in m.
        pose: its frame in that of the sensor: (3, 3) and (3,) m.
        truth: its parameters in the sensor frame.
    """

    made: Composite
    pose: tuple[Array, Array]
    truth: InertialParameters

    @property
    def body(self) -> Body:
        """For the generator."""
        return Body(self.truth.mass, self.truth.com, self.truth.inertia)

    def placed(self, shape: ObjectShape) -> ObjectShape:
        """What is known of the shape, in the sensor frame."""
        turn, shift = self.pose
        return shape.placed(shift, Rotation.from_matrix(turn).as_quat())


def hold(seed: int, light: bool) -> Held:
    """Draw an object and how it is held: 5 to 15 cm from the sensor."""
    made = make_composite(seed, inner=INNER)
    rng = np.random.default_rng([seed, int(light), 77])
    if light:
        mass = float(made.densities @ made.parts.volumes)
        made = scaled(made, (float(np.exp(rng.uniform(*np.log(LIGHT)))) / mass) ** (1 / 3))
    turn = Rotation.random(random_state=rng).as_matrix()
    shift = rng.uniform([-0.03, -0.03, 0.05], [0.03, 0.03, 0.15])
    phi = made.parts.in_frame(turn, shift).unit_phi @ (made.densities * made.parts.volumes)
    return Held(made, (turn, shift), InertialParameters.from_phi(phi))


def scaled(made: Composite, factor: float) -> Composite:
    """The same object of another size."""
    by_row = np.repeat([1.0, factor, factor**2], [1, 3, 6])
    old = made.parts
    parts = Parts(by_row[:, None] * old.unit_phi, factor**3 * old.volumes, factor * old.points)
    pieces = tuple(piece.scaled(factor) for piece in made.pieces)
    return replace(made, points=factor * made.points, dense=factor * made.dense, parts=parts, pieces=pieces)


# -- what is known of the shape ---------------------------------------------------------------------------------------


def nothing(held: Held, rng: np.random.Generator) -> ObjectShape | None:
    return None


def bodies(held: Held, rng: np.random.Generator) -> ObjectShape:
    """A model from CAD with a body for each part."""
    return held.placed(ObjectShape(held.made.parts, SHAPE_ACCURACY, "bodies"))


def body_of_two(held: Held, rng: np.random.Generator) -> ObjectShape:
    """A model from CAD in which the first two of three parts or more, usually of two materials, are one body."""
    parts, volumes = held.made.parts, held.made.parts.volumes
    label = np.maximum(np.arange(len(parts)) - 1, 0)
    share = np.array([np.where(label == k, volumes, 0.0) for k in range(label.max() + 1)])
    joined = Parts(parts.unit_phi @ (share / share.sum(axis=1, keepdims=True)).T, share.sum(axis=1), parts.points)
    return held.placed(ObjectShape(joined, SHAPE_ACCURACY, "bodies, the first of two materials"))


def surface(held: Held, rng: np.random.Generator) -> ObjectShape:
    """A mesh of the outer surface, as `poise identify --object` reads it."""
    triangles = np.concatenate([piece.triangles_outwards for piece in held.made.pieces])
    points, faces, _ = repair(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), held.made.name)
    lines = [f"v {x} {y} {z}" for x, y, z in points.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return _read(held, "mesh.obj", "\n".join(lines))


def cloud(held: Held, rng: np.random.Generator) -> ObjectShape:
    """A good scan in colour."""
    made = held.made
    points = made.points + rng.normal(scale=CLOUD_NOISE, size=made.points.shape)
    return _read(held, "cloud.csv", _table(np.hstack([points, made.colours]), "x,y,z,r,g,b"))


def camera_cloud(held: Held, rng: np.random.Generator) -> ObjectShape:
    """What a depth camera sees, without colours."""
    points = held.made.surface(rng, POINTS)
    return _read(held, "cloud.csv", _table(points + rng.normal(scale=CAMERA_NOISE, size=points.shape), "x,y,z"))


def _table(rows: Array, names: str) -> str:
    return "\n".join([names, *(",".join(f"{value:.7g}" for value in row) for row in rows)])


def _read(held: Held, name: str, text: str) -> ObjectShape:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_text(text, encoding="utf-8")
        return held.placed(load_object(path))


@dataclass(frozen=True)
class Kind:
    """A row of the table: objects of some parts or more, what is known of their shape, and the method."""

    name: str
    known: Knowledge
    light: bool = False
    method: str = "poise"
    least_parts: int = 1


KINDS = (
    Kind("no shape", nothing),
    Kind("no shape, ols", nothing, method="ols"),
    Kind("no shape, static", nothing, method="static"),
    Kind("bodies", bodies),
    Kind("bodies, one of two materials", body_of_two, least_parts=3),
    Kind("outer surface", surface),
    Kind("scan in colour", cloud),
    Kind("depth camera", camera_cloud),
    Kind("light, no shape", nothing, light=True),
    Kind("light, no shape, ols", nothing, light=True, method="ols"),
    Kind("light, bodies", bodies, light=True),
    Kind("light, scan in colour", cloud, light=True),
)


# -- measuring --------------------------------------------------------------------------------------------------------


def errors(found: InertialEstimate, truth: InertialParameters) -> Array:
    """(10,) of mass, centre of mass and inertia about it, in published standard deviations; NaN where none is given."""
    upper = np.triu_indices(3)
    step = np.concatenate(
        [
            [found.parameters.mass - truth.mass],
            found.parameters.com - truth.com,
            (found.parameters.inertia - truth.inertia)[upper],
        ]
    )
    spread = np.concatenate([[found.mass_std], found.com_std, found.inertia_std])
    return np.where(spread > 0, step / np.where(spread > 0, spread, 1.0), np.nan)


def answers(first: int, count: int, kinds: Sequence[Kind]) -> Iterator[dict[str, object]]:
    """One for each object, kind and way of moving: errors in sigmas, or why there is no number."""
    for seed in track(range(first, first + count), description="objects"):
        for light in sorted({kind.light for kind in kinds}):
            held = hold(seed, light)
            way = list(WAYS)[seed % len(WAYS)]
            with tempfile.TemporaryDirectory() as folder:
                rng = np.random.default_rng([seed, int(light), 78])
                flight = fly(held.body, float(rng.uniform(*SECONDS)), way, rng)
                bag.save(flight.messages(flight.wrench), path := Path(folder) / "flight.mcap")
                recording = open_recording(path)
                for kind in kinds:
                    if kind.light == light and len(held.made.parts) >= kind.least_parts:
                        row = {"kind": kind.name, "object": held.made.name, "way": way}
                        yield row | _answer(kind, held, recording, np.random.default_rng([seed, int(light), 79]))


def _answer(kind: Kind, held: Held, recording: Recording, rng: np.random.Generator) -> dict[str, object]:
    try:
        shape = kind.known(held, rng)
        given = {} if shape is None else {"parts": shape.parts, "shape_accuracy": shape.accuracy}
        found = identify(recording, method=kind.method, keep_history=False, **given).estimate  # type: ignore[arg-type]
    except (InputError, NoAnswerError) as error:
        return {"failure": str(error)}
    relative = [*found.inertia_std / np.trace(held.truth.inertia), found.mass_std / held.truth.mass]
    codes = [finding.code.name for finding in found.findings]
    return {"errors": errors(found, held.truth).tolist(), "relative": relative, "findings": codes}


def table(rows: Sequence[dict[str, object]]) -> Table:
    """Shares inside, and by how much an interval has to be wider to hold 95 % (below 1: it could be narrower)."""
    made = Table(*("known of the shape", "answers", "with a finding"), *(f"{name}: inside, width" for name in GROUPS))
    by_kind: dict[str, list[dict[str, object]]] = defaultdict(list)
    for row in rows:
        by_kind[str(row["kind"])].append(row)
    for name, group in by_kind.items():
        given = [row for row in group if "errors" in row]
        sigmas = np.abs(np.array([row["errors"] for row in given], dtype=np.float64).reshape(-1, 10))
        cells = [_cell(sigmas[:, which]) for which in GROUPS.values()]
        found = sum(bool(row["findings"]) for row in given)
        made.add_row(name, f"{len(given)} of {len(group)}", str(found), *cells)
    return made


def _cell(sigmas: Array) -> str:
    known = sigmas[np.isfinite(sigmas)]
    if not len(known):
        return "-"
    columns = [column[np.isfinite(column)] for column in sigmas.T]
    by_entry = [f"{np.mean(column < HALF):.2f}" for column in columns if len(column)]
    entries = f" ({min(by_entry)} to {max(by_entry)})" if len(by_entry) > 1 else ""
    return f"{np.mean(known < HALF):.3f}{entries}, {np.quantile(known, 0.95) / HALF:.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed-set", choices=sorted(SEEDS), required=True)
    parser.add_argument("--objects", type=int, default=100)
    parser.add_argument("--kinds", nargs="*", default=[kind.name for kind in KINDS], help="names; default: all")
    parser.add_argument("--out", type=Path, help="a file for all answers, JSON lines")
    arguments = parser.parse_args()
    kinds = [kind for kind in KINDS if kind.name in arguments.kinds]
    rows = []
    for row in answers(SEEDS[arguments.seed_set], arguments.objects, kinds):
        rows.append(row)
        if arguments.out is not None:
            with arguments.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
    Console(width=150).print(table(rows))


if __name__ == "__main__":
    main()
