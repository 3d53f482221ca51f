"""Watch an environment: `python -m kinreach.demo`."""
