"""What may be tuned, and how it is typed."""

import re

import pytest
from pages_for_tests import ROOT, blocks

from ge_torchrl.config.composing import compose
from ge_torchrl.config.files import choices
from ge_torchrl.errors import ConfigError
from ge_torchrl.tuning.space import SPACE, shown, space_of

CONFIG = compose("mountaincar", {}, {}).resolved(1e8)


def space(*texts, config=CONFIG, pinned=()):
    return {one.key: one for one in space_of(texts, config, pinned)}


@pytest.mark.parametrize("environment", choices("env"))
@pytest.mark.parametrize("speed", [1e4, 1e8])
def test_what_is_tuned_by_default_holds_what_every_environment_has(environment, speed):
    if environment == "default":
        return
    found = space(config=compose(environment, {}, {}).resolved(speed))
    assert all(one.holds_untuned for one in found.values())
    assert len(found) >= 10


def test_what_makes_no_difference_is_left_alone():
    plain = compose("mountaincar", {"refiner": "none", "polish": "none"}, {}).resolved(1e8)
    assert not [key for key in space(config=plain) if not key.startswith(("ge.", "evaluation."))]
    cmaes = compose("mountaincar", {"refiner": "cmaes"}, {}).resolved(1e8)
    assert not [key for key in space(config=cmaes) if key.startswith("refiner.ppo")]
    assert "polish.max_timesteps" in space(config=cmaes)
    assert space().keys() - space(pinned=["ge.population_size"]).keys() == {"ge.population_size"}
    with pytest.raises(ConfigError, match="--space must name what is tuned"):
        space(pinned=SPACE)


def test_ranges_factors_and_choices_are_typed():
    found = space(
        "ge.gene_probability=0.01..0.3", "ge.population_size=x2", "ge.parsimony", "refiner.ppo.optimizer=adam,rmsprop",
        "ge.crossover_probability", "evaluation.episodes=1e1..1e2", "refiner.write_back", "refiner.ppo.epochs",
    )  # fmt: skip
    assert {key: one.allowed for key, one in found.items()} == {
        "ge.gene_probability": "0.01..0.3",
        "ge.population_size": "100..400",
        "ge.parsimony": "lexicographic,none",
        "refiner.ppo.optimizer": "adam,rmsprop",
        "ge.crossover_probability": "0..1",
        "evaluation.episodes": "10..100",
        "refiner.write_back": "false,true",
        "refiner.ppo.epochs": "1..16",
    }
    assert [key for key, one in found.items() if one.is_log] == [
        "ge.gene_probability", "evaluation.episodes", "refiner.ppo.epochs",
    ]  # fmt: skip
    assert not space("ge.tournament_size=4..9")["ge.tournament_size"].holds_untuned


def test_a_file_names_them_too(tmp_path):
    path = tmp_path / "space.yaml"
    path.write_text(
        "ge.gene_probability: 0.01..0.3\nge.parsimony:\nrefiner.ppo.minibatch_size: [null, 100]\n"
    )
    assert [one.allowed for one in space(str(path)).values()] == [
        "0.01..0.3",
        "lexicographic,none",
        "null,100",
    ]


def test_values_are_rounded_within_their_range():
    one = space("ge.gene_probability=0.01234..0.3")["ge.gene_probability"]
    assert [one.rounded(value) for value in (0.012341, 0.0567891, 0.3)] == [0.01234, 0.0568, 0.3]
    assert [shown(value) for value in (None, True, 0.05, 3, "adam")] == ["null", "true", "0.05", "3", "adam"]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("ge.mutation", "ge.mutation is unknown; expected a key of a run, such as"),
        ("ge", "--space must name settings, not a section of them; got ge"),
        (
            "ge.mutation_probability=0.5..2",
            "--space ge.mutation_probability must be a range within what the setting",
        ),
        ("ge.mutation_probability=0.5..0.2", "the lesser end first; got 0.5..0.2"),
        ("ge.mutation_probability=a..b", "got a..b"),
        ("ge.crossover_probability=x4", "--space ge.crossover_probability must be a range such as 1..10"),
        ("ge.parsimony=1..2", "--space ge.parsimony must be choices"),
        ("ge.parsimony=none", "two choices or more"),
        ("ge.parsimony=none,some", "got some"),
        ("ge.tournament_size=2,2", "each once; got 2,2"),
        ("ge.tournament_size=[2", "--space ge.tournament_size"),
        ("refiner.ppo.critic_hidden", "neither a number nor one of a few values"),
        ("env.max_episode_steps=10..100", "cannot be tuned, because it decides what is compared"),
        ("ge.max_env_steps=x4", "expected it as ge.max_env_steps=VALUE"),
        ("seed=0..9", "--space seed cannot be tuned"),
        ("none.yaml", "none.yaml must be a file of settings in YAML"),
    ],
)
def test_mistakes_name_the_key(text, told):
    with pytest.raises(ConfigError) as error:
        space(text)
    assert told in str(error.value)


def test_the_page_names_what_is_tuned_and_shows_a_file():
    page = ROOT / "docs" / "tuning.md"
    table = page.read_text().split("| setting | tried |", 1)[1].split("\n\n", 1)[0]
    assert sorted(re.findall(r"`([\w.]+)`", table)) == sorted(SPACE)
    example = ROOT / "docs" / "examples" / "space.yaml"
    assert example.read_text() in blocks(page, "yaml")
    assert len(space(str(example))) == 4
