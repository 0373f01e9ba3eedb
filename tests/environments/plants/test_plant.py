"""A user's file: how it is named, found and read again."""

import gymnasium as gym
import numpy as np
import pytest
from plants_for_tests import GOOD, text_of, write_plants

from ge_torchrl.environments.plants.plant import names_plant, read_plant
from ge_torchrl.environments.spec import describe, make_gymnasium
from ge_torchrl.errors import EnvironmentFaultError


@pytest.mark.parametrize(
    ("named", "is_one"),
    [
        ("plant.py:Cart", True),
        ("a/b.py:Cart", True),
        ("plant:Cart-v0", False),
        ("CartPole-v1", False),
        ("a.py", False),
    ],
)
def test_a_plant_is_named_by_file_and_class(named, is_one):
    assert names_plant(named) == is_one


def test_a_file_that_is_not_there_is_told_with_where_it_was_looked_for(folder):
    with pytest.raises(EnvironmentFaultError, match=rf"neither in {folder} nor on PYTHONPATH"):
        describe("nowhere.py:Mine")
    with pytest.raises(EnvironmentFaultError, match=r"it is not there"):
        describe(f"{folder}/nowhere.py:Mine")
    with pytest.raises(EnvironmentFaultError, match=r"as in env\.dynamics=plant\.py:Cart; got 'plant:Cart'"):
        read_plant("plant:Cart")


def test_a_file_is_found_as_modules_are(folder, monkeypatch):
    (folder / "elsewhere").mkdir()
    write_plants(folder / "elsewhere")
    monkeypatch.syspath_prepend(str(folder / "elsewhere"))
    assert read_plant("plants.py:Names").features == ("x", "v")
    assert read_plant("elsewhere/plants.py:Names").features == ("x", "v")


def test_a_file_that_changed_is_read_anew(folder):
    for speed in (1.0, 2.0):
        # As long as before, and within the same second.
        (folder / "mine.py").write_text(
            f"from numba import njit\nSPEED = {speed}\n@njit\ndef moved(x):\n    return x + SPEED\n"
            + text_of(GOOD | {"step": "lambda s, a: ((moved(s[0]), s[1]), 1.0, False)"})
        )
        environment = make_gymnasium(describe("mine.py:Mine"))
        before, _ = environment.reset(seed=3)
        after = environment.step(0)[0]
        assert after[0] - before[0] == pytest.approx(speed)


def test_a_constant_from_another_file_counts_as_a_change(folder, monkeypatch):
    monkeypatch.syspath_prepend(str(folder))
    mine = "import numbers_of_mine\nfrom numbers_of_mine import SPEED\n"
    mine += text_of(GOOD | {"step": "lambda s, a: ((s[0] + SPEED, s[1]), 1.0, False)"})
    (folder / "mine.py").write_text(mine)
    (folder / "numbers_of_mine.py").write_text("SPEED = 1.0\n")
    plant = read_plant("mine.py:Mine")
    import numbers_of_mine

    monkeypatch.setattr(numbers_of_mine, "SPEED", 2.0)
    (folder / "numbers_of_mine.py").write_text("SPEED = 2.0\n")
    (folder / "mine.py").write_text(mine + "\n")
    assert read_plant("mine.py:Mine").digest != plant.digest
    assert read_plant("mine.py:Mine").source != plant.source


def test_registering_again_takes_the_new_limit(folder):
    for limit in (5, 6):
        (folder / "mine.py").write_text(text_of(GOOD | {"max_episode_steps": str(limit)}))
        assert describe("mine.py:Mine").max_episode_steps == limit
    environment = gym.make("mine/Mine-v0")
    observation, _ = environment.reset(seed=1)
    assert observation.dtype == np.float32
