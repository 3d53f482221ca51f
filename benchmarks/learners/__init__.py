"""Algorithms and recipes that only studies train with; they are not installed with the package.

    python -m kinreach.train benchmarks.learners:td3_single

Importing this package registers them under the names that the studies and the logs use.
"""

from benchmarks.learners.off_policy import ddpg_multi, ddpg_single, sac_multi, sac_single, td3_multi, td3_single
from benchmarks.learners.thesis_world import (
    thesis_multi_camera,
    thesis_single_camera,
    thesis_single_image,
    thesis_single_tolerance,
)

__all__ = [
    "ddpg_multi",
    "ddpg_single",
    "sac_multi",
    "sac_single",
    "td3_multi",
    "td3_single",
    "thesis_multi_camera",
    "thesis_single_camera",
    "thesis_single_image",
    "thesis_single_tolerance",
]
