"""Cameras, and the ball found in their pictures."""
