"""Search: fitness, champion and the generation as a few verbs."""
