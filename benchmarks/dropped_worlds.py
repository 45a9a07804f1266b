"""Worlds of MuJoCo in which mixed bodies were dropped, read as MJCF: whether what rests there stands.

`python -m benchmarks.dropped_worlds --scenes 10 --seed 1`: totes and trays with boxes, cylinders, balls, capsules,
cones, brackets and mugs of many geoms, and logs between stakes. Masses and frictions are random.
"""

import argparse
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from poise.assembly import Analysis
from poise.errors import PoiseError
from poise.geometry import unit
from poise.types import Array
from poise.worlds import read_world

MOVES, CREEPS = 5e-3, 1e-3
"""m in `_LONGER` s."""
STILL = 1e-3
"""m/s, of what came to rest."""
_SECONDS, _LONGER, _ROLLING = 10.0, 3.0, 0.002


class World:
    """MJCF of fixed boxes and free bodies."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self._meshes: list[str] = []
        self._fixed: list[str] = []
        self._free: list[tuple[str, Array]] = []

    def geom(self, kind: str, size: Any, friction: float, mass: float, place: Any = (0, 0, 0), turn: float = 0) -> str:
        """A geom, turned about z, with rolling resistance where it is round."""
        radius = float(size[0]) if kind in ("sphere", "cylinder", "capsule") else 0.0
        shape = f'mesh="{size}"' if kind == "mesh" else f'size="{_words(size)}"'
        mu = f"{friction} {2 / 3 * friction * _ROLLING * radius} {_ROLLING * radius}"
        quaternion = _words([np.cos(turn / 2), 0, 0, np.sin(turn / 2)])
        at = f'pos="{_words(place)}" quat="{quaternion}"'
        return f'<geom type="{kind}" {shape} {at} friction="{mu}" mass="{mass}"/>'

    def fix(self, size: Any, place: Any) -> None:
        """Add a fixed box of half sides."""
        geom = self.geom("box", size, self.friction, 1.0)
        self._fixed.append(f'<body name="fixed{len(self._fixed)}" pos="{_words(place)}">{geom}</body>')

    @property
    def friction(self) -> float:
        """A new one."""
        return round(float(self.rng.uniform(0.3, 0.8)), 3)

    def add(self, geoms: str, place: Any, quaternion: Any) -> None:
        """Add a free body; the quaternion is w x y z."""
        self._free.append((geoms, np.concatenate([place, quaternion])))

    def body(self) -> str:
        """The geoms of a random body, 4 to 12 cm large."""
        (x, y, z), mu, rng = self.rng.uniform(0.04, 0.12, 3).tolist(), self.friction, self.rng
        mass, kind = float(rng.uniform(0.1, 1.0)), int(rng.integers(7))
        if kind == 0:
            return self.geom("box", np.array([x, y, z]) / 2, mu, mass)
        if kind < 4:
            name = ("cylinder", "sphere", "capsule")[kind - 1]
            return self.geom(name, [x / 2] if kind == 2 else [x / 3, y / 2], mu, mass)
        angles = 2 * np.pi * np.arange(24) / 24
        circle = np.stack([np.cos(angles), np.sin(angles), np.zeros(24)], axis=1)
        if kind == 4:  # a cone without its tip
            name, narrow = f"cone{len(self._meshes)}", y / 5 * circle + [0, 0, z]
            self._meshes.append(f'<mesh name="{name}" vertex="{_words(np.vstack([x / 2 * circle, narrow]))}"/>')
            return self.geom("mesh", name, mu, mass)
        if kind == 5:  # a bracket
            x, y = max(x, 0.08), max(y, 0.06)
            long = self.geom("box", [x / 2, 0.015, z / 2], mu, mass)
            return long + self.geom("box", [0.015, y / 2, z / 2], mu, mass / 2, (0.015 - x / 2, y / 2 + 0.015, 0))
        x, z, parts = max(x, 0.06) / 2, max(z, 0.06), [self.geom("cylinder", [max(x, 0.06) / 2, 0.0025], mu, 0.05)]
        for angle in angles[::2].tolist():  # a mug
            where = [(x - 0.0025) * np.cos(angle) * 0.98, (x - 0.0025) * np.sin(angle) * 0.98, z / 2]
            parts.append(self.geom("box", [0.0025, 0.26 * x, z / 2], mu, 0.02, where, angle))
        return "".join(parts)

    def text(self, places: Array | None, step: float, ratio: int) -> str:
        """MJCF with the free bodies at places (N, 7), or where they were added."""
        option = f'<option timestep="{step}" cone="elliptic" impratio="{ratio}" integrator="implicitfast"/>'
        default = '<default><geom solref="0.004 1" solimp="0.95 0.99 0.0005" condim="6"/></default>'
        bodies = "".join(
            f'<body name="b{number}" pos="{_words(at[:3])}" quat="{_words(at[3:])}"><freejoint/>{geoms}</body>'
            for number, (geoms, start) in enumerate(self._free)
            for at in [start if places is None else places[number]]
        )
        assets = f"<asset>{''.join(self._meshes)}</asset>"
        return f"<mujoco>{option}{default}{assets}<worldbody>{''.join(self._fixed)}{bodies}</worldbody></mujoco>"

    def after(self, seconds: float, places: Array | None, step: float = 0.001, ratio: int = 10) -> tuple[Array, float]:
        """(N, 7) where the free bodies are after a time, and how fast one still is, m/s."""
        import mujoco

        model = mujoco.MjModel.from_xml_string(self.text(places, step, ratio))
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=round(seconds / step))
        speeds = np.linalg.norm(np.array(data.qvel).reshape(-1, 6)[:, :3], axis=1)
        return np.array(data.qpos).reshape(-1, 7), float(speeds.max())


def _words(values: Any) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


def _walled(rng: np.random.Generator, half: float, height: float) -> World:
    world = World(rng)
    world.fix((1.5, 1.5, 0.05), (0, 0, -0.05))
    for side in (1, -1):
        world.fix((0.01, half + 0.02, height / 2), (side * (half + 0.01), 0, height / 2))
        world.fix((half, 0.01, height / 2), (0, side * (half + 0.01), height / 2))
    return world


def tote(rng: np.random.Generator) -> World:
    """4 to 15 bodies between high walls."""
    world = _walled(rng, 0.2, 0.3)
    for number in range(int(rng.integers(4, 16))):
        world.add(world.body(), (*rng.uniform(-0.1, 0.1, 2), 0.15 + 0.14 * number), unit(rng.normal(size=4)))
    return world


def tray(rng: np.random.Generator) -> World:
    """3 to 8 bodies between lips of 3 cm."""
    world = _walled(rng, 0.25, 0.03)
    for number in range(int(rng.integers(3, 9))):
        world.add(world.body(), (*rng.uniform(-0.2, 0.2, 2), 0.1 + 0.1 * number), unit(rng.normal(size=4)))
    return world


def logs(rng: np.random.Generator) -> World:
    """5 to 11 nearly parallel cylinders between stakes."""
    world = World(rng)
    world.fix((1.5, 1.5, 0.05), (0, 0, -0.05))
    for side in (1, -1):
        world.fix((0.02, 0.3, 0.3), (side * 0.22, 0, 0.3))
    for number in range(int(rng.integers(5, 12))):
        radius, length, half = *rng.uniform([0.03, 0.15], [0.05, 0.25]).tolist(), float(rng.normal()) * 0.01
        turn = np.array([np.cos(half), np.cos(half), np.sin(half), np.sin(half)]) / np.sqrt(2)
        geom = world.geom("cylinder", [radius, length], world.friction, float(rng.uniform(0.5, 3)))
        world.add(geom, (rng.uniform(-0.15, 0.15), 0, 0.1 + 0.11 * number), turn)
    return world


KINDS: dict[str, Callable[[np.random.Generator], World]] = {"tote": tote, "tray": tray, "logs": logs}


def judged(world: World, folder: Path) -> str:
    """What Poise and MuJoCo say of bodies as they lie."""
    places, speed = world.after(_SECONDS, None)
    if speed > STILL:
        return "not at rest"
    later, _ = world.after(_LONGER, places, 0.0005, 100)
    far = float(np.linalg.norm(later[:, :3] - places[:, :3], axis=1).max())
    path = folder / "world.xml"
    path.write_text(world.text(places, 0.0005, 100))
    try:
        found = Analysis.of(read_world(path)[0]).stability()
        says = "stands" if found.stable else "doubtful" if found.doubtful else "falls"
    except PoiseError as error:
        says = f"refused ({error.code.name})"
    return f"{says}, {'moves' if far > MOVES else 'creeps' if far > CREEPS else 'rests'} in MuJoCo"


def main() -> None:
    """Drop, ask and count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=5, help="of each kind")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    for place, (kind, make) in enumerate(KINDS.items()):
        counts: Counter[str] = Counter()
        with tempfile.TemporaryDirectory() as folder:
            for number in range(given.scenes):
                counts[judged(make(np.random.default_rng([given.seed, place, number])), Path(folder))] += 1
        print(f"{kind}: {', '.join(f'{count} {what}' for what, count in sorted(counts.items()))}", flush=True)


if __name__ == "__main__":
    main()
