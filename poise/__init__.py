"""Poise: weigh what a mobile manipulator holds, say how hard a stack can be pushed, put the next object where it stays.

The core: nothing in here but `nodes` and `fake_robots` imports ROS.
"""

__version__ = "0.1.0"
