from ._posture import posture_errors as posture_errors
from ._reward import IMPOSSIBLE_REWARD as IMPOSSIBLE_REWARD
from ._reward import NEAR_REWARD as NEAR_REWARD
from ._reward import REACHED_REWARD as REACHED_REWARD
from ._reward import ReachReward as ReachReward
from ._reward import reward_of_errors as reward_of_errors
