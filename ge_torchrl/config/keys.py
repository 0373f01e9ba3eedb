"""The keys that users type: which there are, and what became of those that are gone."""

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from ge_torchrl.checks import nearest
from ge_torchrl.errors import ConfigError

# A former section or key, and what stands in its place. A key that begins with a former section keeps its end.
_SUCCESSORS = {
    "hall_of_fame.enabled": "archive.keep, where 0 keeps no archive",
    "hall_of_fame.final_settling_episodes": "polish.settling_episodes",
    "hall_of_fame": "archive",
    "refiner.cmaes": "polish",
    "refiner.name": "refiner.method",
    "refiner.ppo.source": "env.route",
    "refiner.ppo.scale_features": "refiner.ppo.standardise",
    "refiner.ppo.scale_critic": "refiner.ppo.standardise",
    "refiner.ppo.leaf_scale": "refiner.ppo.leaf_logit, where null is the thesis' Eq. 3",
    "env.lowest_fitness_excluded": "env.lowest_return",
    "ge.parsimony_tolerance": "ge.parsimony, for individuals that are equally fit",
}

# What is gone without a successor, and why nobody needs it.
_GONE = {
    "archive.revisits": "archive.revisit_factor=0 refines no kept tree again, and otherwise it is one",
    "evaluation.champion_candidates": "validation chooses among kept trees, and archive=none tests the best one",
    "ge.elites": "an offspring takes its parent's place only if it is fitter, so the best one stays",
    "ge.replacement": "an offspring takes its parent's place if it is fitter",
    "ge.single_choice_consumes": "a rule with a single production reads no codon",
    "polish.max_seconds": "polish.max_timesteps is the budget, by which two runs of one seed are the same",
    "polish.screening_episodes": "moves are screened on a quarter of polish.episodes",
    "refiner.acceptance_errors": "a refined tree has to be better by three standard errors",
    "refiner.best_probability": "the best tree is drawn as often as a random one",
    "refiner.simplify": "refiner.write_back=false refines whole trees, and otherwise they are simplified",
    "refiner.probability": "every tree that is chosen is refined",
    "refiner.ppo.alpha_final": "refiner.ppo.alpha holds from the first update to the last",
    "refiner.ppo.critic_coeff": "refiner.ppo.lr_critic is the critic's own learning rate",
    "refiner.ppo.leaf_sd": "leaves are always drawn with the thesis' deviation of 0.1",
    "refiner.ppo.lr_thresholds": "refiner.ppo.lr_actor is the learning rate of the whole tree",
}

# Former groups of choices, and what to type instead.
_FORMER_GROUPS = {
    "hall_of_fame": "archive=none, or a key such as archive.keep=8",
    "ge": "env=NAME, which brings its settings along, or a key such as ge.generations=50",
    "evaluation": "env=NAME, which brings its settings along, or a key such as evaluation.episodes=20",
}

# Former choices of a group, and why nobody needs them.
_FORMER_CHOICES = {
    "archive=explored": "a run keeps trees unless archive=none says otherwise",
    "polish=local": "a run polishes where steps are nearly free unless polish=none says otherwise",
}


def check_key(key: str, known: Iterable[str]) -> None:
    """Refuse a dotted key, such as `ge.generations`, that no run has.

    Args:
        key: What the user typed.
        known: All keys and sections.

    Raises:
        ConfigError: There is no such key; the message names its successor or similar ones.
    """
    names = list(known)
    if key in names:
        return
    if reason := _GONE.get(key):
        raise ConfigError(f"{key} is gone, because {reason}; got {key}")
    if successor := _successor(key):
        raise ConfigError(f"{key} is now {successor}; expected the new name; got {key}")
    siblings = [other for other in names if other.startswith(f"{key.partition('.')[0]}.")]
    expected = similar(key, siblings or names) or siblings or [name for name in names if "." not in name]
    raise ConfigError(f"{key} is unknown; expected a key of a run, such as {', '.join(expected)}; got {key}")


def similar(key: str, names: Collection[str]) -> list[str]:
    """Return the keys that a mistyped one may stand for, be it for their ends alone."""
    if whole := nearest(key, names, n=3, cutoff=0.75):
        return whole
    ends = {name: name.rpartition(".")[2] for name in names}
    meant = nearest(key.rpartition(".")[2], ends.values())
    return [name for name, end in ends.items() if end in meant][:3]


def without_gone(values: Any, section: str = "") -> Any:
    """Return nested plain values without the keys that are gone, as the files of earlier runs have them."""
    if not isinstance(values, Mapping):
        return values
    keys = {name: f"{section}.{name}" if section else str(name) for name in values}
    return {
        name: without_gone(value, keys[name]) for name, value in values.items() if keys[name] not in _GONE
    }


def check_group(group: str) -> None:
    """Refuse a former group of choices, such as `hall_of_fame`.

    Raises:
        ConfigError: The group is gone; the message says what to type instead.
    """
    if instead := _FORMER_GROUPS.get(group):
        raise ConfigError(f"{group} is no choice of files any more; expected {instead}; got {group}=...")


def check_choice(group: str, choice: str) -> None:
    """Refuse a former choice of a group, such as `archive=explored`.

    Raises:
        ConfigError: The choice is gone; the message says why.
    """
    if reason := _FORMER_CHOICES.get(f"{group}={choice}"):
        raise ConfigError(f"{group}={choice} is gone, because {reason}; got {choice}")


def _successor(key: str) -> str | None:
    if whole := _SUCCESSORS.get(key):
        return whole
    section, _, name = key.rpartition(".")
    former = _SUCCESSORS.get(section)
    return f"{former}.{name}" if former else None
