"""Bags of ROS 1 and ROS 2: their messages one by one, the types of these, and what their topics mean."""
