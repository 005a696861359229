"""Networks whose nodes are known within sets: one certificate for every choice, also one that changes at any time."""
