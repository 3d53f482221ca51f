from ._ball_finder import PIPELINES as PIPELINES
from ._ball_finder import BallFix as BallFix
from ._cameras import MAX_EXPOSURE as MAX_EXPOSURE
from ._goal_view import GoalMeasurement as GoalMeasurement
from ._goal_view import goals_in_world as goals_in_world
from ._goal_view import in_image as in_image
