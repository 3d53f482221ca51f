"""The suites, one module each; `kinreach.bench.registry` has their names."""
