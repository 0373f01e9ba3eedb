"""The console script `ge-torchrl`: what `python -m ge_torchrl` is under another name."""

import os
import sys

from ge_torchrl.interrupts import leave_quietly, leave_soon


def main() -> int:
    """Run the command line of the process and return its exit status, as `ge_torchrl.__main__.main` does."""
    leave_quietly()
    if not sys.flags.safe_path:
        # As with python -m: environments and wrappers may be modules of the current folder.
        sys.path.insert(0, os.getcwd())  # noqa: PTH109 (pathlib takes time to import)
    if sys.argv[1:3] == ["completion", "words"]:
        # A shell asks at TAB, and a person waits: nothing else is loaded.
        from ge_torchrl.cli import complete_words

        return complete_words(sys.argv[3:])
    from ge_torchrl.__main__ import main as run

    return leave_soon(run())
