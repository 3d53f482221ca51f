from ._reward import IMPOSSIBLE_REWARD as IMPOSSIBLE_REWARD
from ._reward import NEAR_REWARD as NEAR_REWARD
from ._reward import REACHED_REWARD as REACHED_REWARD
