"""An invariant cone for one matrix."""
