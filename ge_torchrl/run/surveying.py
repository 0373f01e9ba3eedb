"""What is found out about an environment before a run of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass

from ge_torchrl.config import Config
from ge_torchrl.environments.carrying import carrying_wrappers
from ge_torchrl.environments.choose import agrees_with_gymnasium, check_plant
from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.kernel_choice import has_kernel
from ge_torchrl.environments.mirroring import Verdict, check_mirror
from ge_torchrl.environments.plants.plant import names_plant
from ge_torchrl.environments.probing import Probe, obeys_seeds, probe
from ge_torchrl.environments.registry import newer_version
from ge_torchrl.environments.spec import EnvironmentSpec, describe_settings
from ge_torchrl.report.tables import counted
from ge_torchrl.run.plan import carried_on, check_names, declared_mirror


@dataclass(frozen=True, eq=False)
class Survey:
    """What was found.

    Attributes:
        spec: The environment as it describes itself, with the names of the configuration.
        seen: What play showed.
        obeys_seeds: Whether the same seed gives the same episode twice.
        carrying: Where it does not, the wrappers because of which.
        agrees: Whether the kernel's steps are those of the installed Gymnasium; None where there is no kernel.
        mirror: What was found of the declared mirror; None where none is declared.
        speeds: Environment steps a second by route: one process of Gymnasium, the kernel on all its threads.
    """

    spec: EnvironmentSpec
    seen: Probe
    obeys_seeds: bool
    carrying: tuple[str, ...]
    agrees: bool | None
    mirror: Verdict | None
    speeds: dict[str, float]

    def as_text(self) -> str:
        """Return it for a terminal."""
        return "\n".join([self.spec.id, *self._facts(), "", *self._features()])

    def _facts(self) -> Iterator[str]:
        spec = self.spec
        for what, names in (("arguments", spec.names.kwargs), ("wrappers", spec.names.wrappers)):
            if names:
                yield f"{what:<13} {', '.join(f'{n}={names[n]}' if isinstance(names, dict) else n for n in names)}"
        if newer := newer_version(spec.id):
            yield f"version       old; the newest is {newer}"
        yield f"observation   {counted(spec.n_features, 'number')}"
        yield f"action        {self._actions()}"
        yield f"limit         {self._limit()}"
        yield f"solved at     {'no threshold' if spec.solved_at is None else f'a mean return of {spec.solved_at:g}'}"
        yield f"seeds         {self._seeds()}"
        outside = ", ".join(spec.names.features[i] for i in sorted(self.seen.outside))
        yield f"bounds        {f'untrue: {outside}' if outside else f'kept in {self.seen.steps} steps'}"
        if self.mirror is not None:
            yield f"mirror        {self._mirror(self.mirror)}"
        yield f"kernel        {self._kernel()}"
        for route, speed in self.speeds.items():
            yield f"{'speed':<13} {float(f'{speed:.2g}'):,.0f} steps a second, {route}"

    def _actions(self) -> str:
        names = self.spec.names
        if not self.spec.is_continuous:
            return f"one of {len(names.actions)}: {', '.join(names.actions)}"
        entries = (
            f"{name} from {low:g} to {high:g}"
            for name, (low, high) in zip(names.actions, names.action_bounds, strict=True)
        )
        return f"{counted(len(names.actions), 'number')}: {', '.join(entries)}"

    def _seeds(self) -> str:
        if self.obeys_seeds:
            return "obeyed: the same seed gives the same episode"
        return f"not obeyed: {carried_on(self.carrying)}" if self.carrying else "ignored"

    def _limit(self) -> str:
        if self.spec.has_limit:
            return f"{self.spec.max_episode_steps} steps"
        ended = (
            f"the longest episode seen had {self.seen.longest}"
            if self.seen.ended
            else "an episode did not end"
        )
        return f"none of its own; {ended}; a run takes {self.seen.limit} steps (env.max_episode_steps)"

    def _mirror(self, verdict: Verdict) -> str:
        if verdict.fault:
            return f"does not hold: {verdict.fault}"
        return f"holds: {verdict.found}" if verdict.is_tried else f"not tried: {verdict.found}"

    def _kernel(self) -> str:
        if self.agrees is None:
            return "none for this environment as it is"
        return "used" if self.agrees else "not used: the installed Gymnasium differs"

    def _features(self) -> Iterator[str]:
        spec, seen = self.spec, self.seen
        rows: list[tuple[str, ...]] = [("feature", "unit", "declared", "seen", "in a generated grammar")]
        for i, name in enumerate(spec.names.features):
            spans = (
                (spec.low[i], spec.high[i]),
                (seen.seen_low[i], seen.seen_high[i]),
                seen.ranges[i],
            )
            rows.append(
                (name, spec.names.units[i], *(f"{low + 0.0:.4g} to {high + 0.0:.4g}" for low, high in spans))
            )
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        for row in rows:
            yield "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()


def survey(config: Config) -> Survey:
    """Find out about the environment of a configuration.

    Raises:
        EnvironmentFaultError: It is unknown, unsuitable or at fault.
        GrammarError: A name cannot stand in a grammar.
        ConfigError: A mirror is declared that there cannot be.
    """
    spec = describe_settings(config.env)
    check_names(spec, config.env)
    symmetry, mirror = declared_mirror(config.env, spec)
    seen, seeds = probe(spec), obeys_seeds(spec)
    speeds = {}
    with closing(GymnasiumBackend(spec, workers=1)) as gymnasium:
        speeds["Gymnasium in one process"] = gymnasium.steps_per_second
    if names_plant(spec.id) and has_kernel(spec):
        check_plant(spec)
    agrees = agrees_with_gymnasium(spec) if has_kernel(spec) else None
    if agrees:
        with closing(KernelBackend(spec, config.evaluation.threads)) as kernel:
            speeds["kernel"] = kernel.steps_per_second
    verdict = None if mirror is None else check_mirror(spec, symmetry, mirror)
    carrying = () if seeds else carrying_wrappers(spec)
    return Survey(spec, seen, seeds, carrying, agrees, verdict, speeds)
