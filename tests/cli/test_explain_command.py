"""`explain`: every setting is explained, and what it says can be typed."""

import pytest
import yaml

from ge_torchrl.__main__ import main
from ge_torchrl.checks import checked
from ge_torchrl.config import MAPPINGS, template
from ge_torchrl.config.explained import all_keys, sections

SETTINGS = {setting.key: setting for section in sections() for setting in section.keys}


def flat(values, prefix=""):
    for name, value in values.items():
        if value and isinstance(value, dict):
            yield from flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name


def test_every_setting_is_explained():
    assert sorted(SETTINGS) == sorted(flat(template())) == sorted(key for key, _ in all_keys())
    assert all(setting.meaning and setting.allowed and setting.default for setting in SETTINGS.values())


@pytest.mark.parametrize(
    ("key", "rule"), list(all_keys()), ids=lambda value: value if isinstance(value, str) else ""
)
def test_an_example_can_be_typed(key, rule):
    typed, _, text = SETTINGS[key].example.partition("=")
    assert typed == key or key in MAPPINGS
    text = text.strip("'")
    if key not in MAPPINGS:
        # YAML reads 1e6 as a text, Hydra as a number.
        value = float(text) if text == "1e6" else yaml.safe_load(text)
        checked(key, value, rule)


def test_a_setting_is_explained_with_what_sets_it(capsys):
    assert main(["explain", "ge.generations"]) == 0
    told = capsys.readouterr().out
    assert told.startswith("ge.generations\n  Generations, ")
    for line in (
        "  allowed   integer, at least 1: ",
        "  default   50\n",
        "env=acrobot (132)\n",
        "  type      ge-torchrl ge.generations=132\n",
    ):
        assert line in told
    assert main(["explain", "+refiner.ppo.optimizer=adam"]) == 0
    assert "  allowed   adam, rmsprop\n" in capsys.readouterr().out
    assert main(["explain", "env.kwargs.gravity"]) == 0
    assert capsys.readouterr().out.startswith("env.kwargs\n")


def test_sections_are_listed_with_their_settings(capsys):
    assert main(["explain"]) == 0
    told = capsys.readouterr().out
    assert all(f"\n  {section.name} " in told for section in sections() if section.name)
    assert "\n  refiner     cmaes, none, ppo, thesis\n" in told
    assert main(["explain", "ge"]) == 0
    told = capsys.readouterr().out
    assert all(f"\n  {key} " in told for key in SETTINGS if key.startswith("ge."))
    assert max(map(len, told.splitlines())) <= 100


@pytest.mark.parametrize(
    ("key", "told"),
    [
        ("ge.generation", "ge.generation is unknown; expected a key of a run, such as ge.generations"),
        ("ge.elites", "ge.elites is gone, because "),
        ("hall_of_fame", "hall_of_fame is now archive"),
        ("nonsense", "nonsense is unknown; expected a key of a run, such as "),
    ],
)
def test_an_unknown_key_is_told_with_similar_ones(capsys, key, told):
    assert main(["explain", key]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"ge-torchrl: {told}")
    assert error.count("\n") == 1
