"""What other rooms use of this one, as `inside.pyi` lists it; what users type is in `kinreach.kinematics`.

- Pinocchio's model of an arm, and its chain for many postures: `build_model`, `link_frame`, `SerialChain`.
- Collisions: margins, pairs that may touch, what an arm without shapes is told.
- Limits and windings: `SLACK`, `nearest_windings`, `past_limits`.
- Solvers by their names, and the test that they take: `SOLVERS`, `new_solver`, `Accept`.
- Why a pose of a UR has no posture: `Shortfall`, `Miss`; branches by name.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__package__, __file__)
