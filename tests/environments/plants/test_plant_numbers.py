"""Numbers of a user's file: they are changed from outside, and a kernel and a digest belong to them."""

from contextlib import closing

import pytest
from plants_for_tests import GOOD, text_of

from ge_torchrl.environments.choose import open_backend
from ge_torchrl.environments.plants.plant import read_plant
from ge_torchrl.environments.spec import describe, make_gymnasium
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.trees.tree import DecisionTree

NUMBERS = (
    "import math\nfrom math import pi\nPUSH, DRAG = 2, 0.5\nTWICE = 2 * DRAG\nNAME = 'it'\nLIST = [1.0]\n"
    + text_of(
        GOOD | {"step": "lambda s, a: ((s[0] + PUSH, s[1] + TWICE), DRAG, False)", "solved_at": "TWICE"}
    )
)


def test_numbers_of_a_file_are_changed_with_what_follows_from_them(folder):
    (folder / "mine.py").write_text(NUMBERS)
    assert read_plant("mine.py:Mine").numbers == {"PUSH": 2, "DRAG": 0.5, "TWICE": 1.0}
    steps = {}
    for drag in (None, 3, 0.25):
        kwargs = {} if drag is None else {"DRAG": drag}
        spec = describe("mine.py:Mine", kwargs=kwargs)
        with closing(open_backend(spec, threads=1)) as backend:
            # The kernel is that of these numbers, and agrees with Gymnasium's environment.
            assert backend.name == "kernel"
            trajectory = backend.record(DecisionTree.leaf(0), 1)
        steps[drag] = trajectory.observations[1, 1], trajectory.rewards[0], spec.solved_at
        environment = make_gymnasium(spec)
        environment.reset(seed=1)
        observation, reward, *_ = environment.step(0)
        assert (observation[1], reward) == steps[drag][:2]
    assert steps == {None: (1.0, 0.5, 1.0), 3: (6.0, 3.0, 6.0), 0.25: (0.5, 0.25, 0.5)}


def test_the_kernel_of_changed_numbers_is_cached_by_them(folder):
    (folder / "mine.py").write_text(NUMBERS)
    digests = {read_plant("mine.py:Mine", {"DRAG": drag}).digest for drag in (1, 1.0, 2.0)}
    assert len(digests) == 2
    assert read_plant("mine.py:Mine").digest not in digests
    assert read_plant("mine.py:Mine", {"PUSH": 3}).numbers["PUSH"] == 3


@pytest.mark.parametrize(
    ("kwargs", "told"),
    [
        ({"mass": 2.0}, "which are PUSH, DRAG, TWICE; got mass"),
        ({"drag": 2.0}, "got drag; env.kwargs.DRAG is one"),
        ({"pi": 3.0}, "got pi"),
        ({"DRAG": "much"}, "env.kwargs.DRAG must be a number, as DRAG = 0.5 is one in mine.py:Mine; got 'much'"),
        ({"DRAG": True}, "got True"),
        ({"DRAG": float("inf")}, "got inf"),
    ],
)  # fmt: skip
def test_what_is_no_number_of_the_file_is_refused(folder, kwargs, told):
    (folder / "mine.py").write_text(NUMBERS)
    with pytest.raises(EnvironmentFaultError) as caught:
        describe("mine.py:Mine", kwargs=kwargs)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_digest_of_the_source_is_that_of_the_text_wherever_it_lies(folder):
    (folder / "elsewhere").mkdir()
    for place in ("mine.py", "elsewhere/yours.py"):
        (folder / place).write_text(NUMBERS)
    source = read_plant("mine.py:Mine").source
    assert read_plant("elsewhere/yours.py:Mine").source == source
    assert read_plant("mine.py:Mine", {"DRAG": 2.0}).source == source
    (folder / "mine.py").write_text(NUMBERS + "\n")
    assert read_plant("mine.py:Mine").source != source
