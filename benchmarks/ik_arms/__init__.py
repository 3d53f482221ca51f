"""Inverse kinematics of every six- and seven-axis arm at hand, package beside package: `python -m benchmarks.ik_arms`.

- `arms`: the arms, their classes and the poses that are asked for.
- `solvers`: kinreach and the others, each as a class that another solver can join.
- `measure`: one solver on one arm, in a process of its own.
- `page`: the table, its page and its figure.
"""
