"""The closing words of a run and of an evaluation: what was found, how good it is, where it lies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from ge_torchrl.artefacts import RunFolder
from ge_torchrl.errors import UserError
from ge_torchrl.records import HallOfFameRecord, Summary
from ge_torchrl.report.methods import method_of, refiner_of
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.labels import TreeLabels
from ge_torchrl.trees.rendering import render_rules, render_text


@dataclass(frozen=True)
class EvaluationSummary:
    """What a tree did on test episodes.

    Attributes:
        environment: Gymnasium id.
        mean: Mean return.
        std: Standard deviation of the returns.
        min: Lowest return.
        max: Highest return.
        episodes: Number of episodes.
        seed: Episode `i` began with `reset(seed=seed + i)`.
        solved: Whether the mean reaches the threshold; None where there is none.
        solved_at: The threshold, or None.
        route: "compiled" or "gymnasium".
        decision_nodes: Size of the tree.
    """

    environment: str
    mean: float
    std: float
    min: float
    max: float
    episodes: int
    seed: int
    solved: bool | None
    solved_at: float | None
    route: str
    decision_nodes: int

    def as_dict(self) -> Mapping[str, object]:
        """Return plain values for JSON."""
        return asdict(self)

    def as_text(self) -> str:
        """Return the lines for a person."""
        last = self.seed + self.episodes - 1
        return (
            f"{self.environment}: mean return {self.mean:.3f} ± {self.std:.3f} "
            f"(min {self.min:g}, max {self.max:g}) over {self.episodes} episodes\n"
            f"seeds {self.seed} to {last}, {self.route} route, {self.decision_nodes} decision nodes\n"
            f"{verdict(self.solved, self.solved_at)}"
        )


def verdict(solved: bool | None, solved_at: float | None) -> str:
    """Return whether the task is solved, in words."""
    if solved is None or solved_at is None:
        return "no threshold is agreed on for this environment"
    return f"{'SOLVED' if solved else 'not solved'}: the threshold is a mean return of {solved_at:g}"


def tree_text(tree: DecisionTree, labels: TreeLabels) -> str:
    """Return a tree for a person: drawn, then as rules."""
    return f"{render_text(tree, labels)}\n\n{render_rules(tree, labels)}\n"


def closing_text(
    summary: Summary,
    tree: DecisionTree,
    labels: TreeLabels,
    folder: Path,
    hall_of_fame: Sequence[HallOfFameRecord] = (),
) -> str:
    """Return the closing summary of a run.

    Args:
        summary: What was found.
        tree: The pruned champion.
        labels: Names of features and actions.
        folder: The run folder, whose configuration tells by which method trees were refined.
        hall_of_fame: The best tree of each size; empty where the run kept none.
    """
    nodes = "1 decision node" if summary.decision_nodes == 1 else f"{summary.decision_nodes} decision nodes"
    rows = [
        ("training", f"{summary.train_fitness:.2f}  the champion's fitness on its training episodes"),
        ("validation", f"{summary.validation_mean:.2f}  on the episodes that chose it"),
        (
            "test",
            f"{summary.test_mean:.2f} ± {summary.test_std:.2f}  on {summary.test_episodes} unseen episodes",
        ),
        ("verdict", verdict(summary.solved, summary.solved_at)),
        ("size", f"{nodes}, depth {summary.depth}, M = {summary.complexity_M:g}"),
        (
            "effort",
            (
                f"{summary.generations} generations, {summary.env_steps:,} steps of the environment "
                f"in {summary.evolve_seconds:.1f} s of evolution, {summary.wall_seconds:.1f} s in all"
            ),
        ),
        ("run folder", str(folder)),
    ]
    rows[-1:-1] = _refinement_rows(summary, folder)
    if summary.stopped_by != "generations":
        rows.insert(0, ("stopped by", summary.stopped_by))
    table = "\n".join(f"{name:<11} {text}" for name, text in rows)
    best_by_size = f"{_best_by_size(hall_of_fame, summary)}\n\n" if hall_of_fame else ""
    return f"{render_text(tree, labels)}\n\n{best_by_size}{table}"


def _refinement_rows(summary: Summary, folder: Path) -> list[tuple[str, str]]:
    """Return what was refined, in the population and in exploring from the hall of fame."""
    rows = []
    if summary.refinements:
        told = f"{summary.refinements_improved} of {summary.refinements} refinements improved their tree"
        champion = {
            "refinement": "the champion is a refined tree, ",
            "population": "the champion is from the population, ",
        }.get(summary.champion_from, "")
        rows.append((_refiner(folder), f"{told}, {champion}{summary.refine_seconds:.1f} s"))
    if summary.explored:
        champion = "the champion is one of them, " if summary.champion_from == "neighbour" else ""
        trees = "1 tree" if summary.explored == 1 else f"{summary.explored:,} trees"
        told = f"{trees} refined from the hall of fame"
        rows.append(("exploring", f"{told}, {champion}{summary.explore_seconds:.1f} s"))
    return rows


def _refiner(folder: Path) -> str:
    """Return by which method the trees of a run were refined."""
    try:
        return refiner_of(method_of(RunFolder(folder).read_config()))
    except UserError:
        # Somebody may have taken the folder away; the words of a finished run are not to fail for that.
        return "refinement"


def _best_by_size(records: Sequence[HallOfFameRecord], summary: Summary) -> str:
    """Return the hall of fame as a table; the champion is the best tree of its own size."""
    lines = ["decision nodes         test mean ± sd"]
    for record in records:
        is_champion = record.decision_nodes == summary.decision_nodes
        mark = "  <- the champion" if is_champion else ""
        test = f"{record.test_mean:.2f} ± {record.test_std:.2f}"
        lines.append(f"{record.decision_nodes:>14}  {test:>21}{mark}")
    return "\n".join(lines)
