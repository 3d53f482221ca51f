from ._players import new_player as new_player
from ._players import playable as playable
from ._players import playable_names as playable_names
