"""A small configuration, and variations of it."""

from typing import Any

from ge_torchrl.config import Config

VALUES: dict[str, Any] = {
    "env": {"id": "CartPole-v1"},
    "grammar": {"name": "tiny", "bnf": "<dt> ::= left | right"},
    "ge": {"population_size": 10, "generations": 3, "genotype_length": 20, "gene_probability": 0.1},
    "evaluation": {"episodes": 5},
}


def config_with(section: str, key: str, value: object) -> Config:
    return Config.from_mapping({**VALUES, section: {**VALUES[section], key: value}})
