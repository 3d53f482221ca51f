"""Seven-axis arms: the curves of postures that reach a pose, and the best posture on them."""
