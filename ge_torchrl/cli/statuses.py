"""Exit statuses of the program, and how a job in another process hands its own over."""

OK = 0
FAULT = 1
"""A fault of the program."""
USER_ERROR = 2
"""What the user can mend, told in one line."""
INTERRUPTED = 130
"""Ctrl-C, as a shell counts it."""
OUTPUT_CLOSED = 141
"""Whoever read the output went away (`| head`), as a shell counts it."""


class JobFailedError(Exception):
    """A job in another process failed, and has said why."""

    def __init__(self, status: int) -> None:
        super().__init__(status)
        self.status = status
