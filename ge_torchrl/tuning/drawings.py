"""Drawings of a study: its history, and what each setting was tried with."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from ge_torchrl.report.html.figures import number
from ge_torchrl.report.html.template import Markup, element, joined
from ge_torchrl.tuning.findings import COMPLETE, ENDED, Findings, Tried
from ge_torchrl.tuning.space import Dimension, shown

# Of the history and of a slice, in pixels: the whole drawing, and the margins around its frame.
_WIDTH, _HEIGHT = 1040, 340
_SMALL_WIDTH, _SMALL_HEIGHT = 270, 180
_LEFT, _RIGHT, _TOP, _BOTTOM = 66, 16, 14, 40
_N_TICKS = 5


class _Scale:
    """From values to pixels; what lies below is drawn at the lower edge."""

    def __init__(self, low: float, high: float, start: float, end: float, *, is_log: bool = False) -> None:
        self._log = is_log
        self.low, self.high, self._start, self._end = low, high, start, end
        self._from, self._to = self._plain(low), self._plain(high)

    def _plain(self, value: float) -> float:
        return math.log(value) if self._log else value

    def __call__(self, value: float) -> float:
        within = min(max(value, self.low), self.high)
        share = (self._plain(within) - self._from) / ((self._to - self._from) or 1.0)
        return round(self._start + share * (self._end - self._start), 1)


def returns_shown(findings: Findings) -> tuple[float, float]:
    """Return the lowest and the highest return that drawings show: poor trials would press all others together."""
    ended = [one.value for one in findings.tried if one.state == COMPLETE and one.value is not None]
    early = [one.value for one in findings.tried if one.state == ENDED and one.value is not None]
    known = sorted(ended or early)
    if not known:
        return 0.0, 1.0
    low, high = known[0], max([*known, *early])
    # The better half of those that ended early.
    low = min([low, *sorted(early)[len(early) // 2 :]])
    room = 0.06 * (high - low) or 0.5
    return low - room, high + room


def history(findings: Findings) -> Markup:
    """Draw what each trial returned, the best so far, and the settings as they stand."""
    low, high = returns_shown(findings)
    last = max((one.number for one in findings.tried), default=1) or 1
    across = _Scale(0, last, _LEFT + 12, _WIDTH - _RIGHT - 12)
    up = _Scale(low, high, _HEIGHT - _BOTTOM, _TOP)
    parts = [*_frame(_WIDTH, _HEIGHT, up, "mean return")]
    parts += _trial_ticks(last, across)
    if findings.untuned is not None and findings.untuned.value is not None:
        y = up(findings.untuned.value)
        parts.append(element("line", class_="untuned", x1=_LEFT, x2=_WIDTH - _RIGHT, y1=y, y2=y))
        parts.append(
            element(
                "text", "untuned", class_="untuned-text", x=_WIDTH - _RIGHT - 6, y=y - 6, text_anchor="end"
            )
        )
    parts.append(element("path", class_="best-line", d=_best_so_far(findings.tried, across, up)))
    best = findings.best
    for one in findings.tried:
        if one.value is not None:
            parts.append(_dot(one, across(one.number), up(one.value), is_best=one is best))
    svg = element("svg", joined(parts), viewBox=f"0 0 {_WIDTH} {_HEIGHT}", role="img", aria_label="History")
    told = "A filled dot is a trial with all of its runs, a ring one that ended early; the line is the best so far."
    if any(one.value is not None and one.value < low for one in findings.tried):
        told += " Poorer ones stand at the lower edge."
    return element(
        "figure",
        joined([element("div", svg, class_="drawing"), element("figcaption", told)]),
        class_="card history",
    )


def slices(findings: Findings, keys: Sequence[str]) -> Markup:
    """Draw what trials returned over the values of each of these settings."""
    space = {one.key: one for one in findings.task.space}
    drawn = [_slice(findings, space[key]) for key in keys]
    return element("div", joined(drawn), class_="slices")


def _slice(findings: Findings, dimension: Dimension) -> Markup:
    low, high = returns_shown(findings)
    up = _Scale(low, high, _SMALL_HEIGHT - _BOTTOM, _TOP)
    ends = (_LEFT + 8, _SMALL_WIDTH - _RIGHT - 8)
    across = _Scale(0, max(len(dimension.choices) - 1, 1), *ends)
    labels = {shown(choice): float(place) for place, choice in enumerate(dimension.choices)}
    if dimension.low is not None and dimension.high is not None:
        across = _Scale(dimension.low, dimension.high, *ends, is_log=dimension.is_log)
        labels = {shown(end): end for end in (dimension.low, dimension.high)}
    parts = [*_frame(_SMALL_WIDTH, _SMALL_HEIGHT, up, "", n_ticks=3)]
    for rank, (label, at) in enumerate(labels.items()):
        anchor = "start" if rank == 0 else "end" if rank == len(labels) - 1 else "middle"
        x = across(at) + {"start": -8, "end": 8}.get(anchor, 0)
        parts.append(
            element("text", label, class_="axis", x=x, y=_SMALL_HEIGHT - _BOTTOM + 16, text_anchor=anchor)
        )
    for one in findings.tried:
        tried = one.values[dimension.key]
        place = labels.get(shown(tried)) if dimension.low is None else tried
        if one.value is not None and isinstance(place, int | float):
            parts.append(_dot(one, across(place), up(one.value), is_best=one is findings.best))
    svg = element(
        "svg",
        joined(parts),
        viewBox=f"0 0 {_SMALL_WIDTH} {_SMALL_HEIGHT}",
        role="img",
        aria_label=dimension.key,
    )
    named = dimension.key + (", by factors" if dimension.is_log else "")
    return element("figure", joined([svg, element("figcaption", named)]), class_="card history")


def _frame(width: int, height: int, up: _Scale, title: str, n_ticks: int = _N_TICKS) -> Iterator[Markup]:
    for tick in _ticks(up.low, up.high, n_ticks):
        y = up(tick)
        yield element("line", class_="grid", x1=_LEFT, x2=width - _RIGHT, y1=y, y2=y)
        yield element(
            "text", f"{tick:g}".replace("-", "\u2212"), class_="axis", x=_LEFT - 8, y=y + 4, text_anchor="end"
        )
    yield element(
        "rect", class_="frame", x=_LEFT, y=_TOP, width=width - _LEFT - _RIGHT, height=height - _TOP - _BOTTOM
    )
    if title:
        yield element(
            "text",
            title,
            class_="axis-title",
            x=16,
            y=height / 2,
            transform=f"rotate(-90 16 {height / 2})",
            text_anchor="middle",
        )


def _trial_ticks(last: int, across: _Scale) -> Iterator[Markup]:
    for tick in _ticks(0, last, 10):
        if tick == int(tick):
            yield element(
                "text",
                f"{tick:g}",
                class_="axis",
                x=across(tick),
                y=_HEIGHT - _BOTTOM + 18,
                text_anchor="middle",
            )
    yield element(
        "text",
        "trial",
        class_="axis-title",
        x=(_LEFT + _WIDTH - _RIGHT) / 2,
        y=_HEIGHT - 6,
        text_anchor="middle",
    )


def _ticks(low: float, high: float, n_at_most: int) -> list[float]:
    """Return round numbers within a range."""
    raw = (high - low) / n_at_most
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= raw)
    first = math.ceil(low / step)
    return [float(f"{place * step:.12g}") for place in range(first, math.floor(high / step) + 1)]


def _best_so_far(tried: Sequence[Tried], across: _Scale, up: _Scale) -> str:
    path, best = "", -math.inf
    for one in tried:
        if one.state == COMPLETE and one.value is not None and one.value > best:
            path += f"L{across(one.number)} {up(best)}" if path else ""
            best = one.value
            path += f"{'L' if path else 'M'}{across(one.number)} {up(best)}"
    return f"{path}L{across(tried[-1].number)} {up(best)}" if path else ""


def _dot(one: Tried, x: float, y: float, *, is_best: bool) -> Markup:
    told = f"trial {one.number}: {number(one.value)}, {one.state}"
    kind = "tried" if one.state == COMPLETE else "ended"
    return element(
        "circle",
        element("title", told),
        class_=f"{kind} best" if is_best else kind,
        cx=x,
        cy=y,
        r=6.5 if is_best else 4.5 if one.state == COMPLETE else 3.5,
    )
