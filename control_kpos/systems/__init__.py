"""Cone systems as python-control systems: how they are read, kept and connected."""
