"""ROS nodes around the stages: parameters in, message to record, stage, record to message."""
