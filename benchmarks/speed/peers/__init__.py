"""Other people's packages, one module each, behind one call: what a suite needs and no more."""
