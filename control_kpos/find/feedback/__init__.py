"""Cone and feedback gain found together."""
