"""From a motion to a moving robot: programs for a UR, a simulated UR to try them on, and a client that sends them.

- `Program` of `Move` lines or of a `Trajectory`: to URScript and back.
- `write_trajectory`, `read_trajectory`: a `Trajectory` as ROS 2's message in JSON, or as CSV.
- `SimulatedUR`: a UR in MuJoCo on the ports of a real one, on this machine only.
- `URClient`: reads a UR's state, runs programs, records what was commanded and measured, and stops them.

The modules are internal.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
