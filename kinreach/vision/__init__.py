"""Cameras, and the ball found in their pictures: pinhole model, RGB-D sensors, ball finder, the goal in the world."""

from kinreach.vision._ball_finder import find_ball
from kinreach.vision._cameras import Intrinsics, RGBDCamera, RGBDImage, SensorNoise
from kinreach.vision._circles import circle_votes, edge_steps
from kinreach.vision._goal_view import CameraGoalView, geometric_goal_view, goal_in_world

__all__ = [
    "CameraGoalView",
    "Intrinsics",
    "RGBDCamera",
    "RGBDImage",
    "SensorNoise",
    "circle_votes",
    "edge_steps",
    "find_ball",
    "geometric_goal_view",
    "goal_in_world",
]
