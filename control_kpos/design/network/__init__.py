"""Local gains for the nodes of a network."""
