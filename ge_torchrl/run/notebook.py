"""The screen of a run in a notebook: one output, drawn anew from time to time."""

from __future__ import annotations

import io
import time
from html import escape
from typing import Any

from rich.console import Console, RenderableType

# Every drawing goes through the browser.
_REFRESH_SECONDS = 0.5
# Lines of news above what is drawn.
_LINES = 3
_WIDTH = 88


class NotebookConsole(Console):
    """A console whose lines are shown by the one output of a `NotebookLive`."""

    def __init__(self) -> None:
        self.lines = io.StringIO()
        super().__init__(
            file=self.lines,
            force_terminal=True,
            force_jupyter=False,
            color_system=None,
            highlight=False,
            width=_WIDTH,
            legacy_windows=False,
        )


class NotebookLive:
    """Shows what is drawn last, with the last lines above it; it stands in for `rich.live.Live`.

    Args:
        console: Takes the lines.
    """

    def __init__(self, console: NotebookConsole) -> None:
        self.console = console
        self.is_started = False
        self._handle: Any = None
        self._drawn: RenderableType = ""
        self._shown_at = -_REFRESH_SECONDS

    def start(self) -> None:
        """Open the output."""
        from IPython.display import display

        self.is_started = True
        self._handle = display(self._bundle(), raw=True, display_id=True)  # type: ignore[no-untyped-call]

    def update(self, drawn: RenderableType, *, refresh: bool = True) -> None:
        """Draw anew, where the last drawing is long enough ago."""
        self._drawn = drawn
        if refresh and time.monotonic() - self._shown_at >= _REFRESH_SECONDS:
            self._show()

    def stop(self) -> None:
        """Draw the last time."""
        self._show()
        self.is_started = False

    def _show(self) -> None:
        self._shown_at = time.monotonic()
        self._handle.update(self._bundle(), raw=True)

    def _bundle(self) -> dict[str, str]:
        news = self.console.lines.getvalue().splitlines()[-_LINES:]
        with self.console.capture() as captured:
            self.console.print(self._drawn)
        text = "\n".join([*news, captured.get().rstrip()]).strip("\n")
        # Without a wrap of its own a notebook breaks a table's lines.
        return {"text/plain": text, "text/html": f'<pre style="line-height: 1.2">{escape(text)}</pre>'}
