"""One module per arm; each defines `ARM`.

A new file here is a new arm: forward kinematics, the numeric solvers, collision checks and the simulation take it by
its name. A closed form (`kinreach.kinematics`) and a task (`kinreach.envs`, `kinreach.compare.tasks`) are written for
one arm each.
"""
