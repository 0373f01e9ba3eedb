"""Decision trees: the shared type, its simplification, its measure and its pictures."""
