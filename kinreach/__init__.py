"""kinreach: does a robot need to learn to reach, when its kinematics is known in closed form?

Analytic kinematics, MuJoCo environments and RL baselines for the same reaching tasks, and one command that puts them
all on the same goals. Imports point one way, downwards:

    kinreach.view         a page in the browser: `python -m kinreach.view`
    kinreach.demo         an environment to watch, or to film: `python -m kinreach.demo`
    kinreach.compare      all methods on equal terms, with statistics: `python -m kinreach.compare`
    kinreach.plots        the style of the figures
    kinreach.baselines    policies, recipes, training and evaluation
    kinreach.envs         the tasks, as Gymnasium environments
    kinreach.vision       cameras, and the ball found in their pictures
    kinreach.sim          MuJoCo: scene, joint controller, one arm or a batch
    kinreach.thesis       the thesis's reward and geometry of postures
    kinreach.kinematics   forward and inverse kinematics, limits, collisions
    kinreach.robots       what an arm is; knows no engine

Units are metres, radians and seconds; z is up. `import kinreach` makes the environments known to Gymnasium and loads
no engine.
"""

from kinreach._registration import register_environments

__version__ = "0.3.0"

__all__ = ["__version__"]

register_environments()
