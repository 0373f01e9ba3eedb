"""ge_torchrl: interpretable decision-tree policies by grammatical evolution and PPO."""

__version__ = "0.1.0"
