"""The simulated world: MuJoCo integrates a robot under a controller, with what an effect adds to it."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.foreign.load import Body, Load
from benchmarks.foreign.motions import STEP, Reference
from benchmarks.foreign.robots import BASE_JOINTS, Array, Robot, spec

GRAVITY = 9.80665
DOWN = np.array([0.0, 0.0, -GRAVITY])
HUGE = 1e5
"""N m or N, of a motor: more than this means that the integration diverges."""
SETTLING = 1.0
"""s at the first point of the reference before the recording begins."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What is simulated before any effect.

    Args:
        robot: which one. mobile: with the three joints of its base.
        load: as it truly is.
        arm: reference of the joints in the recording. base: of the base; None when it is fixed.
        link_gain: factor on the mass of each link.
        tilt: (3,) m/s2 added to gravity in the axes of the base, as a floor that is not level does.
        stiffness: rad/s, natural frequency of the joint controllers.
    """

    robot: Robot
    load: Load
    arm: Reference
    base: Reference | None = None
    link_gain: dict[str, float] = field(default_factory=dict)
    tilt: Array = field(default_factory=lambda: np.zeros(3))
    stiffness: float = 40.0

    @property
    def steps(self) -> int:
        return len(self.arm[0])


@dataclass(frozen=True, eq=False)
class Track:
    """What happened, at each step of 1 ms.

    Args:
        seconds: (N,). position, velocity: (N, J) of the joints in the recording, as encoders would see them.
        effort: (N, J) N m or N, of the motors. base: (N, 3) x, y, yaw. base_velocity: (N, 3).
        wrench: (N, 6) N and N m, what the load exerts on the sensor, at its frame (MuJoCo's sensors read the reaction).
        active: (N,) the effect acts.
        place: (N, 3) m and turn: (N, 3, 3), pose of the sensor's frame in the world.
    """

    seconds: Array
    position: Array
    velocity: Array
    effort: Array
    base: Array
    base_velocity: Array
    wrench: Array
    active: Array
    place: Array
    turn: Array


class UnstableError(RuntimeError):
    """The integration diverges."""


class World:
    """MuJoCo's model and state, with what effects need of them.

    Args:
        scene: robot, load and motion.
        faults: effects that change the model or push during the run.
    """

    def __init__(self, scene: Scene, faults: Sequence["Mechanism"] = ()) -> None:
        self.scene, self.faults = scene, faults
        tree = spec(scene.robot, scene.base is not None, scene.link_gain)
        frame = tree.body(scene.robot.frame)
        frame.add_site(name="sensor", pos=[0, 0, 0])
        load = scene.load
        for fault in faults:
            load = fault.reload(load)
        freed = min(sum(fault.freed for fault in faults), load.part)
        give(frame.add_body(name="load"), load.without(freed))
        for fault in faults:
            fault.attach(tree, scene)
        for name, kind in (("force", mujoco.mjtSensor.mjSENS_FORCE), ("torque", mujoco.mjtSensor.mjSENS_TORQUE)):
            tree.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="sensor")
        tree.option.timestep = STEP
        tree.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
        tree.option.gravity = scene.tilt + DOWN
        self.model = tree.compile()
        self.data = mujoco.MjData(self.model)
        names = (*(BASE_JOINTS if scene.base is not None else ()), *scene.robot.joints)
        self.driven = np.array([self.model.joint(name).dofadr[0] for name in names])
        self.address = np.array([self.model.joint(name).qposadr[0] for name in names])
        self.recorded = slice(3 if scene.base is not None else 0, None)
        self.dofs = self.driven[self.recorded]
        """(J,) addresses of the degrees of freedom of the recording's joints."""
        self.body = self.model.body("load").id
        self.frame = self.model.body(scene.robot.frame).id
        self.active = False
        self.time = 0.0

    def run(self) -> Track:
        """Follow the reference from its first point, which is held while parts settle."""
        scene, data, model = self.scene, self.data, self.model
        reference = [np.hstack(pair) for pair in zip(scene.base, scene.arm, strict=True)] if scene.base else scene.arm
        data.qpos[self.address] = reference[0][0]
        mujoco.mj_forward(model, data)
        for fault in self.faults:
            fault.settle(self)
        mujoco.mj_forward(model, data)
        early = round(SETTLING / STEP)
        count = len(self.driven)
        rows = np.empty((scene.steps, 3 * count + 19))
        stiffness, damping, zero = scene.stiffness**2, 1.6 * scene.stiffness, np.zeros(count)
        wanted, needed = np.zeros(model.nv), np.empty(model.nv)
        places, dofs = _consecutive(self.address), _consecutive(self.driven)
        # Views: each access to a member of MuJoCo's data makes an array.
        qpos, qvel, bias, forces, external = data.qpos, data.qvel, data.qfrc_bias, data.qfrc_applied, data.xfrc_applied
        place, turn, sensed = data.xpos[self.frame], data.xmat[self.frame], data.sensordata
        gravity, down = model.opt.gravity, scene.tilt + DOWN
        for step in range(-early, scene.steps):
            at = max(step, 0)
            rate, change = (reference[1][at], reference[2][at]) if step >= 0 else (zero, zero)
            self.time = step * STEP
            q, v = qpos[places], qvel[dofs]
            row = rows[at]
            row[-12:-9], row[-9:] = place, turn
            row[:count], row[count : 2 * count] = q, v
            wanted[dofs] = change + stiffness * (reference[0][at] - q) + damping * (rate - v)
            mujoco.mj_mulM(model, data, needed, wanted)
            torque = needed[dofs] + 0.97 * bias[dofs]
            if not float(torque @ torque) < HUGE**2:  # also when it is NaN
                raise UnstableError(f"the simulation fails at {self.time:.3f} s")
            forces[:] = 0.0
            forces[dofs] = torque
            self.active = False
            if self.faults:
                external[:], gravity[:] = 0.0, down
            for fault in self.faults:
                fault.push(self)
            mujoco.mj_step(model, data)
            row[2 * count : 3 * count], row[3 * count : -13], row[-13] = torque, -sensed, float(self.active)
        return self._track(rows)

    def _track(self, rows: Array) -> Track:
        count = len(self.driven)
        q, v, tau = (rows[:, i * count : (i + 1) * count] for i in range(3))
        base = (q[:, :3], v[:, :3]) if self.scene.base is not None else (np.zeros((len(q), 3)),) * 2
        track = Track(
            seconds=np.arange(len(rows), dtype=np.float64) * STEP,
            position=q[:, self.recorded].copy(),
            velocity=v[:, self.recorded].copy(),
            effort=tau[:, self.recorded].copy(),
            base=base[0].copy(),
            base_velocity=base[1].copy(),
            wrench=rows[:, 3 * count : 3 * count + 6].copy(),
            active=rows[:, -13].copy(),
            place=rows[:, -12:-9].copy(),
            turn=rows[:, -9:].reshape(-1, 3, 3).copy(),
        )
        for fault in self.faults:
            track = fault.afterwards(track)
        return track

    def point(self, place: Array) -> tuple[Array, Array]:
        """Position and velocity in the world of a point of the sensor frame."""
        turn = self.data.xmat[self.frame].reshape(3, 3)
        arm = turn @ place
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_XBODY, self.frame, velocity, 0)
        return self.data.xpos[self.frame] + arm, velocity[3:] + cross(velocity[:3], arm)

    def pull(self, force: Array, place: Array) -> None:
        """Apply a force (world axes, N) to the load at a point of the sensor frame."""
        at = self.data.xpos[self.frame] + self.data.xmat[self.frame].reshape(3, 3) @ place
        self.data.xfrc_applied[self.body, :3] += force
        self.data.xfrc_applied[self.body, 3:] += cross(at - self.data.xipos[self.body], force)

    def inertia(self) -> Array:
        """(J,) what each joint of the recording moves at the robot's home, kg m2 or kg."""
        self.data.qpos[self.address[self.recorded]] = self.scene.robot.home
        mujoco.mj_forward(self.model, self.data)
        mass = np.empty((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, mass)
        return np.asarray(np.diag(mass)[self.dofs])

    def dof(self, joint: int) -> int:
        """Address of the degree of freedom of a joint of the recording."""
        return int(self.dofs[joint])


class Mechanism:
    """What an effect may do to the world; each hook does nothing unless an effect needs it."""

    @property
    def freed(self) -> float:
        """Kg of the load's part that the effect attaches in its own way."""
        return 0.0

    def reload(self, load: Load) -> Load:
        """The load as it is with the effect."""
        return load

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        """Change the tree; the load is attached already."""

    def settle(self, world: World) -> None:
        """Set the first state."""

    def push(self, world: World) -> None:
        """Apply forces, before each step."""

    def afterwards(self, track: Track) -> Track:
        """Change what the motors report."""
        return track


def cross(a: Array, b: Array) -> Array:
    """Vector product of two vectors; numpy's own takes as long as a step of the simulation."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def _consecutive(indices: NDArray[np.int64]) -> slice | NDArray[np.int64]:
    """The same indices, as a slice if that is possible: numpy then copies nothing."""
    first, count = int(indices[0]), len(indices)
    return slice(first, first + count) if np.array_equal(indices, first + np.arange(count)) else indices


def linear(value: float) -> Array:
    """A spring or damper of MuJoCo's tree without its higher powers."""
    return np.array([value, 0.0, 0.0])


def give(body: "mujoco.MjsBody", content: Body) -> None:
    """Mass, centre of mass and inertia of a body of MuJoCo's tree."""
    body.explicitinertial = True
    body.mass, body.ipos = content.mass, content.com
    body.fullinertia = content.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def rigid(scene: Scene, position: Array, base: Array, rows: NDArray[np.int64]) -> tuple[Array, Array]:
    """Wrench (n, 6) and effort (n, J) of the rigid robot and load of a scene along a motion, by MuJoCo's inverse.

    Args:
        scene: what the model says.
        position: (N, J) and base: (N, 3), at each step.
        rows: (n,) steps at which the answer is wanted, not the first or last two.
    """
    world = World(scene)
    model, data = world.model, world.data
    q = np.hstack([base, position]) if scene.base is not None else position
    speed = (q[rows + 1] - q[rows - 1]) / (2 * STEP)
    change = (q[rows + 1] - 2 * q[rows] + q[rows - 1]) / STEP**2
    wrench, effort = np.empty((len(rows), 6)), np.empty((len(rows), position.shape[1]))
    for i, row in enumerate(rows):
        data.qpos[world.address], data.qvel[world.driven], data.qacc[world.driven] = q[row], speed[i], change[i]
        mujoco.mj_inverse(model, data)
        wrench[i] = -data.sensordata
        effort[i] = data.qfrc_inverse[world.dofs]
    return wrench, effort
