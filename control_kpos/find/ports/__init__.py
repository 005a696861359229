"""An invariant cone that holds given inputs and lies in given half-spaces of outputs."""
