"""Grasping and lifting an object with a gripper: `kinreach/Lift-v0`."""
