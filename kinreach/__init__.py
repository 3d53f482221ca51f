"""kinreach: analytic kinematics, MuJoCo environments and RL baselines for reaching."""
