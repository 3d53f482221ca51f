"""Gymnasium environments: reaching, a moving ball, lifting, an inexact arm, obstacles, and a button.

`import kinreach` registers them for `gymnasium.make`. `RecordMotion` records a video with the motion of every step.
`TabletopTask` and `register_tabletop` make an environment of a task of your own: an arm, its gripper, an object.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
