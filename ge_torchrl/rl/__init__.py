"""The RL wing: differentiable trees, and PPO that trains them. It knows tensors and no codons."""
