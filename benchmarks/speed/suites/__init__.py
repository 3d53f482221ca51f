"""The suites, one module each; `benchmarks.speed.registry` has their names."""

#: What the shares in the suites' texts are from: a run says nothing of them.
PROFILED = (
    "Profiles of 21 November 2026 (Intel Xeon Processor, 2 cores; Python 3.11.7, numpy 2.3.5, "
    "Pinocchio 3.8.0, MuJoCo 4.0.0)"
)
