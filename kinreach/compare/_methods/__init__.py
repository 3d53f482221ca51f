"""Methods of the comparison: how one is found by name or made from an object, and those that only its tasks use."""
