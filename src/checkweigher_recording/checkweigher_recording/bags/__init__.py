"""ROS 2 bags: reader, writer and recovery."""
