"""Plants: a user's own dynamics, read from a file, as a kernel and as a Gymnasium environment."""
