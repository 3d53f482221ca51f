"""The interactive page: `python -m kinreach.view` shows arms, all their postures, and why there are none.

What is on the screen is computed by modules without a browser (`figure`, `target`, `names`); `page` draws it.
"""
