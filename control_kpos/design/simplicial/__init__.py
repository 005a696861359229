"""Gains on a simplicial cone: one linear program is necessary and sufficient."""
