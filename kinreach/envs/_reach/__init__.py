"""The thesis's task as Gymnasium environments: single-step and multi-step, one at a time or in native batches."""
