"""The style of the figures, a name and a colour for each method, maps, and what `kinreach check` draws.

Figures of comparisons are drawn in `kinreach.compare`, those of the notebooks in `notebooks/figures`.
"""
