"""Methods of the comparison: how one is found by name or made from an object, and those that only its tasks use."""

from kinreach.compare._methods.resolve import colours, policy_method, resolve_methods, solver_method

__all__ = ["colours", "policy_method", "resolve_methods", "solver_method"]
