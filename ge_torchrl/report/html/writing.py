"""Pages are written beside the artefacts that they show."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from ge_torchrl.artefacts.folder import PAGE, RunFolder
from ge_torchrl.artefacts.texts import write_text
from ge_torchrl.errors import UserError
from ge_torchrl.report.html.run_page import SCRIPTS, run_page
from ge_torchrl.report.html.sweep_page import sweep_page
from ge_torchrl.report.html.unfinished_page import unfinished_page
from ge_torchrl.report.jobs import unfinished_jobs
from ge_torchrl.report.measuring import Told, tell_nobody
from ge_torchrl.report.runs import FoundRuns, Run
from ge_torchrl.report.unfinished import is_unfinished, read_unfinished


def write_run_page(path: Path, run: Run | None = None) -> Path:
    """Write the page of a run into its folder and return its path; of one without a verdict what there is so far.

    Args:
        path: The folder.
        run: The run, where it is read already.

    Raises:
        ArtefactError: A file is missing or unreadable, or the page cannot be written.
        ConfigError: The configuration is none.
        InvalidTreeError: A tree's file holds no valid tree.
    """
    page = path / PAGE
    if run is None and is_unfinished(path):
        write_text(page, unfinished_page(read_unfinished(path), SCRIPTS))
        if is_unfinished(path):
            return page
        # It came to its end meanwhile, and its own page may have been written over.
    write_text(page, run_page(RunFolder(path), run))
    return page


def write_sweep_page(folder: Path, found: FoundRuns) -> Path:
    """Write the page of a sweep into its folder and return its path.

    Args:
        folder: The folder that the runs lie in.
        found: Its finished runs.

    Raises:
        ArtefactError: The page cannot be written.
    """
    page = folder / PAGE
    write_text(page, sweep_page(folder, found))
    return page


class Pages(NamedTuple):
    """What was written.

    Attributes:
        written: The page of the folder itself; None where it could not be written.
        failed: For every page that could not be written one line that says why.
    """

    written: Path | None
    failed: tuple[str, ...]


def write_pages(folder: Path, found: FoundRuns, told: Told = tell_nobody) -> Pages:
    """Write the page of every run, also of one that goes on or broke off, and that of the folder where it is no run.

    Args:
        folder: A run's or a sweep's folder, or any above them.
        found: Its finished runs.
        told: Is told for how many runs that is done.
    """
    failed: list[str] = []
    written: list[Path] = []
    for number, run in enumerate(found.runs, 1):
        try:
            written.append(write_run_page(run.path, run))
        except UserError as error:
            failed.append(" ".join(str(error).split()))
        told(number, len(found.runs))
    for job in unfinished_jobs(folder):
        # What has no tree yet has no page, and is told of on the page of the sweep.
        with suppress(UserError):
            if job.path is not None and is_unfinished(job.path):
                write_run_page(job.path)
    if [run.path for run in found.runs] == [folder]:
        return Pages(written[0] if written else None, tuple(failed))
    try:
        return Pages(write_sweep_page(folder, found), tuple(failed))
    except UserError as error:
        return Pages(None, (*failed, " ".join(str(error).split())))
