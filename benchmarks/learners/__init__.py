"""Algorithms and recipes that only studies train with; they are not installed with the package.

    python -m kinreach.train benchmarks.learners:td3_single

Importing this package registers them under the names that the studies and the logs use.
"""

from benchmarks.learners.button import (
    button_dqn,
    button_dqn_report_actuation,
    button_report_actuation,
    button_report_both,
    button_report_controls,
    button_report_frames,
    button_report_press,
)
from benchmarks.learners.button_exploration import (
    button_report_demonstrated,
    button_report_demonstrated_19,
    button_report_demonstrated_frames,
    button_report_demonstrated_press,
    button_report_imitated,
)
from benchmarks.learners.distilled import (
    distilled_moving_late,
)
from benchmarks.learners.hidden_push import (
    imitated_hidden_push,
)
from benchmarks.learners.off_policy import (
    ddpg_multi,
    ddpg_single,
    sac_multi,
    sac_single,
    td3_multi,
    td3_single,
)
from benchmarks.learners.ranked_episodes import (
    ranked_moving_late,
    ranked_moving_tuned_late,
)
from benchmarks.learners.regression import (
    ik_net,
)
from benchmarks.learners.sb3_ppo import (
    sb3_multi,
    sb3_multi_long,
    sb3_single,
)
from benchmarks.learners.thesis_world import (
    thesis_ppo_multi_camera,
    thesis_ppo_single_camera,
    thesis_ppo_single_image,
    thesis_ppo_single_tolerance,
)
from benchmarks.learners.variants import (
    gradient_moving_down,
    gradient_moving_late,
    gradient_moving_late_weak,
    gradient_moving_rough,
    pixels_light,
    ppo_lift_multi_careful,
    ppo_lift_multi_unguided,
    ppo_lift_single,
    ppo_moving_delay,
    ppo_moving_delay_08,
    ppo_moving_hidden,
    ppo_moving_noise,
    ppo_moving_noise_10,
    ppo_moving_steered_late,
    ppo_moving_tuned_late,
    ppo_multi_ending,
    space_ranked,
)

__all__ = [
    "button_dqn",
    "button_dqn_report_actuation",
    "button_report_actuation",
    "button_report_both",
    "button_report_controls",
    "button_report_demonstrated",
    "button_report_demonstrated_19",
    "button_report_demonstrated_frames",
    "button_report_demonstrated_press",
    "button_report_frames",
    "button_report_imitated",
    "button_report_press",
    "ddpg_multi",
    "ddpg_single",
    "distilled_moving_late",
    "gradient_moving_down",
    "gradient_moving_late",
    "gradient_moving_late_weak",
    "gradient_moving_rough",
    "ik_net",
    "imitated_hidden_push",
    "pixels_light",
    "ppo_lift_multi_careful",
    "ppo_lift_multi_unguided",
    "ppo_lift_single",
    "ppo_moving_delay",
    "ppo_moving_delay_08",
    "ppo_moving_hidden",
    "ppo_moving_noise",
    "ppo_moving_noise_10",
    "ppo_moving_steered_late",
    "ppo_moving_tuned_late",
    "ppo_multi_ending",
    "ranked_moving_late",
    "ranked_moving_tuned_late",
    "sac_multi",
    "sac_single",
    "sb3_multi",
    "sb3_multi_long",
    "sb3_single",
    "space_ranked",
    "td3_multi",
    "td3_single",
    "thesis_ppo_multi_camera",
    "thesis_ppo_single_camera",
    "thesis_ppo_single_image",
    "thesis_ppo_single_tolerance",
]
