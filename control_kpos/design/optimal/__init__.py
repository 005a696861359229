"""Optimal control with linear cost under limits that grow with the state."""
