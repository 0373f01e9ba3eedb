import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.checks import UNSET, Rule, checked, refuse
from ge_torchrl.errors import ConfigError

ANYTHING = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.lists(st.integers())
RULES = st.builds(
    Rule,
    kind=st.sampled_from(["integer", "number", "flag", "text"]),
    many=st.booleans(),
    optional=st.booleans(),
    at_least=st.sampled_from([-math.inf, 0, 3]),
)


def outcome(value, rule):
    try:
        return checked("a.key", value, rule), None
    except ConfigError as error:
        return None, str(error)


@given(RULES, ANYTHING)
def test_a_value_is_normalised_once_or_refused_with_what_was_expected(rule, value):
    kept, refusal = outcome(value, rule)
    if refusal is None:
        assert outcome(kept, rule) == (kept, None)
    else:
        assert refusal.startswith("a.key must be ")
        assert rule.expected in refusal


@pytest.mark.parametrize(
    ("rule", "expected"),
    [
        (Rule("integer"), "an integer"),
        (Rule("integer", at_least=1, optional=True), "an integer of at least 1 or null"),
        (Rule("number", above=0), "a finite number above 0"),
        (Rule("number", at_least=0, at_most=1), "a number from 0 to 1"),
        (Rule("flag"), "true or false"),
        (Rule("text", choices=("a", "b")), "one of a, b"),
        (Rule("text", text="a name"), "a name"),
        (Rule("integer", many=True, at_least=1), "a list of integers of at least 1"),
        (Rule("text", many=True, distinct=True), "a list of names that differ from each other"),
    ],
)
def test_what_is_allowed_is_told_in_words(rule, expected):
    assert rule.expected == expected


def test_a_value_that_nobody_gave_is_told_as_such():
    with pytest.raises(ConfigError, match=r"^a\.key has no value; expected a name; got nothing$"):
        checked("a.key", UNSET, Rule("text", text="a name"))


def test_a_refusal_ends_with_what_to_do():
    with pytest.raises(ConfigError, match=r"^a must be 1, because so; got null; type a=1$"):
        refuse("a", None, "1", "so", "type a=1")
