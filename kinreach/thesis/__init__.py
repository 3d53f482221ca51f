"""The thesis's reward and the geometry of postures behind it: pure functions on arrays."""
