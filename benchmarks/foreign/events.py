"""Effects that belong to a moment: masses that come or go, contacts, and a base that moves unseen."""

from typing import Any

import mujoco
import numpy as np

from benchmarks.foreign.fault import LoadFault, direction, window
from benchmarks.foreign.load import Body
from benchmarks.foreign.world import Scene, Track, World, give


class MassChange(LoadFault):
    """A point mass in the load whose mass changes during the run; the tree's masses follow."""

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        extra = tree.body(scene.robot.frame).add_body(name="extra", pos=self.spot())
        give(extra, Body(1e-6, np.zeros(3), 1e-10 * np.eye(3)))

    def put(self, world: World, mass: float) -> None:
        """Give the point mass its mass, kg, at this moment."""
        body = world.model.body("extra").id
        change = max(mass, 1e-6) - world.model.body_mass[body]
        world.model.body_mass[body] += change
        while body:
            world.model.body_subtreemass[body] += change
            body = int(world.model.body_parentid[body])


class MassStep(MassChange):
    """A mass that is added to the load, or falls off, at one time; size: kg."""

    name, usual = "mass_step", 0.2

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        time = float(track.seconds[-1] * rng.uniform(0.25, 0.6))
        return {"time": time, "sign": float(rng.choice([-1, 1])), "place": list(scene.load.place)}

    @property
    def freed(self) -> float:
        return self.size if self.truth["sign"] < 0 else 0.0

    def limit(self, scene: Scene) -> float:
        return scene.load.part if self.truth["sign"] < 0 else 1.5

    def push(self, world: World) -> None:
        later = world.time >= self.truth["time"]
        world.active = later
        self.put(world, self.size if later == (self.truth["sign"] > 0) else 0.0)

    def parameters(self) -> dict[str, float]:
        return {"mass": self.truth["sign"] * self.size, "time": self.truth["time"]}


class MassLeak(MassChange):
    """The load loses mass at a constant rate; size: kg lost at the end."""

    name, usual = "mass_leak", 0.2

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        end = float(track.seconds[-1])
        return {"start": end * float(rng.uniform(0.05, 0.3)), "end": end, "place": list(scene.load.place)}

    @property
    def freed(self) -> float:
        return self.size

    def limit(self, scene: Scene) -> float:
        return scene.load.part

    def push(self, world: World) -> None:
        start, end = self.truth["start"], self.truth["end"]
        share = float(np.clip((world.time - start) / (end - start), 0, 1))
        world.active = share > 0
        self.put(world, self.size * (1 - share))

    def parameters(self) -> dict[str, float]:
        return {"rate": self.size / (self.truth["end"] - self.truth["start"]), "start": self.truth["start"]}


class Contact(LoadFault):
    """The tip of the tool presses on a soft plate once (Hunt and Crossley's contact, dry friction); size: N."""

    name, usual, largest = "contact", 9.0, 80.0

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        path = track.place + track.turn @ scene.load.tip
        best: tuple[float, dict[str, Any]] = (np.inf, {})
        for _ in range(60):
            normal, depth = direction(rng), float(rng.uniform(0.004, 0.02))
            along = path @ normal
            length = float(np.mean(along > along.max() - depth) * track.seconds[-1])
            early = bool(np.argmax(along) < 1500)
            badness = abs(np.log(max(length, 1e-3) / 1.2)) + 10 * early
            if badness < best[0]:
                plate = {"normal": list(normal), "level": float(along.max() - depth), "depth": depth}
                best = (badness, plate | {"friction": float(rng.uniform(0.1, 0.5)), "place": list(scene.load.tip)})
        return best[1]

    def push(self, world: World) -> None:
        at, velocity = world.point(self.spot())
        normal = np.array(self.truth["normal"])
        depth = float(at @ normal) - self.truth["level"]
        if depth <= 0 or world.time < 1.0:
            return
        world.active = True
        stiffness = self.size / self.truth["depth"] ** 1.5
        pressure = max(stiffness * depth**1.5 * (1 + 1.5 * 0.3 * float(velocity @ normal)), 0.0)
        level = velocity - (velocity @ normal) * normal
        slip = level / max(float(np.linalg.norm(level)), 0.005)
        world.pull(-pressure * (normal + self.truth["friction"] * slip), self.spot())


class BaseMotion(LoadFault):
    """What the robot stands on is pushed aside and comes back, unseen (a moving frame: gravity less its acceleration);
    size: m/s2, the peak."""

    name, usual, largest = "base_motion", 0.5, 4.0

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        along = direction(rng, 2)
        return {"along": [*along, 0.0], "window": window(track, 1.2, 2.5, rng)}

    def push(self, world: World) -> None:
        start, end = self.truth["window"]
        if start < world.time < end:
            world.active = True
            phase = 2 * np.pi * (world.time - start) / (end - start)
            # Second derivative of (1 - cos)^2: it begins and ends at rest, at the place where it began.
            world.model.opt.gravity -= self.size / 4 * (2 * np.cos(phase) - 2 * np.cos(2 * phase)) * self._along()

    def _along(self) -> Any:
        return np.array(self.truth["along"])

    def parameters(self) -> dict[str, float]:
        return {"peak_acceleration": self.size}


class ExternalVibration(LoadFault):
    """A machine nearby shakes what the robot stands on for a while; size: m/s2."""

    name, usual, largest = "external_vibration", 0.4, 12.0

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        frequency = float(rng.uniform(5, 20))
        return {"along": list(direction(rng)), "frequency": frequency, "window": window(track, 3.0, 8.0, rng)}

    def push(self, world: World) -> None:
        start, end = self.truth["window"]
        if start < world.time < end:
            world.active = True
            shape = min(1.0, (world.time - start) / 0.3, (end - world.time) / 0.3)
            wave = np.sin(2 * np.pi * self.truth["frequency"] * (world.time - start))
            world.model.opt.gravity -= self.size * shape * wave * np.array(self.truth["along"])

    def parameters(self) -> dict[str, float]:
        return {"amplitude": self.size, "frequency": self.truth["frequency"]}


EVENTS: tuple[type[LoadFault], ...] = (MassStep, MassLeak, Contact, BaseMotion, ExternalVibration)
