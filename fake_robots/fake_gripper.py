"""A fake Robotiq gripper as a program, on a pseudo-terminal.

python -m poise.fake_robots.fake_gripper --object-width 0.03
"""

import argparse
import contextlib
import threading

from poise.gripping import GRIPPERS, FakeGripper


def main() -> None:
    """Run until Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", choices=sorted(GRIPPERS), default="2f85")
    parser.add_argument("--object-width", type=float, metavar="M", help="m, of what is between the fingers")
    arguments = parser.parse_args()
    with FakeGripper(GRIPPERS[arguments.model]) as gripper:
        gripper.object_width = arguments.object_width
        print(f"gripper_driver --ros-args -p address:={gripper.port} -p model:={arguments.model}", flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()


if __name__ == "__main__":
    main()
