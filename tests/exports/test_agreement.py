"""Law 4 over all formats: 200 random controllers of every kind answer in each of them as their trees do."""

from functools import cache

import numpy as np
import pytest
from controllers_for_tests import KINDS, random_controllers
from exports_for_tests import formats, needs_compiler

from ge_torchrl.exports import compiling
from ge_torchrl.exports.code import answers_of
from ge_torchrl.exports.formats import FORMATS
from ge_torchrl.exports.observations import observations_of
from ge_torchrl.exports.written import Written

N_CONTROLLERS = 200
# Enough for each split of each tree to be met on its threshold and on both sides of it.
N_OBSERVATIONS = 1000
AXIS_ALIGNED = (("axis", "action"), ("axis", "constant"))
STRICT = ("-std=c99", "-O1", "-Wall", "-Wextra", "-pedantic", "-Werror")


@cache
def controllers_of(n, seed, kinds=KINDS):
    """Return controllers, and what each of them is asked."""
    controllers = random_controllers(n, seed, kinds)
    observed = [observations_of(each.tree, len(each.names.features), N_OBSERVATIONS) for each in controllers]
    return controllers, observed


def written(to, controllers):
    names = [f"controller_{place}" for place in range(len(controllers))]
    return [
        Written(controller, name, FORMATS[to].write(controller, name))
        for controller, name in zip(controllers, names, strict=True)
    ]


def assert_agree(exports, observed, answers):
    for one, rows, answered in zip(exports, observed, answers, strict=True):
        expected = answers_of(one.controller, rows)
        assert answered.shape == expected.shape
        assert answered.dtype.kind == expected.dtype.kind
        assert np.array_equal(answered, expected), one.content.decode(errors="replace")


@pytest.mark.parametrize("to", formats())
def test_an_export_answers_as_its_tree(to):
    controllers, observed = controllers_of(N_CONTROLLERS, 14, AXIS_ALIGNED if to == "sklearn" else KINDS)
    exports = written(to, controllers)
    assert_agree(exports, observed, FORMATS[to].answers(exports, observed))


@needs_compiler
@pytest.mark.parametrize("flags", [("-std=c99", "-O3"), STRICT, ("-std=gnu17", "-O2", "-march=native")])
def test_c_answers_so_with_other_flags_of_the_compiler_and_without_a_warning(flags):
    controllers, observed = controllers_of(18, 15)
    exports = written("c", controllers)
    assert_agree(exports, observed, compiling.answers(exports, observed, flags))


@pytest.mark.parametrize("to", formats(["python", "c", "onnx", "st", "json", "text"]))
def test_a_number_that_is_none_or_infinite_is_answered_as_by_the_tree(to):
    odd = np.array([np.nan, np.inf, -np.inf, 0.5], np.float32)
    rng = np.random.default_rng(3)
    exports = written(to, random_controllers(30, seed=16, kinds=(("axis", "action"), ("oblique", "action"))))
    observed = [rng.choice(odd, (50, len(one.controller.names.features))) for one in exports]
    assert_agree(exports, observed, FORMATS[to].answers(exports, observed))


def test_what_is_written_hangs_on_the_controller_alone():
    (controller,) = random_controllers(1, seed=1)
    for to, form in FORMATS.items():
        assert form.write(controller, "one") == form.write(controller, "one"), to
