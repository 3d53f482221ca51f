"""Planning paths around obstacles: generated problems, those of VAMP's UR5, and other planners of OMPL."""
