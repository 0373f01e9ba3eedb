import re
from dataclasses import replace

import numpy as np
import pytest
from controllers_for_tests import random_controllers
from documents_for_tests import names_for
from exports_for_tests import needs_compiler
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import any_trees

from ge_torchrl.exports import compiling
from ge_torchrl.exports.code import answers_of
from ge_torchrl.exports.formats import FORMATS
from ge_torchrl.exports.names import identifiers, is_identifier, printable
from ge_torchrl.exports.observations import observations_of
from ge_torchrl.exports.reserved import RESERVED_IN_C, RESERVED_IN_PYTHON, RESERVED_IN_ST
from ge_torchrl.exports.written import Written
from ge_torchrl.trees.controller import Controller

STRICT = ("-std=c99", "-O0", "-Wall", "-Wextra", "-pedantic", "-Werror")

# What breaks comments, strings, labels and lines in one language or another, and what looks like a number or a sum.
_PIECES = [
    "*/", "/*", "*)", "(*", '"', "'", '"""', "\\", "\n", "\r\n", "\t", "\0", "{", "}", "{}", "$", "%", "#", "&lt;", "&",
    "<b>", "]]>", "--", "->", "??/", "//", "`", "|", "[", "]", ";", ":=", "<", "é", "θ", "θ̇", "ẋ", "速度", "\u202e",
    "\ud800", "_", "__", " ", "  ", "-", "- 2 x", "2 x", "1e5", "f0", "a1", "x", "X", "x_2", "s0", "l0", "yes", "no",
    "always ", "?", "├─ yes: ", "<br>", "\\n", "\\\\", "end", "if", "IF", "int", "real", "class", "lambda", "True",
    "observation", "action", "controller", "decision", "float", "min", "linux", "FLT_MAX", "time", "left", "9",
    "None", "😀", "9lives", "\u2028",
]  # fmt: skip
NAMES = st.lists(st.sampled_from(_PIECES) | st.text(max_size=3), max_size=4).map("".join)


def kept(name):
    """Return what of a name a controller takes."""
    return "".join(filter(str.isprintable, name))


PRINTABLE_NAMES = NAMES.map(kept)


@given(st.lists(NAMES, max_size=8), st.sampled_from([RESERVED_IN_C, RESERVED_IN_PYTHON, RESERVED_IN_ST]))
def test_identifiers_are_legal_different_and_the_same_each_time(names, reserved):
    found = identifiers(names, "feature", reserved)
    assert len(found) == len(names)
    assert all(re.fullmatch(r"[A-Za-z](_?[A-Za-z0-9])*", each) for each in found)
    assert all(each.lower() not in reserved for each in found)
    assert len({each.lower() for each in found}) == len(found)
    assert found == identifiers(names, "feature", reserved)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["x", "theta_dot"], ("x", "theta_dot")),
        (["θ", "θ̇", "Δp", "ẋ"], ("theta", "theta_dot", "deltap", "x_dot")),
        (["2nd angle", "", "速度"], ("feature_2nd_angle", "feature_1", "feature_2")),
        (["x", "X", "x_2", "x"], ("x", "X_2", "x_2_2", "x_3")),
        (["lambda", "a/b", "a b", "été"], ("lambda_value", "a_b", "a_b_2", "ete")),
        (["w" * 100], ("w" * 48,)),
    ],
)
def test_names_stay_what_they_can(names, expected):
    assert identifiers(names, "feature", RESERVED_IN_PYTHON) == expected


@pytest.mark.parametrize(
    ("name", "fits"),
    [
        ("controller", True),
        ("_c", False),
        ("c__d", False),
        ("1c", False),
        ("for", False),
        ("é", False),
        ("", False),
    ],
)
def test_the_name_of_a_controller_is_an_identifier(name, fits):
    assert is_identifier(name, RESERVED_IN_PYTHON) == fits


def test_what_steers_a_display_is_a_space():
    assert printable("a\nb\u202ec\0d é") == "a b c d é"


@settings(max_examples=25)
@given(st.data(), any_trees())
@pytest.mark.parametrize("to", [to for to in FORMATS if to not in ("sklearn", "c")])
def test_an_export_answers_as_its_tree_whatever_names_are(to, data, tree):
    one = oddly_named(data, tree, to)
    rows = observations_of(tree, 4, 60)
    (answered,) = FORMATS[to].answers([one], [rows])
    assert np.array_equal(answered, answers_of(one.controller, rows))


def oddly_named(data, tree, to):
    names = names_for(tree)
    features = tuple(data.draw(st.lists(PRINTABLE_NAMES, min_size=4, max_size=4)))
    actions = tuple(data.draw(PRINTABLE_NAMES) for _ in names.actions)
    odd = replace(
        names, id=data.draw(PRINTABLE_NAMES), features=features, units=features[::-1], actions=actions
    )
    controller = Controller(tree, odd)
    return Written(controller, "controller", FORMATS[to].write(controller, "controller"))


@needs_compiler
def test_c_compiles_without_a_warning_whatever_names_are():
    rng = np.random.default_rng(7)

    def odd(texts):
        return tuple(kept("".join(rng.choice(_PIECES, rng.integers(0, 4)).tolist())) for _ in texts)

    written, observed = [], []
    for place, plain in enumerate(random_controllers(60, seed=8)):
        names = replace(
            plain.names, id=odd("1")[0], features=odd(plain.names.features), actions=odd(plain.names.actions)
        )
        controller = replace(plain, names=names)
        name = f"controller_{place}"
        written.append(Written(controller, name, FORMATS["c"].write(controller, name)))
        observed.append(observations_of(controller.tree, len(names.features), 100))
    for one, rows, answered in zip(
        written, observed, compiling.answers(written, observed, STRICT), strict=True
    ):
        assert np.array_equal(answered, answers_of(one.controller, rows))
