"""The thesis's task as Gymnasium environments: single-step and multi-step, one at a time or in native batches."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules={"reach_task"})
