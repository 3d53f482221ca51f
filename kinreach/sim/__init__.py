"""The arms in MuJoCo: scene, joint controller, simulation and pictures. Knows no task and no learning."""
