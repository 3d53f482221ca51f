from ._episodes import new_player as new_player
from ._results import read_results as read_results
from ._target import TargetModel as TargetModel
