"""A scene on a base that drives, simulated in MuJoCo, with one thing that is not as the scene file declares.

It shares no code with `poise.mismatch.carried`: MuJoCo moves the objects in the frame of the base, whose acceleration
is a force on all masses. In the world `PLAIN` odometry is at 50 Hz, and a camera sees the objects at 30 Hz with white
noise of 0.5 to 1.5 mm. `ROUGH` breaks what the tool takes for granted.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from poise.recording import PoseStream, RecordingWriter, encode_stream

CAUSES = (
    "none", "none", "friction", "friction", "com_height", "com_height", "tray_tilt", "push", "object_pose", "liquid",
)  # fmt: skip
GRAVITY, STEP, SECONDS = 9.81, 5e-4, 12.0
Snapshot = tuple[float, np.ndarray, np.ndarray]
"""s, (B, 3) m, (B, 3, 3) of all objects, in the scene."""


@dataclass(frozen=True)
class World:
    """How a case is recorded, and what no scene file says.

    Args:
        odometry, camera: Hz.
        late: s by which the stamps of the camera are late.
        tails: degrees of freedom of the noise (Student's t); 0: normal.
        drift: m, one sigma of a slow error of the camera.
        rounded: m of the edges of all objects.
    """

    odometry: float = 50.0
    camera: float = 30.0
    late: float = 0.0
    tails: float = 0.0
    drift: float = 0.0
    rounded: float = 0.0


PLAIN = World()
ROUGH = World(odometry=30.0, camera=20.0, late=0.02, tails=3.0, drift=3e-4, rounded=1.5e-3)


@dataclass(frozen=True)
class Body:
    """A box or a can: half sizes or (radius, half height), m; where it stands; mass, friction below it, com raised."""

    name: str
    kind: str
    size: tuple[float, ...]
    place: tuple[float, float, float]
    mass: float
    friction: float
    raised: float = 0.0
    liquid: float = 0.0
    """Hz; 0: solid."""


@dataclass(frozen=True)
class Case:
    """What is sealed.

    Args:
        seed: of everything.
        cause: its name, one of `CAUSES`.
        subject: the object that it is about; empty for the base.
        value: true friction, m that the centre of mass is higher, rad, N s, m, or Hz.
        declared, true: the bodies.
        tilt: rotation of the base against what tf says.
        push: s and N s, 0 without.
    """

    seed: int
    cause: str
    subject: str
    value: float
    declared: tuple[Body, ...]
    true: tuple[Body, ...]
    tilt: tuple[float, float] = (0.0, 0.0)
    push: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Seen:
    """What moved first, how, and when, s; empty when nothing did."""

    name: str = ""
    mode: str = ""
    time: float = float("inf")


def draw(seed: int) -> Case:
    """A random scene of one to three objects side by side, and what is wrong with it."""
    rng = np.random.default_rng([seed, 4177])
    cause = CAUSES[seed % len(CAUSES)]
    bodies = [_body(rng, number) for number in range(rng.integers(1, 4))]
    bodies = [replace(b, place=(0.25 * i - 0.2, rng.uniform(-0.1, 0.1), b.place[2])) for i, b in enumerate(bodies)]
    subject = int(rng.integers(len(bodies)))
    chosen, value = bodies[subject], 0.0
    changed: dict[str, Any] = {}
    tilt, push = (0.0, 0.0), (0.0, 0.0)
    if cause == "friction":
        value = chosen.friction * float(rng.choice([rng.uniform(0.35, 0.7), rng.uniform(1.5, 2.2)]))
        changed = {"friction": value}
    elif cause == "com_height":
        chosen = _tall(chosen)
        value = float(rng.uniform(0.3, 0.6)) * chosen.size[-1]
        changed = {"raised": value}
    elif cause == "liquid":
        chosen = _tall(chosen)
        value = float(rng.uniform(0.8, 2.0))
        changed = {"liquid": value}
    elif cause == "tray_tilt":
        value, way = np.deg2rad(rng.uniform(4, 8)), rng.uniform(-np.pi, np.pi)
        tilt = float(value * np.cos(way)), float(value * np.sin(way))
    elif cause == "push":
        value = float(rng.uniform(0.6, 1.2)) * chosen.mass
        push = float(rng.uniform(2.0, SECONDS - 2)), value
    elif cause == "object_pose":
        value = float(rng.uniform(0.02, 0.05))
        changed = {"place": (chosen.place[0], chosen.place[1] + value * rng.choice([-1, 1]), chosen.place[2])}
    declared = tuple(chosen if i == subject else b for i, b in enumerate(bodies))
    true = tuple(replace(b, **changed) if i == subject else b for i, b in enumerate(declared))
    name = "" if cause in ("none", "tray_tilt") else chosen.name
    return Case(seed, cause, name, value, declared, true, tilt, push)


def _body(rng: np.random.Generator, number: int) -> Body:
    if rng.random() < 0.5:
        size = (*rng.uniform(0.025, 0.06, 2), rng.uniform(0.03, 0.13))
        return Body(f"box_{number}", "box", size, (0, 0, size[2]), rng.uniform(0.3, 2), rng.uniform(0.3, 0.7))
    size = (rng.uniform(0.025, 0.05), rng.uniform(0.04, 0.12))
    return Body(f"can_{number}", "cylinder", size, (0, 0, size[1]), rng.uniform(0.3, 2), rng.uniform(0.3, 0.7))


def _tall(body: Body) -> Body:
    """So tall that it tips before it slips."""
    half = min(body.size[:-1]) / (0.6 * body.friction)
    return replace(body, size=(*body.size[:-1], half), place=(*body.place[:2], half))


def scene_of(case: Case) -> dict[str, Any]:
    """The declared scene, as a scene file's content."""
    objects: list[dict[str, Any]] = [
        {"id": "tray", "fixed": True, "box": [1.2, 0.8, 0.02], "pose": [0, 0, -0.01, 0, 0, 0, 1]}
    ]
    for body in case.declared:
        size = [2 * s for s in body.size] if body.kind == "box" else [body.size[0], 2 * body.size[1]]
        shape = {body.kind: size}
        objects.append({"id": body.name, **shape, "pose": [*body.place, 0, 0, 0, 1], "mass": body.mass})
    pairs = [{"objects": ["tray", body.name], "coefficient": body.friction} for body in case.declared]
    content = {"gravity": [0, 0, -GRAVITY], "friction": 0.5, "objects": objects, "friction_pairs": pairs}
    plain: dict[str, Any] = _plain(content)
    return plain


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    return round(float(value), 5) if isinstance(value, float) else value


def drive(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """(T,) s and (T, 2) m/s2 of the base: starts and stops that grow stronger, in changing directions."""
    rng = np.random.default_rng([case.seed, 9])
    times = np.arange(0.0, SECONDS, STEP)
    jerk = np.zeros((len(times), 2))
    begin = 1.0
    for strength in np.linspace(0.8, rng.uniform(2.5, 5.5), 6):
        way = rng.uniform(-np.pi, np.pi)
        heading = np.array([np.cos(way), np.sin(way)])
        ramp, hold = rng.uniform(0.15, 0.3), rng.uniform(0.1, 0.4)
        back = begin + 3 * ramp + 2 * hold + 0.2
        starts = begin, begin + ramp + hold, begin + 2 * ramp + hold + 0.2, back
        for sign, start in zip((1, -1, -1, 1), starts, strict=True):
            jerk[(times >= start) & (times < start + ramp)] += sign * strength / ramp * heading
        begin = back + ramp + rng.uniform(0.1, 0.3)
    return times, np.cumsum(jerk, axis=0) * STEP


def _model(case: Case, world: World) -> Any:
    spec = mujoco.MjSpec()
    spec.option.timestep = STEP
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 50
    spec.option.noslip_iterations = 5
    common = {"condim": 3, "solref": [0.004, 1.0], "solimp": [0.95, 0.99, 0.0005, 0.5, 2]}
    spec.worldbody.add_geom(
        name="tray", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.6, 0.4, 0.01], pos=[0, 0, -0.01], **common
    )
    for body in case.true:
        added = spec.worldbody.add_body(name=body.name, pos=body.place)
        added.add_freejoint()
        kind = mujoco.mjtGeom.mjGEOM_BOX if body.kind == "box" else mujoco.mjtGeom.mjGEOM_CYLINDER
        narrow = [world.rounded] * (len(body.size) - 1)  # a body stands on what its edges leave
        size = [*np.subtract(body.size[:-1], narrow), body.size[-1], 0.0][:3]
        solid = body.mass * (0.5 if body.liquid else 1.0)
        added.explicitinertial = True
        added.mass, added.ipos = solid, [0, 0, body.raised]
        width = body.size[0]
        added.inertia = [solid * (width**2 + body.size[-1] ** 2) / 3] * 2 + [solid * width**2 / 2]
        added.add_geom(name=body.name, type=kind, size=size, friction=[1, 0, 0], **common)
        spec.add_pair(
            name=body.name, geomname1="tray", geomname2=body.name, friction=[body.friction] * 2 + [0, 0, 0],
            condim=3, solref=common["solref"], solimp=common["solimp"],
        )  # fmt: skip
        if body.liquid:
            mass = body.mass / 2
            inner = added.add_body(name=f"{body.name}_liquid")
            stiff = mass * (2 * np.pi * body.liquid) ** 2
            for axis in ([1, 0, 0], [0, 1, 0]):
                inner.add_joint(
                    type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis, stiffness=stiff, damping=0.06 * np.sqrt(stiff * mass)
                )
            inner.explicitinertial = True
            inner.mass, inner.inertia = mass, [1e-4 * mass] * 3
    return spec.compile()


def simulate(case: Case, world: World = PLAIN) -> tuple[Seen, list[Snapshot]]:
    """What happens, every 10 ms: what moves first, and where all objects are."""
    times, acceleration = drive(case)
    model = _model(case, world)
    data = mujoco.MjData(model)
    tilt = Rotation.from_euler("xy", case.tilt).as_matrix()
    ids = [model.body(body.name).id for body in case.true]
    poses: list[Snapshot] = []
    for step, (time, drawn) in enumerate(zip(times, acceleration, strict=True)):
        model.opt.gravity = tilt.T @ [0, 0, -GRAVITY] - [*drawn, 0.0]
        data.xfrc_applied[:] = 0
        if case.push[1] and case.push[0] <= time < case.push[0] + 0.1:
            data.xfrc_applied[model.body(case.subject).id, 1] = case.push[1] / 0.1
        mujoco.mj_step(model, data)
        if step % 20 == 0:
            poses.append((float(time), data.xpos[ids].copy(), data.xmat[ids].reshape(-1, 3, 3).copy()))
    return _first(case, poses), poses


def as_declared(case: Case) -> Case:
    """The same drive of the scene that the scene file declares."""
    return replace(case, true=case.declared, tilt=(0.0, 0.0), push=(0.0, 0.0))


def _first(case: Case, poses: list[Snapshot]) -> Seen:
    """The object that begins to move first, of those whose foot moves by 2 mm or that lean by 1.5 degrees, and when.

    It begins after the last time before that when it had moved by less than 0.3 mm and leaned by less than 0.2 degrees.
    """
    settled = next(row for row, (time, _, _) in enumerate(poses) if time >= 0.5)
    low = np.array([body.size[-1] for body in case.true])[:, None]
    feet = np.array([(at - low * turn[:, :, 2])[:, :2] for _, at, turn in poses])  # what tips stays on its foot
    moved = np.linalg.norm(feet - feet[settled], axis=2)
    leaned = np.array([np.arccos(np.clip(turn[:, 2, 2], -1, 1)) for _, _, turn in poses])
    leaned = np.abs(leaned - leaned[settled])
    hit = ((moved > 2e-3) | (leaned > np.deg2rad(1.5))) & (np.arange(len(poses)) > settled)[:, None]
    begun: list[tuple[int, int, int]] = []
    for body in np.flatnonzero(hit.any(axis=0)).tolist():
        row = int(np.argmax(hit[:, body]))
        still = (moved[:row, body] < 3e-4) & (leaned[:row, body] < np.deg2rad(0.2))
        begun.append((int(np.flatnonzero(still)[-1]) if still.any() else settled, row, body))
    if not begun:
        return Seen()
    began, row, body = min(begun)
    tips = moved[row, body] <= 2e-3
    return Seen(case.true[body].name, "tip" if tips else "slip", poses[began][0])


def write(case: Case, path: Path, poses: list[Snapshot], world: World = PLAIN) -> None:
    """The recording: odometry of the tray, and what a camera sees of the objects, as tf."""
    times, acceleration = drive(case)
    rng = np.random.default_rng([case.seed, 21])
    speed = np.cumsum(acceleration, axis=0) * STEP
    place = np.cumsum(speed, axis=0) * STEP
    rows = slice(0, None, round(1 / (world.odometry * STEP)))
    base = np.column_stack([place[rows], np.zeros(len(place[rows]))])
    base[:, :2] += rng.normal(scale=rng.uniform(1e-5, 1e-4), size=base[:, :2].shape)
    stamps = 10**18 + np.round(times[rows] * 1e9).astype(np.int64)
    streams = [PoseStream(stamps, np.tile(np.eye(3), (len(base), 1, 1)), base, "odom", "tray")]
    noise = rng.uniform(5e-4, 1.5e-3)
    when = np.array([time for time, _, _ in poses])
    shots = np.unique(np.round(np.arange(0.0, SECONDS - 0.05, 1 / world.camera) / 0.01).astype(int))
    for number, body in enumerate(case.true):
        shifts = np.array([poses[i][1][number] for i in shots]) + noise * _error(rng, (len(shots), 3), world)
        if world.drift:
            shifts += world.drift * np.sin(2 * np.pi * (0.3 * when[shots, None] + rng.uniform(size=3)))
        shifts[:, 2] += 0.01  # the tray's frame is in its middle
        jitter = Rotation.from_rotvec(rng.normal(scale=np.deg2rad(0.2), size=(len(shots), 3))).as_matrix()
        turns = np.array([poses[i][2][number] for i in shots]) @ jitter
        seen = 10**18 + np.round((when[shots] + world.late) * 1e9).astype(np.int64)
        streams.append(PoseStream(seen, turns, shifts, "tray", body.name))
    messages = [(stamp, bytes_) for stream in streams for stamp, bytes_ in encode_stream("tf", stream)]
    with RecordingWriter(path) as writer:
        writer.add_topic("tf", "tf2_msgs/msg/TFMessage")
        for stamp, content in sorted(messages, key=lambda one: one[0]):
            writer.write("tf", stamp, content)


def _error(rng: np.random.Generator, shape: tuple[int, int], world: World) -> np.ndarray:
    """Noise of one sigma."""
    if not world.tails:
        return rng.normal(size=shape)
    return rng.standard_t(world.tails, size=shape) / np.sqrt(world.tails / (world.tails - 2))
