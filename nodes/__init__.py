"""ROS 2 nodes: they read parameters, call the core and publish messages."""

import os

# Before numpy is imported: matrices are small here, and a node shares its computer with the rest of the robot.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
