"""Measurements that stand beside published numbers; each module is one command."""
