"""Inverse-kinematics solvers behind one protocol: the closed form, and three iterative ones to compare it with."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
