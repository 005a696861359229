"""Hard bounds: intervals of states that no disturbance leaves, and gains that keep them."""
