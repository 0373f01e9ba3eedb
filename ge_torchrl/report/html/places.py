"""What the runs of a sweep are called on its page, and where their pages are."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

from ge_torchrl.artefacts.folder import PAGE
from ge_torchrl.report.html.template import Markup, element, joined
from ge_torchrl.report.runs import Run

# The folder of a job, "3_env=cartpole,seed=3", wherever it lies: its number comes first.
_JOB = re.compile(r"((?:^|.*/)\d+)_[^/]*")
_BREAKS = re.compile(r"(?<=[,/])")


def name_below(run: Path, folder: Path) -> str:
    """Return the folder of a run as the sweep's page names it."""
    is_below = run != folder and run.is_relative_to(folder)
    return run.relative_to(folder).as_posix() if is_below else run.name


def short_names(runs: Sequence[Run], folder: Path) -> dict[Path, str]:
    """Return what tells the folders of runs apart: of a job its number alone, since its settings have columns."""
    names = {run.path: name_below(run.path, folder) for run in runs}
    short = {path: _JOB.sub(r"\1", name) for path, name in names.items()}
    return short if len(set(short.values())) == len(short) else names


def page_of(run: Path, folder: Path) -> str | None:
    """Return the address of a run's page from the sweep's; None where it has none."""
    page = run / PAGE
    if run == folder or not page.exists() or not page.is_relative_to(folder):
        return None
    return quote(page.relative_to(folder).as_posix())


def named(name: str, link: str | None) -> Markup:
    """Return a job's name, which breaks behind its commas and slashes."""
    parts = [part for piece in _BREAKS.split(name) for part in (piece, Markup("<wbr>"))]
    return element("a" if link else "span", joined(parts[:-1]), class_="job", href=link)
