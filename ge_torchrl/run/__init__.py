"""One run: from a configuration to a verdict, with its files and its screen."""
