"""Record a MuJoCo model under commands as a bag: `python examples/simulator/record.py OUT.mcap [--robot]`.

The bag has the standard topics: joint_states with the efforts of the drives, joint_commands, and the wrench as the load
exerts it on the sensor. With --robot, the model is first made into the "robot" of the example, whose joints have
another friction, whose drives are softer and late, and which carries more. Needs MuJoCo: pip install '.[sim]'.
"""

import argparse
from pathlib import Path

import mujoco
import numpy as np

from poise.recording import JointStream, WrenchStream, write_recording

MODEL = Path(__file__).parent / "arm.xml"
SECONDS, EVERY, SENT = 20.0, 10, 2
JOINTS = ("turn", "shoulder", "elbow")
START = 1_700_000_000 * 10**9  # ns, of the robot's clock; the simulator's begins at zero


def commands(seconds: float) -> np.ndarray:
    """Positions of the joints, rad: a few sines each."""
    rates = np.array([[0.9, 2.1, 3.7], [0.7, 1.7, 3.1], [1.1, 2.3, 4.1]])
    sizes = np.array([[0.7, 0.25, 0.08], [0.5, 0.2, 0.07], [0.6, 0.25, 0.08]])
    return np.asarray((sizes * np.sin(rates * seconds + rates)).sum(axis=1)) + np.array([0.0, 0.3, 0.2])


def robot() -> mujoco.MjSpec:
    """What the simulation lacks."""
    spec = mujoco.MjSpec.from_file(str(MODEL))
    for name, friction, damping in zip(JOINTS, (1.4, 1.8, 0.9), (1.2, 0.9, 0.6), strict=True):
        joint = spec.joint(name)
        joint.frictionloss = friction
        joint.damping = [damping, 0.0, 0.0] if np.ndim(joint.damping) else damping
        drive = spec.actuator(name)
        drive.set_to_position(kp=220.0, kv=12.0)
        drive.delay, drive.nsample = 0.012, 14
    spec.body("held").mass = 1.3
    return spec


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--robot", action="store_true")
    options = parser.parse_args()
    spec = robot() if options.robot else mujoco.MjSpec.from_file(str(MODEL))
    model = spec.compile()
    data, rng, rows, orders = mujoco.MjData(model), np.random.default_rng(1 if options.robot else 2), [], []
    data.qpos[:] = commands(0.0)
    for step in range(round(SECONDS / model.opt.timestep)):
        data.ctrl[:] = commands(data.time)
        if step % SENT == 0:
            orders.append(np.concatenate([[data.time], data.ctrl]))
        state = [[data.time], data.qpos.copy(), data.qvel.copy()]  # before the step, as the forces
        mujoco.mj_step(model, data)
        if step % EVERY == 0:
            # MuJoCo's sensors read what the parent exerts on the child; the topic is what the load exerts.
            rows.append(np.concatenate([*state, data.actuator_force, -data.sensordata]))
    values, sent = np.array(rows), np.array(orders)
    begin = START if options.robot else 0
    stamps, ordered = (begin + np.round(each[:, 0] * 1e9).astype(np.int64) for each in (values, sent))
    position, velocity, effort, wrench = np.split(np.round(values[:, 1:], 6), [3, 6, 9], axis=1)
    if options.robot:
        position = np.round(position, 5)  # encoders
        velocity = np.round(velocity + rng.normal(0.0, 1e-3, velocity.shape), 5)
        effort = np.round(effort + rng.normal(0.0, 0.05, effort.shape), 4)
        wrench = np.round(wrench + rng.normal(0.0, [0.05] * 3 + [0.002] * 3, wrench.shape), 5)
    commanded = np.round(sent[:, 1:], 6)
    nothing = np.full(commanded.shape, np.nan)
    streams = {
        "joint_states": JointStream(stamps, JOINTS, position, velocity, effort),
        "joint_commands": JointStream(ordered, JOINTS, commanded, nothing, nothing),
        "wrench": WrenchStream(stamps, wrench, "ft_sensor"),
    }
    write_recording(options.out, streams)


if __name__ == "__main__":
    main()
