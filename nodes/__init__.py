"""ROS 2 nodes: they read parameters, call the core and publish messages."""

import os
import signal
import sys
from pathlib import Path

# Before numpy is imported: matrices are small here, and a node shares its computer with the rest of the robot.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

_PROGRAMS = {"fake_robot", *(file.stem for file in Path(__file__).parent.glob("*.py"))}
if Path(sys.argv[0]).name in _PROGRAMS and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    # A node ends by Ctrl-C also while it imports, without a traceback; from `runtime.run` on rclpy handles the signal.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
