"""Gains on any polyhedral cone, by alternation between gain and Lyapunov vector."""
