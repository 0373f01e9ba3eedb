"""A configuration made real: what can be known to be right before anything is written."""

from __future__ import annotations

from dataclasses import dataclass

from ge_torchrl.config import Config
from ge_torchrl.environments.choose import open_backend
from ge_torchrl.environments.spec import EnvironmentSpec, describe_settings
from ge_torchrl.errors import GrammarError
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.rule_tables import RuleTables, compile_rules


@dataclass(frozen=True, eq=False)
class Plan:
    """What a run is to do.

    Attributes:
        config: The configuration.
        spec: The environment.
        tables: The compiled grammar.
    """

    config: Config
    spec: EnvironmentSpec
    tables: RuleTables


def plan(config: Config) -> Plan:
    """Check what a configuration promises: that the environment exists and fits, and that the grammar is one.

    Raises:
        EnvironmentFaultError: The environment is unknown or unsuitable, or has no such route.
        GrammarError: The grammar text breaks a rule.
    """
    env = config.env
    spec = describe_settings(env)
    if env.route == "kernel":
        open_backend(spec, env.route, threads=1).close()
    try:
        tables = compile_rules(read_grammar(config.grammar.bnf, spec.names.features, spec.names.actions))
    except GrammarError as error:
        raise GrammarError(f"grammar.bnf, {error}") from error
    return Plan(config, spec, tables)
