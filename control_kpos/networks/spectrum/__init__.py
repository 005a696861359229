"""Where the spectrum of a network lies: solves reduced to the ports, and brackets with both sides proven."""
