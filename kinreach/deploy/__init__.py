"""From a motion to a moving robot: programs for a UR, a simulated UR to try them on, and a client that sends them.

- `Program` of `Move` lines or of a `Trajectory`: to URScript and back.
- `write_trajectory`, `read_trajectory`: a `Trajectory` as ROS 2's message in JSON, or as CSV.
- `SimulatedUR`: a UR in MuJoCo on the ports of a real one, on this machine only.
- `URClient`: reads a UR's state, runs programs, records what was commanded and measured, and stops them.

The modules are internal.
"""

from kinreach.deploy._client import URClient
from kinreach.deploy._program import Move, Program
from kinreach.deploy._server import SimulatedUR
from kinreach.deploy._trajectory_files import read_trajectory, write_trajectory

__all__ = ["Move", "Program", "SimulatedUR", "URClient", "read_trajectory", "write_trajectory"]
