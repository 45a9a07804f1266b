"""Simulators' own models: kinematics and inertia as a URDF, and the physics of joints, drives and sensors beside it.

- `description`: `SimulatorModel` and its parts, the same for every simulator.
- `urdf_text`: bodies and joints as the text of a URDF, which every other room reads.
- `mjcf`, `mjcf_loading`: MuJoCo's models, through MuJoCo (the extra `sim`).
- `sdf`: SDFormat of Gazebo, the part that holds inertials, joints, drives and sensors.
- `reading`: a file of any of these kinds.
"""

from poise.simulation.models.description import JointDrive, JointPhysics, SensorNoise, SimulatorModel
from poise.simulation.models.mjcf_loading import imported_mujoco, loaded_spec
from poise.simulation.models.reading import model_kind, read_simulator_model, urdf_physics

__all__ = [
    "JointDrive",
    "JointPhysics",
    "SensorNoise",
    "SimulatorModel",
    "imported_mujoco",
    "loaded_spec",
    "model_kind",
    "read_simulator_model",
    "urdf_physics",
]
