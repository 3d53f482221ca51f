from ._client import URClient as URClient
from ._program import Move as Move
from ._program import Program as Program
from ._server import SimulatedUR as SimulatedUR
from ._trajectory_files import read_trajectory as read_trajectory
from ._trajectory_files import write_trajectory as write_trajectory
