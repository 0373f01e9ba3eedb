"""The page of a study."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ge_torchrl.artefacts.folder import PAGE
from ge_torchrl.artefacts.texts import write_text
from ge_torchrl.report.html.figures import number
from ge_torchrl.report.html.template import Markup, element, filled, joined, table
from ge_torchrl.report.tables import counted
from ge_torchrl.tuning.drawings import history, slices
from ge_torchrl.tuning.findings import COMPLETE, ENDED, FAILED, Findings, Tried
from ge_torchrl.tuning.preset import comparing_commands, preset_command
from ge_torchrl.tuning.space import shown
from ge_torchrl.version import __version__

UNSEEN = "range(1000,1020)"
"""Seeds to compare on; no trial has one below 2^32."""
# Settings are drawn one by one, those that mattered most.
_DRAWN = 6


def write_page(folder: Path, findings: Findings, name: str) -> Path:
    """Write the page of a study into its folder, and return its path.

    Args:
        folder: Of the study.
        findings: What its trials say.
        name: What the study is called.

    Raises:
        ArtefactError: The page cannot be written.
    """
    path = folder / PAGE
    write_text(path, tuning_page(folder, findings, name))
    return path


def tuning_page(folder: Path, findings: Findings, name: str) -> str:
    """Return the page; see `write_page`."""
    environment = findings.task.config.env.id
    values = {
        "title": f"{environment}: {counted(len(findings.tried), 'trial')}",
        "name": environment,
        "verdict": element("p", verdict(findings), class_="verdict"),
        "facts": joined(
            element("div", joined([element("dt", what), element("dd", value)]))
            for what, value in _facts(findings)
        ),
        "history": history(findings),
        "settings": _settings(findings),
        "importances": _importances(findings),
        "commands": _commands(folder, findings, name),
        "trials": _trials(findings),
        "version": __version__,
    }
    return filled("tuning.html", (), {}, values)


def verdict(findings: Findings) -> str:
    """Return in a sentence what the study found."""
    best, untuned = findings.best, findings.untuned
    if best is None:
        return "No trial has come to its end."
    if untuned is None:
        return (
            f"The best trial so far is {best.number}, with a mean return of {number(best.value)}; the settings as they "
            "stand have not come to their end."
        )
    if not findings.is_better:
        return f"No trial did better than the settings as they stand, with a mean return of {number(untuned.value)}."
    return (
        f"Trial {best.number} did best: a mean return of {number(best.value)} over "
        f"{counted(findings.task.runs, 'run')}, beside {number(untuned.value)} of the settings as they stand."
    )


def _facts(findings: Findings) -> Iterator[tuple[str, str]]:
    task = findings.task
    yield "trials", str(len(findings.tried))
    yield "with all runs", str(findings.count(COMPLETE))
    yield "ended early", str(findings.count(ENDED))
    if failed := findings.count(FAILED):
        yield "failed", str(failed)
    if findings.begun_again:
        yield "died, and begun again", str(findings.begun_again)
    yield "runs of a trial", str(task.runs)
    yield "a run takes at most", task.limit
    yield "settings tuned", str(len(task.space))
    yield "seed", str(task.config.seed)


def _settings(findings: Findings) -> Markup:
    best = findings.best
    rows = []
    for one in findings.task.space:
        found = "" if best is None else shown(best.values[one.key])
        found = found if found != shown(one.untuned) else "as it stands"
        tried = one.allowed.replace("..", " to ").replace(",", ", ")
        rows.append([one.key, shown(one.untuned), found, tried + (", by factors" if one.is_log else "")])
    lead = "The best of many trials is partly lucky: what it is worth shows on seeds that it has not seen."
    return joined(
        [element("p", lead, class_="lead"), table(("setting", "as it stands", "best trial", "tried"), rows)]
    )


def _importances(findings: Findings) -> Markup:
    if not findings.importances:
        return element("p", "Too few trials have come to the end of a run to tell.", class_="lead")
    largest = max(findings.importances.values()) or 1.0
    n_first = sum(bool(one.returns) for one in findings.tried)
    parts: list[str] = []
    for key, share in findings.importances.items():
        bar = element("i", "", style=f"width:{100 * share / largest:.1f}%")
        parts += [element("span", key), element("div", bar, class_="share"), element("span", f"{share:.0%}")]
    lead = (
        "Each setting's share in what tells the best first runs from all others, by PED-ANOVA over the "
        f"{n_first} trials that came to the end of a first run. Of so few, one without effect may have a share too."
    )
    return joined(
        [
            element("p", lead, class_="lead"),
            element("div", joined(parts), class_="card shares"),
            element("p", "What trials returned over the values of those that mattered most:", class_="note"),
            slices(findings, list(findings.importances)[:_DRAWN]),
        ]
    )


def _commands(folder: Path, findings: Findings, name: str) -> Markup:
    if not findings.is_better:
        return element("p", "There is nothing to use: the settings stay as they stand.", class_="lead")
    compared = comparing_commands(folder, findings.task, name, UNSEEN)
    return joined(
        [
            element("p", "A run with the best settings, from where the study was started:", class_="lead"),
            element("pre", preset_command(folder, findings.task, name), class_="command"),
            element("p", "Both settings on the same seeds, none of which any trial had:", class_="lead"),
            element("pre", "\n".join(compared), class_="command"),
        ]
    )


def _trials(findings: Findings) -> Markup:
    keys = [one.key for one in findings.task.space]
    rows = [[*_cells(one, keys, is_best=one is findings.best)] for one in findings.tried]
    short = [key.rpartition(".")[2] if _is_alone(key, keys) else key for key in keys]
    return table(("trial", "state", "mean return", "runs", "nodes", *short), rows)


def _is_alone(key: str, keys: list[str]) -> bool:
    name = key.rpartition(".")[2]
    return sum(other.rpartition(".")[2] == name for other in keys) == 1


def _cells(one: Tried, keys: list[str], *, is_best: bool) -> Iterator[str]:
    badges = [("best", "solved")] if is_best else []
    badges += [("untuned", "open")] if one.is_untuned else []
    told = [element("span", text, class_=f"badge {kind}") for text, kind in badges]
    yield joined([f"{one.number} ", *told])
    yield f"{one.state}: {one.fault}" if one.fault else one.state.replace(" ", "\u00a0")
    yield number(one.value)
    yield str(len(one.returns))
    least_and_most = dict.fromkeys((min(one.nodes), max(one.nodes))) if one.nodes else ()
    yield "\u00a0to\u00a0".join(map(str, least_and_most))
    for key in keys:
        yield shown(one.values[key])
