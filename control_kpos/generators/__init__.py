"""Cones known by their generators: nonnegative combinations, and what they prove without facets."""
