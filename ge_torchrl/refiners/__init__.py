"""Refiners make better trees of trees, their structure unchanged; no codons, and no torch outside `rl`."""
