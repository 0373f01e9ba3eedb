"""The closing words of a run: what was found, how good it is, where it lies."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

from ge_torchrl.artefacts.checkpoints import has_checkpoints
from ge_torchrl.artefacts.folder import PAGE
from ge_torchrl.artefacts.records import ArchiveRecord, Summary
from ge_torchrl.report.evaluated import verdict
from ge_torchrl.report.sizes import by_size, sizes_table, trees_of_archive
from ge_torchrl.report.tables import counted
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.text import clipping_text, render_rules, render_text

_CHAMPION_FROM = {
    "population": "the champion is from the population",
    "refinement": "the champion is a refined tree",
    "polish": "the champion is a polished tree",
    "start": "the champion grew from a dense start",
}


def tree_text(controller: Controller) -> str:
    """Return a tree for a person: drawn, then as rules."""
    parts = (drawn(controller), render_rules(controller.tree, controller.names))
    return "\n\n".join(parts) + "\n"


def drawn(controller: Controller) -> str:
    """Return a tree drawn, with a line below it where its leaves may answer what lies outside the action's bounds."""
    tree, names = controller.tree, controller.names
    told = clipping_text(tree, names)
    return "\n".join([render_text(tree, names), *([told] if told else [])])


def closing_text(
    summary: Summary,
    controller: Controller,
    shown_path: Path,
    archive: Sequence[ArchiveRecord] = (),
    refiner: str = "refinement",
    *,
    improved: int | None = None,
    once_more: str = "",
    width: int | None = None,
) -> str:
    """Return the closing summary of a run.

    Args:
        summary: What was found.
        controller: The pruned champion.
        shown_path: The run folder, as the user is to read it.
        archive: The best tree of each size; empty where the run kept none.
        refiner: What refined trees, such as "PPO".
        improved: How many of the refined trees became better; None where nobody counted.
        once_more: What the last refinement changed; empty where there was none.
        width: Of the terminal; None where lines may be of any length.
    """
    nodes = counted(summary.decision_nodes, "decision node")
    rows = [
        *([] if summary.stopped_by == "generations" else [("stopped by", summary.stopped_by)]),
        ("training", f"{summary.train_fitness:.2f}  the champion's fitness on its training episodes"),
        ("validation", f"{summary.validation_mean:.2f}  on the episodes that chose it"),
        (
            "test",
            f"{summary.test_mean:.2f} ± {summary.test_std:.2f}  on {summary.test_episodes:,} unseen episodes",
        ),
        ("verdict", verdict(summary.solved, summary.solved_at)),
        ("size", f"{nodes}, depth {summary.depth}, M = {summary.complexity_M:g}"),
        (
            "effort",
            (
                f"{counted(summary.generations, 'generation')}, {summary.env_steps_total:,} steps of the environment, "
                f"{summary.evolve_seconds:.1f} s of search, {summary.wall_seconds:.1f} s in all"
            ),
        ),
        *_refinement_rows(summary, refiner, improved),
        *([("once more", once_more)] if once_more else []),
        *(("warning", warning) for warning in summary.warnings),
        ("run folder", str(shown_path)),
        *([("page", str(shown_path / PAGE))] if (shown_path / PAGE).exists() else []),
        *([("to go on", f"ge-torchrl resume {shown_path}")] if has_checkpoints(shown_path) else []),
    ]
    sizes = by_size(trees_of_archive(archive, summary.seed, summary.decision_nodes))
    parts = [
        drawn(controller),
        *([sizes_table(sizes).aligned()] if sizes else []),
        "\n".join(_row(name, text, width) for name, text in rows),
    ]
    return "\n\n".join(parts)


def _row(name: str, text: str, width: int | None) -> str:
    """Return a row, broken between words where it is wider than the terminal; what has no blanks stays whole."""
    row = f"{name:<11} {text}"
    if width is None or len(row) <= width:
        return row
    return textwrap.fill(
        row, width, subsequent_indent=" " * 12, break_long_words=False, break_on_hyphens=False
    )


def _refinement_rows(summary: Summary, refiner: str, improved: int | None) -> list[tuple[str, str]]:
    """Return what was refined and polished, and whether the champion came of it."""
    rows = []
    if summary.refined:
        told = f"{counted(summary.refined, 'tree')} refined in {summary.refine_seconds:.1f} s"
        rows.append((refiner, told if improved is None else f"{told}, {improved:,} of them improved"))
    if summary.polished:
        rows.append(
            ("polish", f"{counted(summary.polished, 'tree')} polished in {summary.polish_seconds:.1f} s")
        )
    if rows and summary.champion_from in _CHAMPION_FROM:
        name, told = rows[-1]
        rows[-1] = (name, f"{told}; {_CHAMPION_FROM[summary.champion_from]}")
    return rows
