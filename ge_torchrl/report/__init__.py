"""What persons read of finished runs: tables, pages, figures, and tests of their trees on new episodes."""
