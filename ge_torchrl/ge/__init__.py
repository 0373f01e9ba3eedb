"""Grammatical evolution: grammar, mapping, variation and selection; no torch, no environment."""
