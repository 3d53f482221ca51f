"""Analytic and numeric kinematics."""
