"""Running the Structured Text that an export has written: a small interpreter, which takes REAL for float32."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.exports.reserved import RESERVED_IN_ST
from ge_torchrl.exports.st import DECISION
from ge_torchrl.exports.written import Written
from ge_torchrl.trees.tree import FloatArray

_COMMENT = re.compile(r"\(\*(.*?)\*\)", re.DOTALL)
_NUMBER = r"-?\d+\.\d+(?:[eE][+-]?\d+)?"
_TOKEN = re.compile(rf"\s*(L?REAL#{_NUMBER}|[A-Za-z_]\w*|\d+|:=|[-+*<>():;])", re.ASCII)
_IDENTIFIER = re.compile(r"[A-Za-z](?:_?[A-Za-z0-9])*", re.ASCII)
_TYPES = {"REAL": np.float32, "LREAL": np.float64, "INT": np.int16}
# Which feature an input is, as the comment behind it says.
_INPUT = re.compile(r"(\w+) : REAL; \(\* observation (\d+):")

_Array = NDArray[Any]
_Values = dict[str, _Array]
_Expression = Callable[[_Values], Any]


class _Choice(NamedTuple):
    """A chain of conditions, each with the statements that follow from it; the last condition may be None."""

    branches: list[tuple[_Expression | None, list[Any]]]


class _Assignment(NamedTuple):
    name: str
    value: _Expression


class StructuredTextError(Exception):
    """A text is not in the part of Structured Text that exports are written in."""


def answers(written: Sequence[Written], observed: Sequence[FloatArray]) -> list[NDArray[Any]]:
    """Return what the function blocks answer to [B, D] observations of each.

    Raises:
        StructuredTextError: One is no function block.
    """
    return [_answers(one, rows) for one, rows in zip(written, observed, strict=True)]


def _answers(one: Written, rows: FloatArray) -> NDArray[Any]:
    text = one.content.decode()
    block = _Reader(_COMMENT.sub(" ", text)).block()
    inputs = {name.lower(): int(place) for name, place in _INPUT.findall(text)}
    if list(inputs) != block.inputs:
        raise StructuredTextError(f"inputs {', '.join(block.inputs)} are told as {', '.join(inputs)}")
    values: _Values = {name: rows[:, place] for name, place in inputs.items()}
    for name, kind in (*block.outputs.items(), *block.temporary.items()):
        values[name] = np.zeros(len(rows), kind)
    with np.errstate(over="ignore", invalid="ignore"):
        _run(block.body, values, np.arange(len(rows)))
    if list(block.outputs) == [DECISION]:
        return values[DECISION].astype(np.int32)
    return np.stack([values[name] for name in block.outputs], axis=1)


def _run(statements: list[Any], values: _Values, rows: NDArray[np.int64]) -> None:
    """Carry out statements for some of the rows."""
    for statement in statements:
        if isinstance(statement, _Assignment):
            answer = statement.value(_of(values, rows))
            if np.asarray(answer).dtype != values[statement.name].dtype:
                raise StructuredTextError(f"{statement.name} is given a value of another type")
            values[statement.name][rows] = answer
            continue
        left = rows
        for condition, then in statement.branches:
            if condition is None:
                holds = np.ones(len(left), bool)
            else:
                holds = np.broadcast_to(condition(_of(values, left)), len(left))
            _run(then, values, left[holds])
            left = left[~holds]


def _of(values: _Values, rows: NDArray[np.int64]) -> _Values:
    return {name: value[rows] for name, value in values.items()}


class _Block(NamedTuple):
    inputs: list[str]
    outputs: dict[str, Any]
    temporary: dict[str, Any]
    body: list[Any]


class _Reader:
    """Reads a function block, word by word."""

    def __init__(self, text: str) -> None:
        self._words: list[str] = []
        place = 0
        while text[place:].strip():
            found = _TOKEN.match(text, place)
            if found is None:
                raise StructuredTextError(f"{text[place : place + 20]!r} is not understood")
            self._words.append(found[1])
            place = found.end()
        self._place = 0
        self._names: dict[str, Any] = {}
        self._assignable: set[str] = set()

    def block(self) -> _Block:
        self._take("FUNCTION_BLOCK")
        self._identifier()
        inputs = self._declared("VAR_INPUT")
        outputs = self._declared("VAR_OUTPUT")
        temporary = self._declared("VAR_TEMP")
        self._assignable = {*outputs, *temporary}
        body = self._statements({"END_FUNCTION_BLOCK"})
        self._take("END_FUNCTION_BLOCK")
        if self._place != len(self._words):
            raise StructuredTextError("something follows END_FUNCTION_BLOCK")
        return _Block(list(inputs), outputs, temporary, body)

    def _declared(self, section: str) -> dict[str, Any]:
        found: dict[str, Any] = {}
        if self._next() != section:
            return found
        self._take(section)
        while self._next() != "END_VAR":
            name = self._identifier()
            self._take(":")
            found[name] = self._names[name] = _TYPES[self._word()]
            self._take(";")
        self._take("END_VAR")
        return found

    def _statements(self, ends: set[str]) -> list[Any]:
        found: list[Any] = []
        while self._next() not in ends:
            if self._next() == "IF":
                found.append(self._choice())
            else:
                name = self._word().lower()
                if name not in self._assignable:
                    raise StructuredTextError(f"{name} is no output")
                self._take(":=")
                found.append(_Assignment(name, self._sum(_TYPES["INT"])))
            self._take(";")
        return found

    def _choice(self) -> _Choice:
        branches: list[tuple[_Expression | None, list[Any]]] = []
        ends = {"ELSIF", "ELSE", "END_IF"}
        while (word := self._word()) != "END_IF":
            condition = None if word == "ELSE" else self._condition()
            if condition is not None:
                self._take("THEN")
            branches.append((condition, self._statements(ends)))
        return _Choice(branches)

    def _condition(self) -> _Expression:
        left = self._sum()
        compare = {"<": np.less, ">": np.greater}[self._word()]
        right = self._sum()
        return lambda values: compare(*_alike(left(values), right(values)))

    def _sum(self, integer: Any = None) -> _Expression:
        total = self._product(integer)
        while self._next() in ("+", "-"):
            operation = np.add if self._word() == "+" else np.subtract
            total = _applied(operation, total, self._product())
        return total

    def _product(self, integer: Any = None) -> _Expression:
        if self._next() == "-":
            self._take("-")
            negated = self._product()
            return lambda values: np.negative(negated(values))
        total = self._single(integer)
        while self._next() == "*":
            self._take("*")
            total = _applied(np.multiply, total, self._single())
        return total

    def _single(self, integer: Any = None) -> _Expression:
        word = self._word()
        if "#" in word:
            kind, _, digits = word.partition("#")
            number = _TYPES[kind](digits)
            return lambda _: number
        if word.isdigit() and integer is not None:
            whole = integer(word)
            return lambda _: whole
        if self._next() == "(":
            return self._call(word)
        name = word.lower()
        if name not in self._names:
            raise StructuredTextError(f"{word} is not declared")
        return lambda values: values[name]

    def _call(self, function: str) -> _Expression:
        self._take("(")
        argument = self._sum()
        self._take(")")
        if function not in ("REAL_TO_LREAL", "LREAL_TO_REAL"):
            raise StructuredTextError(f"{function} is no function that exports use")
        given, _, wanted = function.partition("_TO_")
        return lambda values: _converted(argument(values), _TYPES[given], _TYPES[wanted])

    def _identifier(self) -> str:
        word = self._word()
        name = word.lower()
        if not _IDENTIFIER.fullmatch(word) or name in RESERVED_IN_ST or name in self._names:
            raise StructuredTextError(f"{word} is no identifier, or is taken")
        return name

    def _next(self) -> str:
        return self._words[self._place] if self._place < len(self._words) else ""

    def _word(self) -> str:
        word = self._next()
        self._place += 1
        return word

    def _take(self, expected: str) -> None:
        word = self._word()
        if word != expected:
            raise StructuredTextError(f"{word!r} stands where {expected} belongs")


def _applied(operation: Any, one: _Expression, other: _Expression) -> _Expression:
    return lambda values: operation(*_alike(one(values), other(values)))


def _alike(*operands: Any) -> tuple[Any, ...]:
    if len({np.asarray(operand).dtype for operand in operands}) > 1:
        raise StructuredTextError("REAL and LREAL stand in one expression")
    return operands


def _converted(value: Any, given: Any, wanted: Any) -> Any:
    if np.asarray(value).dtype != given:
        raise StructuredTextError(f"{np.dtype(given)} is converted, and {np.asarray(value).dtype} came")
    return np.asarray(value).astype(wanted)
