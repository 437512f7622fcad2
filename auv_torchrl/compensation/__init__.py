"""Closing the gap that was diagnosed: the effects found go into the simulator and the controller."""
