"""Environments: what they are, how fast they run, and one truth from two backends."""
