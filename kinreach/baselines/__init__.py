"""Policies and what they are made with. Environments are known only through Gymnasium's interface."""
