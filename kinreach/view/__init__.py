"""The interactive page: `python -m kinreach.view` shows arms, all their postures, and why there are none.

What is on the screen is computed by modules without a browser, and the panels draw it:

- `target`: all postures for a target; `policy_solver`: trained policies as solvers.
- `real_arm`: a calibrated UR beside its data sheet.
- `episodes`: episodes, frame by frame; `players`: who can act in which environment.
- `results`: a comparison, goal by goal.
- `figure`, `mujoco_scene`: the shapes of an arm and of MuJoCo's scene; `names`, `html`, `snippet`: what is said of them
  in words, in the page's text, and as a program.

- `target_panel`, `real_arm_panel`, `episodes_panel`, `results_panel`: the parts of the page, each a `panel`; `draw` and
  `inputs` are their scene and their inputs.
- `page`: one tab; `server`: all tabs; `setup`: what `cli` was asked to show.
"""
