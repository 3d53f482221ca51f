from ._moving import MotionFlags as MotionFlags
from ._moving import TriedMotion as TriedMotion
