"""Exact numbers and proven signs: what every verdict rests on."""
