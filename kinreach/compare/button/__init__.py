"""Whole episodes of the button task: who plays them, what is measured, and how it is reported."""
