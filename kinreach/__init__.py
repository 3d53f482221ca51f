"""kinreach: does a robot need to learn to reach, when its kinematics is known in closed form?

Analytic kinematics, MuJoCo environments and RL baselines for the same reaching tasks, and one command that puts them
all on the same goals. Imports point one way, downwards:

    benchmarks.speed        speed beside other packages: `python -m benchmarks.speed`
    kinreach.compare      all methods on equal terms, with statistics: `python -m kinreach.compare`
    kinreach.demo         an environment to watch, or to film: `python -m kinreach.demo`
    kinreach.baselines    recipes, training and evaluation; knows environments only through Gymnasium
    kinreach.envs         MuJoCo scene, joint controller, cameras, tasks
    kinreach.plots        figures: data in, a matplotlib figure out
    kinreach.kinematics   forward and inverse kinematics, limits, collisions, the thesis's reward
    kinreach.robots       what an arm is; knows no engine

Units are metres, radians and seconds; z is up. `import kinreach` makes the environments known to Gymnasium and loads
no engine.
"""

from kinreach import _moved
from kinreach.registration import register_environments

__version__ = "0.2.0"

__all__ = ["__version__"]

_moved.install()
register_environments()
