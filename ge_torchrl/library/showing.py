"""Where a call of the library shows how far it is: wherever somebody looks, and nowhere else."""

from __future__ import annotations

import sys

from rich.console import Console

from ge_torchrl.run.notebook import NotebookConsole


def console_for(*, progress: bool) -> Console:
    """Return the console of a call: that of a notebook or a terminal, else one that shows nothing.

    Args:
        progress: Whether anything is to be shown at all.
    """
    if progress and is_notebook():
        return NotebookConsole()
    console = Console(stderr=True, highlight=False)
    console.quiet = not (progress and console.is_terminal)
    return console


def is_notebook() -> bool:
    """Tell whether this runs in a kernel of Jupyter, whose output is no terminal but can be drawn anew."""
    # Whoever is in a notebook has loaded IPython; nobody else loads it for us.
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return getattr(shell, "kernel", None) is not None
