"""The errors of a healthy machine: each lies at the edge of its tolerance in model.yaml."""

from dataclasses import dataclass

import numpy as np

from benchmarks.foreign.fault import direction
from benchmarks.foreign.load import Load, changed
from benchmarks.foreign.motions import STEP
from benchmarks.foreign.robots import Array, links
from benchmarks.foreign.sensors import LEVER, turned
from benchmarks.foreign.world import GRAVITY, Scene

TOLERANCE = {
    "payload": {"mass": 0.01, "com": 0.002, "inertia": 0.1},
    "sensor_bias": {"force": 0.4, "torque": 0.025},
    "bias_drift": {"force": 0.12, "torque": 0.008},
    "sensor_gain": 0.01,
    "sensor_rotation": 0.004,
    "joint_offset": 0.001,
    "clock_offset": 0.004,
}
"""The entry of model.yaml; relative, m, N, N m, rad, s."""
BASE_TILT, LINK_MASS = 0.001, 0.005
"""rad and relative; model.yaml has no entry for them: a spirit level, and a data sheet with three digits."""


@dataclass(frozen=True, eq=False)
class Honest:
    """Errors inside the tolerances.

    Args:
        mass: relative. com: (3,) m. inertia: relative.
        gain: (6, 6) of the readings, with crosstalk and force to torque. rotation: (3,) rad.
        bias, drift: (6,) N and N m. zeros: (J,) rad or m of the encoders. tilt: (2,) rad.
        links: factor on the mass of each link. late: s, of the wrench's stamps.
    """

    mass: float
    com: Array
    inertia: float
    gain: Array
    rotation: Array
    bias: Array
    drift: Array
    zeros: Array
    tilt: Array
    links: dict[str, float]
    late: float

    def load(self, declared: Load) -> Load:
        """The load as it truly is."""
        return changed(declared, 1 + self.mass, self.com, 1 + self.inertia)

    def gravity(self) -> Array:
        """(3,) m/s2 that the tilt adds to gravity."""
        return GRAVITY * np.array([self.tilt[0], self.tilt[1], 0.0])

    def sense(self, seconds: Array, wrench: Array) -> Array:
        """(N, 6) the wrench as the sensor's calibration gives it."""
        read = turned(wrench, self.rotation) @ (np.eye(6) + self.gain).T
        return np.asarray(read + self.bias + np.outer(seconds / seconds[-1] - 0.5, self.drift))


CLOCK_EDGE = 0.0038
"""s, of the wrench's clock against the joints', filter, skew and all; the rest of the tolerance is for jitter."""


def draw(scene: Scene, rng: np.random.Generator, delay: float = 0.0, skew: float = 0.0) -> Honest:
    """Errors at the edges, with random signs and directions.

    Args:
        scene: robot and length of the run. rng: chance.
        delay: s that a filter adds to the wrench. skew: of the joints' clock, by which the offset changes.
    """

    def sign(*shape: int) -> Array:
        return np.asarray(rng.choice([-1.0, 1.0], shape))

    relative = 0.01
    gain = relative * np.kron(np.eye(2), np.ones((3, 3))) * sign(6, 6)
    gain[3:, :3] = relative * LEVER * sign(3, 3)
    zeros = 1e-3 * sign(len(scene.robot.joints)) * np.where(scene.robot.prismatic > 0, 0.2, 1.0)
    return Honest(
        mass=0.01 * float(sign(1)[0]),
        com=0.002 * direction(rng),
        inertia=0.1 * float(sign(1)[0]),
        gain=gain,
        rotation=0.004 * direction(rng),
        bias=np.repeat([0.4, 0.025], 3) * sign(6),
        drift=np.repeat([0.12, 0.008], 3) * sign(6),
        zeros=zeros,
        tilt=BASE_TILT * direction(rng, 2),
        links={name: 1 + LINK_MASS * float(sign(1)[0]) for name in links(scene.robot)},
        late=(CLOCK_EDGE if rng.random() < 0.5 else skew * scene.steps * STEP - CLOCK_EDGE) - delay,
    )
