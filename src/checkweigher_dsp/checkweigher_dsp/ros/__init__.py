"""The rim to ROS: ports, stage nodes, outputs, diagnostics. Only this room knows rclpy."""
