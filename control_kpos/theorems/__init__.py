"""Theorems 1 to 3 about one system, and the induced gains that follow from them."""
