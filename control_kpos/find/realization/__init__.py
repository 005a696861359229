"""Realizations with nonnegative matrices, from transfer functions, state-space systems and impulse responses."""
