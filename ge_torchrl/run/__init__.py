"""One run, with its files and its screen."""
