"""Settings of all tests."""

from hypothesis import settings

# The first example that meets a kernel waits for its compilation: no example may have a deadline. The same examples
# every time keep a failure from coming and going.
settings.register_profile("compiled", deadline=None, derandomize=True)
settings.load_profile("compiled")
