"""A module of somebody's methods that fail."""

FAILING = """
import numpy as np
from kinreach.kinematics import IKResult

class Fails:
    def __init__(self, kinematics):
        self.kinematics, self.calls = kinematics, 0

    def solve(self, goal, seed, *, accept=None):
        self.calls += 1
        if self.calls > {calls}:
            return 1 / 0
        return IKResult.of(self.kinematics, goal, np.array(seed), iterations=1)

class Unmade(Fails):
    def __init__(self, kinematics):
        raise KeyError("no such thing")

def wrong(observation):
    return np.zeros(2)
"""
