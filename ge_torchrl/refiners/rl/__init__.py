"""The RL wing: differentiable trees, and PPO that trains many of them at once. It knows tensors and no codons."""
