"""Iterative inverse-kinematics solvers and the closed form behind one protocol."""
