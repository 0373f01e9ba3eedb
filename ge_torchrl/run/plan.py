"""A configuration made real: what can be known to be right before anything is written."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ge_torchrl.config import Config, EnvironmentConfig
from ge_torchrl.environments.carrying import carrying_wrappers
from ge_torchrl.environments.choose import open_backend
from ge_torchrl.environments.kernel_choice import has_kernel
from ge_torchrl.environments.mirroring import check_mirror, refuse_what_is_refuted
from ge_torchrl.environments.plants.plant import names_plant
from ge_torchrl.environments.probing import Probe, obeys_seeds, probe
from ge_torchrl.environments.registry import newer_version
from ge_torchrl.environments.spec import EnvironmentSpec, describe_settings, symmetry_of
from ge_torchrl.environments.trust import remember
from ge_torchrl.errors import GrammarError
from ge_torchrl.ge.generating import choose_grammar
from ge_torchrl.ge.grammar_reader import vocabulary
from ge_torchrl.ge.rule_tables import RuleTables, compile_rules
from ge_torchrl.refiners.mirror import Mirror

_GENERATED = "generated"
# Parts of the seconds of a run that may go by before it, while its environment is looked at: how features lie,
# whether seeds are obeyed, whether the mirror holds.
_PROBE_SHARE, _SEEDS_SHARE, _MIRROR_SHARE = 0.1, 0.03, 0.1
# The first of them has so long in any case [s], in which most environments are looked at fully.
_PROBE_SECONDS = 0.5


@dataclass(frozen=True, eq=False)
class Plan:
    """What a run is to do.

    Attributes:
        config: The configuration, with the grammar and the episode limit that were made for the environment.
        spec: The environment.
        tables: The compiled grammar.
        notes: What the user should know of the environment, a line each.
        mirror: Of the environment; None where none is declared.
        seconds: How long the environment was looked at, in this call or an earlier one of this process [s].
    """

    config: Config
    spec: EnvironmentSpec
    tables: RuleTables
    notes: tuple[str, ...] = ()
    mirror: Mirror | None = None
    seconds: float = 0.0


_looked: dict[tuple[Any, ...], float] = {}


def plan(config: Config) -> Plan:
    """Check what a configuration promises: that the environment exists and fits, and that the grammar is one.

    Where no grammar is given, one is made of what the features are in play. An environment without an episode limit
    gets one. Where a run has few seconds, the environment is looked at for a part of them.

    Raises:
        EnvironmentFaultError: The environment is unknown or unsuitable, or has no such route.
        GrammarError: The grammar text breaks a rule.
        ConfigError: A mirror is declared that there cannot be, or that the environment does not have.
    """
    spec = describe_settings(config.env)
    # Whoever begins a run with it vouches for it.
    remember(spec.id, config.env.wrappers)
    asked, started = (config.env, config.grammar, config.ge.max_seconds), time.perf_counter()
    check_names(spec, config.env)
    if config.env.route == "kernel":
        open_backend(spec, config.env.route, threads=1).close()
    seconds = math.inf if config.ge.max_seconds is None else config.ge.max_seconds
    obeys = has_kernel(spec) or obeys_seeds(spec, _SEEDS_SHARE * seconds)
    notes = [] if obeys else [ignores_seeds(spec)]
    if newer := newer_version(spec.id):
        notes.append(f"{spec.id} is an old version of this environment; the newest is env.id={newer}.")

    def seen() -> Probe:
        return probe(spec, max(_PROBE_SECONDS, _PROBE_SHARE * seconds))

    if not spec.has_limit:
        config = replace(config, env=replace(config.env, max_episode_steps=seen().limit))
        notes.append(limit_given(spec, config.env.max_episode_steps or 0))
        spec = describe_settings(config.env)
    chosen = choose_grammar(
        config.grammar.bnf,
        config.grammar.splits,
        config.grammar.leaves,
        spec.names.features,
        spec.names.actions,
        spec.names.action_bounds,
        ranges=lambda: seen().ranges,
        binary=lambda: [spec.names.features[i] for i in seen().binary],
    )
    if chosen.is_generated:
        config = replace(config, grammar=replace(config.grammar, bnf=chosen.text, name=_GENERATED))
    symmetry, mirror = declared_mirror(config.env, spec)
    if symmetry and symmetry != config.env.symmetry:
        config = replace(config, env=replace(config.env, symmetry=symmetry))
    if mirror is not None:
        verdict = check_mirror(spec, symmetry, mirror, _MIRROR_SHARE * seconds)
        refuse_what_is_refuted(verdict)
        if not verdict.is_tried:
            notes.append(f"env.symmetry is believed: {verdict.found} to try it.")
    looked = _looked.setdefault(asked, time.perf_counter() - started)
    return Plan(config, spec, compile_rules(chosen.grammar), tuple(notes), mirror, looked)


def check_names(spec: EnvironmentSpec, env: EnvironmentConfig) -> None:
    """Refuse names that cannot stand in a grammar.

    Raises:
        GrammarError: There is one; the message says where it comes from.
    """
    names = {"features": spec.names.features, "actions": () if spec.is_continuous else spec.names.actions}
    for key, given in names.items():
        try:
            vocabulary(given, ())
        except GrammarError as error:
            is_of_plant = names_plant(spec.id) and not getattr(env, key)
            raise GrammarError(f"{spec.id if is_of_plant else 'env'}.{key}: {error}") from error
    try:
        vocabulary(*names.values())
    except GrammarError as error:
        raise GrammarError(f"{spec.id}: {error}") from error


def declared_mirror(env: EnvironmentConfig, spec: EnvironmentSpec) -> tuple[Mapping[str, Any], Mirror | None]:
    """Return what is declared of a mirror, by the settings or else by a plant, and the mirror that it makes.

    Raises:
        ConfigError: There cannot be such a mirror.
    """
    symmetry = symmetry_of(env)
    key = "env.symmetry" if env.symmetry else f"{spec.id}.symmetry"
    return symmetry, Mirror.declared(symmetry, spec.names, key) if symmetry else None


def ignores_seeds(spec: EnvironmentSpec) -> str:
    """Return what is to be said of an environment whose episodes do not follow from their seeds."""
    carrying = carrying_wrappers(spec)
    why = f"{carried_on(carrying)} in {spec.id}" if carrying else f"{spec.id} ignores reset(seed=...)"
    return (
        f"{why}: the same seed gives another episode each time, so trees are not compared on common episodes, and a "
        "run cannot be repeated."
    )


def carried_on(wrappers: Sequence[str]) -> str:
    """Return in words that wrappers make an episode depend on those before it."""
    carry = "carries" if len(wrappers) == 1 else "carry"
    return f"env.wrappers: {' and '.join(wrappers)} {carry} state from one episode to the next"


def limit_given(spec: EnvironmentSpec, limit: int) -> str:
    """Return what is to be said of an environment that was given an episode limit."""
    return (
        f"{spec.id} sets no episode limit: its episodes are truncated after {limit} steps "
        "(env.max_episode_steps sets another limit)."
    )
