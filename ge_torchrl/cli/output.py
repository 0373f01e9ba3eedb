"""The program's output: on terminals that know only ASCII, and on pipes that nobody reads any more."""

import codecs
import os
import select
import sys
import warnings
from io import TextIOWrapper
from typing import TYPE_CHECKING

from ge_torchrl.cli.frames import told_of_frames
from ge_torchrl.cli.statuses import FAULT, USER_ERROR
from ge_torchrl.errors import RunFaultError, UserError
from ge_torchrl.printing import message_of

if TYPE_CHECKING:
    from rich.console import Console

    from ge_torchrl.report.tables import Form

_PLAIN = {"├": "|", "└": "`", "─": "-", "│": "|", "±": "+-", "→": "->", "…": "...", "°": "deg"}
_HANDLER = "ge_torchrl_plain"


def prepare_output() -> None:
    """Let what is printed show every text, and keep quiet what other packages say that no user can mend."""
    codecs.register_error(_HANDLER, _plain)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)
    # cma says so where matplotlib is not installed; nothing here plots with cma.
    warnings.filterwarnings("ignore", "Could not import matplotlib", UserWarning, r"cma\.")


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Replace a character that the encoding has not: lines of trees by ASCII ones, any other by a question mark."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lost = error.object[error.start : error.end]
    return "".join(_PLAIN.get(character, "?") for character in lost), error.end


def form_of_tables(*, markdown: bool) -> "Form":
    """Return the form of tables on standard output: drawn on a terminal, plain elsewhere, or the Markdown asked for."""
    if markdown:
        return "markdown"
    return "terminal" if sys.stdout.isatty() else "plain"


def open_console() -> "Console":
    """Return the console of a run; a closed pipe raises `BrokenPipeError`, as with `print`."""
    from rich.console import Console

    class OutputConsole(Console):
        def on_broken_pipe(self) -> None:
            # Rich's own answer is to exit with status 1 on the spot, which would leave a run no time to save.
            self.quiet = True
            raise BrokenPipeError

    return OutputConsole(highlight=False)


def tell(error: UserError | RunFaultError) -> int:
    """Tell in one line what went wrong, and where in the user's own code; return the exit status of that."""
    print(f"ge-torchrl: {message_of(f'{error}{told_of_frames(error)}')}", file=sys.stderr)
    return USER_ERROR if isinstance(error, UserError) else FAULT


def is_output_closed() -> bool:
    """Tell whether nobody reads standard output any more; if so, what is still printed is dropped."""
    try:
        sys.stdout.flush()
        closed = _has_no_reader()
    except BrokenPipeError:
        closed = True
    if closed:
        # The interpreter flushes once more at its end, and would complain.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return closed


def _has_no_reader() -> bool:
    # A write that failed may have left nothing to flush, so the pipe itself is asked.
    if not hasattr(select, "poll"):
        return False
    try:
        poll = select.poll()
        poll.register(sys.stdout.fileno(), select.POLLOUT)
    except OSError:
        return False  # Standard output is no file, as in tests.
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0))
