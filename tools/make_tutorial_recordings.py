"""Makes the recordings of the tutorials: a UR10e whose sensor is mounted turned, and an arm with friction.

    python tools/make_tutorial_recordings.py      # needs: pip install '.[sim]'

- `examples/ur10e/weighing.mcap`: twelve poses with 2.35 kg on the sensor, which is mounted turned by 30 degrees.
- `examples/arm/run.mcap`: joint efforts of MuJoCo along a motion of 20 s; `examples/arm/arm.xml` lacks the friction.

Running it twice gives the same files.
"""

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from poise.files import write_whole
from poise.geometry import rotation_about
from poise.inertia import InertialParameters
from poise.recording import JointStream, write_recording
from poise.robot import RobotModel, find_urdf, read_urdf
from poise.simulation import FourierTrajectory, IdealRobot, JointNoise, read_trajectory, record, wrench_noise

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
MAY = 1_777_881_600 * 10**9
"""2026-05-04 08:00 UTC, ns."""
PAYLOAD = InertialParameters(2.35, np.array([0.012, -0.004, 0.081]), np.diag([0.011, 0.0105, 0.0042]))
TURNED = np.deg2rad(30.0)
RATE = 50.0
FRICTION = {"shoulder": (1.8, 0.9), "elbow": (0.9, 0.5), "wrist": (0.25, 0.12)}
"""Dry friction, N m, and damping, N m s/rad, by joint."""
CREEP = 0.02
"""rad/s over which dry friction changes its sign."""


def make_weighing(folder: Path) -> Path:
    """The UR10e with a gripper and a part, on a sensor whose adapter is turned about its axis."""
    robot = RobotModel.from_file("ur10e")
    motion = read_trajectory(folder / "motion.yaml", robot)
    ideal = IdealRobot(robot, PAYLOAD.phi)
    noise = wrench_noise("moderate", rate=RATE)
    made = record(ideal, motion, np.random.default_rng(10), noise, JointNoise(rate=RATE, position=2e-6), start=MAY)
    turn = np.kron(np.eye(2), rotation_about(np.array([0.0, 0.0, 1.0]), TURNED).T)
    wrench = replace(
        made.wrench, wrench_in_sensor=made.wrench.wrench_in_sensor @ turn.T + [4.1, -2.3, 7.5, 0.1, 0.2, 0]
    )
    streams = {"joint_states": made.joints, "wrench": wrench}
    text = read_urdf(find_urdf("ur10e"))
    write_recording(folder / "weighing.mcap", streams, robot_description=text)
    return folder / "weighing.mcap"


def make_run(folder: Path) -> Path:
    """An arm with friction, simulated by MuJoCo; and the MJCF of the same arm without it."""
    urdf = (folder / "arm.urdf").read_text(encoding="utf-8")
    spec = mujoco.MjSpec.from_string(urdf)
    write_whole(folder / "arm.xml", _tidy(spec.to_xml()).encode())
    for joint in spec.joints:
        joint.damping = FRICTION[joint.name][1] * np.eye(1, np.size(joint.damping))[0]  # MuJoCo 4: a polynomial
    model = spec.compile()
    data = mujoco.MjData(model)
    robot = RobotModel.from_file(folder / "arm.urdf", "tool")
    rng = np.random.default_rng(7)
    motion = FourierTrajectory.random(robot, rng, duration=20.0, speed=0.8)
    times = np.arange(int(20.0 * 2 * RATE)) / (2 * RATE)
    path = motion.at(times)
    efforts = np.empty_like(path.position)
    for row in range(len(times)):
        data.qpos[:], data.qvel[:], data.qacc[:] = path.position[row], path.velocity[row], path.acceleration[row]
        mujoco.mj_inverse(model, data)
        efforts[row] = data.qfrc_inverse
    dry = np.array([FRICTION[name][0] for name in robot.joint_names])
    efforts += dry * np.tanh(path.velocity / CREEP)
    efforts += rng.normal(scale=0.01 * np.abs(efforts).max(axis=0), size=efforts.shape)
    stamps = MAY + np.round(times * 1e9).astype(np.int64)
    joints = JointStream(stamps, robot.joint_names, path.position, path.velocity, efforts)
    write_recording(folder / "run.mcap", {"joint_states": joints}, robot_description=urdf)
    return folder / "run.mcap"


def _tidy(xml: str) -> str:
    """Without what MuJoCo's converter repeats."""
    return re.sub(r"\n\s*\n", "\n", xml)


def main() -> None:
    """Write both."""
    for path in (make_weighing(EXAMPLES / "ur10e"), make_run(EXAMPLES / "arm")):
        print(f"written: {path}, {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
