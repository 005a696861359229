"""Analysis and design of cone-invariant (K-positive) linear systems on top of python-control."""
