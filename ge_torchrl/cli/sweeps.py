"""The end of a sweep: its page is written beside the folders of its runs."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

_folders: list[Path] = []


class SweepFolder:
    """Remembers where a sweep leaves its runs: Hydra calls it, as `hydra.callbacks` of conf/config.yaml names it."""

    def on_multirun_start(self, config: Any, **_: object) -> None:
        """Remember the folder of the sweep that begins."""
        _folders[:] = [Path(str(config.hydra.sweep.dir))]

    def on_run_start(self, **_: object) -> None:
        """Forget a sweep that was broken off, since a single run begins."""
        _folders.clear()

    def __getattr__(self, name: str) -> Callable[..., None]:
        if not name.startswith("on_"):
            raise AttributeError(name)
        return _nothing


def _nothing(**_: object) -> None:
    pass


def write_page_of_sweep() -> None:
    """Write the page of the sweep that began last; what fails is told in one line, and fails nothing."""
    while _folders:
        folder = _folders.pop()
        try:
            from ge_torchrl.artefacts.folder import find_runs

            if next(find_runs(folder), None) is None:
                continue  # What became of the jobs is told already.
            from ge_torchrl.report.html.writing import write_sweep_page
            from ge_torchrl.report.runs import read_runs

            print(f"\nthe runs side by side: {write_sweep_page(folder, read_runs(folder))}")
        except Exception as error:  # noqa: BLE001 - the runs are complete without it.
            print(f"ge-torchrl: no page of the sweep: {' '.join(str(error).split())}", file=sys.stderr)
