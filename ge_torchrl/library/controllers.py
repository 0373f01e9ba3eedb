"""Controllers by their number of decision nodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ge_torchrl.library.controller import Controller


class Controllers(Mapping[int, Controller]):
    """The best controller of each number of decision nodes, from small to large.

    Args:
        by_nodes: The controllers.
    """

    def __init__(self, by_nodes: Mapping[int, Controller]) -> None:
        self._by_nodes = {nodes: by_nodes[nodes] for nodes in sorted(by_nodes)}

    def __getitem__(self, nodes: int) -> Controller:
        try:
            return self._by_nodes[nodes]
        except (KeyError, TypeError):
            there = (
                f"there are {', '.join(map(str, self._by_nodes))}" if self._by_nodes else "the run kept none"
            )
            raise KeyError(f"no controller with {nodes!r} decision nodes; {there}") from None

    def __iter__(self) -> Iterator[int]:
        return iter(self._by_nodes)

    def __len__(self) -> int:
        return len(self._by_nodes)

    def __repr__(self) -> str:
        return "\n\n".join(map(repr, self.values())) or "no controllers: the run kept none"

    def _repr_markdown_(self) -> str:
        return f"```text\n{self!r}\n```"
