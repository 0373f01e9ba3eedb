"""Exit statuses of the program."""

OK = 0
FAULT = 1
"""A fault of the program."""
USER_ERROR = 2
"""What the user can mend, told in one line."""
INTERRUPTED = 130
"""Ctrl-C, as a shell counts it."""
OUTPUT_CLOSED = 141
"""Whoever read the output went away (`| head`), as a shell counts it."""
