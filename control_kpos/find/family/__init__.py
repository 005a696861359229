"""A common invariant cone for several matrices."""
