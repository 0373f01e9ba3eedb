"""The two ends of a sweep: its jobs are written down when it begins, and its page when it is over."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ge_torchrl.artefacts.jobs import Sweep, write_sweep
from ge_torchrl.errors import ArtefactError

_folders: list[Path] = []
_announced: list[Sweep] = []


def announce(sweep: Sweep) -> None:
    """Tell which jobs the sweep will have that is about to begin."""
    _announced[:] = [sweep]


def begin(folder: Path) -> None:
    """Begin the sweep in a folder: its jobs are written there, if that can be."""
    _folders[:] = [folder]
    for sweep in _announced:
        with suppress(ArtefactError):  # The first run tells of a folder that cannot be written.
            write_sweep(folder, sweep)


class SweepFolder:
    """Remembers where a sweep leaves its runs: Hydra calls it, as `hydra.callbacks` of conf/config.yaml names it."""

    def on_multirun_start(self, config: Any, **_: object) -> None:
        """Remember the folder of the sweep that begins, and write its jobs there."""
        begin(Path(str(config.hydra.sweep.dir)))

    def on_run_start(self, **_: object) -> None:
        """Forget a sweep that was broken off, since a single run begins."""
        _folders.clear()

    def __getattr__(self, name: str) -> Callable[..., None]:
        if not name.startswith("on_"):
            raise AttributeError(name)
        return _nothing


def _nothing(**_: object) -> None:
    pass


@contextmanager
def page_of_sweep() -> Iterator[None]:
    """Write the page of the sweep that runs meanwhile; where that ends too early, of the runs that finished.

    What fails is told in one line, and fails nothing. Ctrl-C leaves the page unwritten.
    """
    try:
        yield
    except KeyboardInterrupt as pressed:
        if _write("interrupted; the runs that finished, side by side"):
            raise KeyboardInterrupt("it is told") from pressed
        raise
    except BaseException:
        _write("the runs that finished, side by side")
        raise
    _write("the runs side by side")


def _write(told: str) -> bool:
    """Write the page, if there is a sweep with a finished run, and tell of it; return whether something was told."""
    if not _folders:
        return False
    folder = _folders.pop()
    try:
        from ge_torchrl.artefacts.folder import find_runs

        if next(find_runs(folder), None) is None:
            return False  # What became of the jobs is told already.
        from ge_torchrl.report.html.writing import write_sweep_page
        from ge_torchrl.report.runs import read_runs

        print(f"\n{told}: {write_sweep_page(folder, read_runs(folder))}")
    except KeyboardInterrupt:
        print("ge-torchrl: interrupted; no page of the sweep", file=sys.stderr)
        raise KeyboardInterrupt("it is told") from None
    except Exception as error:  # noqa: BLE001 - the runs are complete without it.
        print(f"ge-torchrl: no page of the sweep: {' '.join(str(error).split())}", file=sys.stderr)
    return True
