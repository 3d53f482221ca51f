"""Names that other rooms use; `inside.pyi` lists them, and what users type is in `kinreach.baselines`.

- Policies: `Policy`, `as_policy` and `SolverPolicy` make one of a solver or a function; `LearnedPolicy` is a file's.
- Files of policies: `pretrained_names`, `run_name`, `policy_version`.
- Scripts: `PushScript`, `PickAndPlaceScript`, `TabletopScript` bring objects to places.
- Minari datasets: `check_dataset` checks the name of a new one, `write_dataset` plays episodes into it.
- `expert`, the closed form as a map in batches; `random_arms`, arms with random errors.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__package__, __file__)
