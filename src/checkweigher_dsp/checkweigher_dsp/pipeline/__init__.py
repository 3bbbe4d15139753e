"""The stages in one loop, without ROS."""
