"""Kernels: compiled code that steps lanes of episodes, decides in them and draws, and the dynamics that it knows."""
