"""The page of a run."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from ge_torchrl.artefacts.checkpoints import has_checkpoints
from ge_torchrl.artefacts.episodes import CHAMPION, FULL, Episodes
from ge_torchrl.artefacts.folder import CONFIG, RunFolder
from ge_torchrl.artefacts.records import Summary
from ge_torchrl.reading import read_text
from ge_torchrl.report.html.episodes import episode_values
from ge_torchrl.report.html.figures import mean_interval, number, seconds, short_count
from ge_torchrl.report.html.known import known_of, step_seconds_of
from ge_torchrl.report.html.parts import (
    COMMAND,
    command_markup,
    facts_markup,
    going_on_markup,
    rule_text,
    verdict_markup,
)
from ge_torchrl.report.html.progress import progress_values
from ge_torchrl.report.html.template import Markup, element, filled, joined, table
from ge_torchrl.report.html.trees import environment_values, tree_values
from ge_torchrl.report.methods import refiner_of
from ge_torchrl.report.runs import Run, read_run
from ge_torchrl.report.tables import counted
from ge_torchrl.version import __version__

SCRIPTS = (
    "core.js",
    "tree.js",
    "scenes.js",
    "player.js",
    "strips.js",
    "partition.js",
    "charts.js",
    "again.js",
    "run.js",
)


def run_page(folder: RunFolder, run: Run | None = None) -> str:
    """Return the page of a finished run.

    Args:
        folder: Its folder; what an earlier version did not write is left out of the page.
        run: The run, where it is read already.

    Raises:
        ArtefactError: A file is missing or unreadable.
        ConfigError: The configuration is none.
        InvalidTreeError: A tree's file holds no valid tree.
    """
    run, episodes = run or read_run(folder.path), folder.read_episodes()
    return filled("run.html", SCRIPTS, run_values(folder, run, episodes), _texts(folder, run))


def run_values(folder: RunFolder, run: Run, episodes: Episodes | None) -> dict[str, Any]:
    """Return what the script of the page reads."""
    summary, names = run.summary, run.pruned.names
    return {
        "environment": environment_values(names),
        "isTested": True,
        "solvedAt": summary.solved_at,
        "trees": list(_trees(folder, run, episodes)),
        "episodes": episode_values(episodes),
        "stepSeconds": (episodes.step_seconds if episodes else None) or step_seconds_of(names),
        "returns": [] if episodes is None else [_plain(value) for value in episodes.returns.tolist()],
        "progress": progress_values(run),
        "known": known_of(names),
    }


def _trees(folder: RunFolder, run: Run, episodes: Episodes | None) -> Iterator[dict[str, Any]]:
    """Yield the champion, the champion unpruned where that is another tree, and the best tree of each other size."""
    visits, summary = {} if episodes is None else episodes.visits, run.summary
    test = _measured(summary.test_mean, summary.test_std, summary.test_episodes)
    yield {
        "key": CHAMPION,
        "title": f"champion, {counted(summary.decision_nodes, 'node')}",
        **tree_values(run.pruned, visits.get(CHAMPION)),
        "measured": test,
    }
    if run.full.tree != run.pruned.tree:
        nodes = run.full.tree.num_decision_nodes
        yield {
            "key": FULL,
            "title": f"champion unpruned, {counted(nodes, 'node')}",
            **tree_values(run.full, visits.get(FULL)),
            "measured": {"mean": summary.test_mean_full},
        }
    for record in run.archive:
        if record.decision_nodes == summary.decision_nodes:
            continue
        key = str(record.decision_nodes)
        controller = folder.read_archive_tree(record.decision_nodes)
        yield {
            "key": key,
            "title": f"best with {counted(record.decision_nodes, 'node')}",
            **tree_values(controller, visits.get(key)),
            "measured": _measured(record.test_mean, record.test_std, summary.test_episodes),
        }


def _measured(mean: float | None, sd: float | None, n: int) -> dict[str, float] | None:
    if mean is None or sd is None:
        return None
    interval = mean_interval(mean, sd, n)
    ends = {} if interval is None else {"low": interval.low, "high": interval.high}
    return {"mean": mean, "sd": sd, **ends}


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _texts(folder: RunFolder, run: Run) -> dict[str, str]:
    summary = run.summary
    return {
        "title": f"{run.environment}, seed {run.seed}",
        "environment": run.environment,
        "verdict": _verdict(summary),
        "facts": _facts(run),
        "warnings": joined([*_going_on(run), *_warnings(summary)]),
        "rule_text": rule_text(folder.path),
        "command": command_markup(COMMAND),
        "settings": table(("setting", "value"), [*_settings(run)], caption="What the run was given"),
        "costs": table(
            ("steps of the environment for", "steps"),
            [(purpose, f"{steps:,}") for purpose, steps in sorted(summary.steps.items(), key=_by_steps)]
            + [("all", f"{summary.env_steps_total:,}")],
            caption="What the run took",
        ),
        "config": read_text(folder.path / CONFIG),
        "version": __version__,
    }


def _going_on(run: Run) -> Iterator[Markup]:
    """Yield that an interrupted run was tested as it stood, and how it goes on."""
    summary = run.summary
    if summary.stopped_by == "interrupt":
        of = f"{summary.generations} of {counted(run.config.ge.generations, 'generation')}"
        yield element("p", f"Interrupted after {of}, and tested as it stood then.", class_="note")
        if has_checkpoints(run.path):
            yield going_on_markup()


def _warnings(summary: Summary) -> Iterator[Markup]:
    for warning in summary.warnings:
        yield element("p", f"Warning: {warning}", class_="note")


def _by_steps(entry: tuple[str, int]) -> int:
    return -entry[1]


def _verdict(summary: Summary) -> Markup:
    """Return the one line that says how good the controller is."""
    state, word = {
        True: ("solved", "Solved"),
        False: ("unsolved", "Not solved"),
        None: ("open", "No threshold"),
    }[summary.solved]
    interval = mean_interval(summary.test_mean, summary.test_std, summary.test_episodes)
    about = f" over {counted(summary.test_episodes, 'unseen episode')}"
    if interval is not None and summary.test_std > 0:
        about = f" ({number(interval.low)} to {number(interval.high)}, 95 % interval){about}"
    elif interval is not None:
        about += ", the same in each"
    if summary.solved_at is not None:
        about += f"; solved from {summary.solved_at:g}".replace("-", "\u2212")
    mean = element("strong", number(summary.test_mean), data_figure="test_mean")
    return verdict_markup(state, word, ["mean return ", mean, about, "."])


def _facts(run: Run) -> Markup:
    summary = run.summary
    unpruned = summary.test_mean_full != summary.test_mean
    facts = [
        ("decision nodes", str(summary.decision_nodes), "decision_nodes"),
        ("depth", str(summary.depth), "depth"),
        ("complexity M", f"{summary.complexity_M:g}", "complexity_M"),
        ("spread of a return", f"± {number(summary.test_std)}", "test_std"),
        *([("unpruned", number(summary.test_mean_full), "test_mean_full")] if unpruned else []),
        ("method", run.done, "method"),
        ("seed", str(summary.seed), "seed"),
        ("generations", str(summary.generations), "generations"),
        ("took", seconds(summary.wall_seconds), "wall_seconds"),
    ]
    return facts_markup(facts)


def _settings(run: Run) -> Iterator[tuple[str, str]]:
    config, summary = run.config, run.summary
    yield "method", run.done
    yield "grammar", config.grammar.name
    yield "population", f"{config.ge.population_size:,}"
    stopped = "" if summary.stopped_by == "generations" else f", stopped by {summary.stopped_by}"
    yield "generations", f"{summary.generations} of {config.ge.generations}{stopped}"
    yield "training episodes", f"{config.evaluation.episodes:,}"
    yield "validation episodes", f"{config.evaluation.validation_episodes:,}"
    yield "test episodes", f"{summary.test_episodes:,}"
    yield "champion in training", number(summary.train_fitness)
    yield "champion in validation", number(summary.validation_mean)
    if summary.refined:
        improved = f", {summary.refinements_improved} of {summary.refinements} individuals improved"
        yield f"refined by {refiner_of(run.method)}", f"{summary.refined:,}{improved}"
    if summary.polished:
        yield "polished", f"{summary.polished:,}"
    yield "stepped by", f"{summary.route}, {short_count(round(summary.steps_per_second))} steps a second"
    yield "version", f"ge_torchrl {summary.version}"
