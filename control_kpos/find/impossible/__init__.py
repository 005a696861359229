"""Proofs that no invariant cone exists."""
