"""ROS messages: observations as messages and back, with their types, topics and pictures."""
