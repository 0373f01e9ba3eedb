"""The version, in a place of its own: whoever writes it down loads nothing else."""

__version__ = "0.1.0"
