"""UR arms: geometry, closed-form inverse kinematics for one pose and for many."""
