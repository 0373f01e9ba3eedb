"""Settings are tuned: Optuna tries them in runs that never see a test, and the best become a preset."""
