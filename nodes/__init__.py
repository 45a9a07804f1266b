"""ROS 2 nodes: parameters in, one core call, messages out."""
