"""From a motion to a moving robot: programs for a UR, a simulated UR to try them on, and a client that sends them.

- `Program` of `Move`s or of a `Trajectory`: URScript and back.
- `SimulatedUR`: a UR in MuJoCo that answers on the ports of a real one, on this machine only.
- `URClient`: reads a UR's state, runs programs and stops them; `Recording` is what was commanded and measured.

The modules are internal.
"""

from kinreach.deploy._client import URClient
from kinreach.deploy._controller import Recording
from kinreach.deploy._program import Move, Program
from kinreach.deploy._server import SimulatedUR

__all__ = ["Move", "Program", "Recording", "SimulatedUR", "URClient"]
