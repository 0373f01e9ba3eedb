"""The page of a run without a verdict: what there is so far, and that nothing has tested it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ge_torchrl.artefacts.episodes import CHAMPION
from ge_torchrl.artefacts.folder import CONFIG
from ge_torchrl.reading import read_text
from ge_torchrl.report.html.figures import number, seconds
from ge_torchrl.report.html.parts import (
    COMMAND,
    command_markup,
    facts_markup,
    going_on_markup,
    rule_text,
    verdict_markup,
)
from ge_torchrl.report.html.progress import progress_values
from ge_torchrl.report.html.template import Markup, element, filled, table
from ge_torchrl.report.html.trees import environment_values, tree_values
from ge_torchrl.report.tables import counted
from ge_torchrl.report.unfinished import FAILED, RUNNING, STOPPED, UnfinishedRun, archive_mean
from ge_torchrl.trees.complexity import complexity
from ge_torchrl.version import __version__

_BADGES = {
    RUNNING: ("open", "Still running"),
    FAILED: ("unsolved", "Broke off"),
    STOPPED: ("unsolved", "Interrupted"),
}


def unfinished_page(run: UnfinishedRun, scripts: tuple[str, ...]) -> str:
    """Return the page of a run that goes on or was broken off.

    Args:
        run: What it has left so far.
        scripts: Those of a run's page.
    """
    return filled("run.html", scripts, unfinished_values(run), _texts(run))


def unfinished_values(run: UnfinishedRun) -> dict[str, Any]:
    """Return what the script of the page reads."""
    return {
        "environment": environment_values(run.best.names),
        "isTested": False,
        "solvedAt": run.config.env.solved_at,
        "trees": list(_trees(run)),
        "episodes": [],
        "stepSeconds": None,
        "returns": [],
        "progress": progress_values(run),
        "known": [],
    }


def _trees(run: UnfinishedRun) -> Iterator[dict[str, Any]]:
    """Yield the best tree so far, and the best tree of each size where it is another one."""
    kept = {one.tree: archive_mean(one) for one in run.archive}
    nodes = run.best.tree.num_decision_nodes
    yield {
        "key": CHAMPION,
        "title": f"best so far, {counted(nodes, 'node')}",
        **tree_values(run.best, None),
        "measured": _measured(kept.get(run.best.tree)),
    }
    for one in run.archive:
        if one.tree != run.best.tree:
            nodes = one.tree.num_decision_nodes
            yield {
                "key": str(nodes),
                "title": f"best with {counted(nodes, 'node')}",
                **tree_values(one, None),
                "measured": _measured(archive_mean(one)),
            }


def _measured(mean: float | None) -> dict[str, float] | None:
    return None if mean is None else {"mean": mean}


def _texts(run: UnfinishedRun) -> dict[str, str]:
    kind, word = _BADGES[run.state]
    last = run.history[-1]
    return {
        "title": f"{run.environment}, seed {run.config.seed}: {word.lower()}",
        "environment": run.environment,
        "verdict": verdict_markup(kind, word, _told(run)),
        "facts": facts_markup(_facts(run)),
        "warnings": going_on_markup() if run.can_go_on else Markup(""),
        "rule_text": rule_text(run.path),
        "command": command_markup(COMMAND),
        "settings": table(("setting", "value"), [*_settings(run)], caption="What the run was given"),
        "costs": table(
            ("steps of the environment", "steps"),
            [(f"until generation {last.generation}", f"{last.env_steps:,}")],
            caption="What the run took so far",
        ),
        "config": read_text(run.path / CONFIG),
        "version": __version__,
    }


def _told(run: UnfinishedRun) -> Iterator[str]:
    fault = f" by {run.fault}" if run.fault else ""
    yield f"after {len(run.history)} of {counted(run.config.ge.generations, 'generation')}{fault}; "
    yield element("strong", "not tested")
    yield "."
    if run.train_fitness is not None:
        yield " The best tree so far has a fitness of "
        yield element("strong", number(run.train_fitness), data_figure="train_fitness")
        yield f" on its {counted(run.config.evaluation.episodes, 'training episode')}."


def _facts(run: UnfinishedRun) -> Iterator[tuple[str, str, str]]:
    tree = run.best.tree
    yield "decision nodes", str(tree.num_decision_nodes), "decision_nodes"
    yield "depth", str(tree.depth), "depth"
    yield "complexity M", f"{complexity(tree).M:g}", "complexity_M"
    yield "method so far", run.done, "method"
    yield "seed", str(run.config.seed), "seed"
    yield "generations so far", str(len(run.history)), "generations"
    yield "took so far", seconds(run.history[-1].elapsed_seconds), "elapsed_seconds"


def _settings(run: UnfinishedRun) -> Iterator[tuple[str, str]]:
    config, last = run.config, run.history[-1]
    yield "grammar", config.grammar.name
    yield "population", f"{config.ge.population_size:,}"
    yield "generations", f"{config.ge.generations}"
    yield "training episodes", f"{config.evaluation.episodes:,}"
    if last.refined:
        yield "refined so far", f"{last.refined:,}"
    if last.polished:
        yield "polished so far", f"{last.polished:,}"
