"""Write-back: a tree becomes one of the grammar's constants, and then a genotype; the inverse of the mapping."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ge_torchrl.errors import UnencodableTreeError
from ge_torchrl.ge.codons import CODON_LIMIT, Codons
from ge_torchrl.ge.derivations import Derivations
from ge_torchrl.ge.rule_tables import CHOICE, RANGE, RuleTables
from ge_torchrl.ge.snapping import constants_near, snap
from ge_torchrl.trees.tree import DecisionTree

__all__ = ["can_derive", "constants_near", "encode", "snap"]


def encode(tree: DecisionTree, codons: Codons, tables: RuleTables, wraps: int = 0) -> Codons:
    """Edit a genotype so that it maps to the snapped tree: `map(encode(tree, codons)) == snap(tree)`.

    Where the current codon makes a choice that leads to the tree, it stays. Else it becomes
    `codon - codon % n + choice`, the way back from `codon % n`. Codons that the mapping does not read stay.
    Where reading wraps around, a codon has to serve every choice that reads it; those made first are not
    reconsidered.

    Args:
        tree: The tree.
        codons: [K] int32, the genotype to edit.
        tables: The compiled grammar.
        wraps: How many times the mapping may wrap.

    Returns:
        [K] int32, a new genotype.

    Raises:
        UnencodableTreeError: The grammar cannot derive the tree, the genotype is too short for it, or
            wrapping makes one codon serve two choices that exclude each other.
    """
    target = snap(tree, tables.grammar)
    derivations = Derivations(target, tables)
    needed, readable = derivations.fewest_codons_of_all, len(codons) * (wraps + 1)
    if needed == math.inf:
        raise UnencodableTreeError(
            f"no derivation from <{tables.grammar.start.name}> gives this tree of {_number_of_splits(target)}"
        )
    if needed > readable:
        raise UnencodableTreeError(
            f"the tree needs at least {needed:.0f} codons; the genotype of {len(codons)} gives {readable} "
            f"with {wraps} wraps"
        )
    return _edited(_Genotype(codons), derivations, tables, readable - needed)


def _edited(genotype: _Genotype, derivations: Derivations, tables: RuleTables, spare: float) -> Codons:
    """Read a genotype from its beginning and make its choices lead to the tree, with some codons to spare."""
    position, length = 0, len(derivations.sentence.words) - 1
    # The bodies that are not over: the next symbol, and where each of the symbols left may end.
    open_bodies = [(0, derivations.afters(0, 0, {length: 0}))]
    while open_bodies:
        at, afters = open_bodies.pop()
        kind, argument = derivations.symbols[at]
        after = afters[0]
        if len(afters) > 1:
            open_bodies.append((at + 1, afters[1:]))
        if kind == CHOICE:
            bodies = tables.rule_bodies[argument]
            costs = [derivations.fewest_codons(body, position, after) for body in bodies]
            longer = [cost - min(costs) for cost in costs]
            possible = [choice for choice in range(len(bodies)) if longer[choice] <= spare]
            choice = genotype.choose(len(bodies), sorted(possible, key=longer.__getitem__))
            spare -= longer[choice]
            open_bodies.append((bodies[choice], derivations.afters(bodies[choice], position, after)))
            continue
        ends = {end: after[end] for end in derivations.ends(at, position) if end in after}
        end = min(ends, key=ends.__getitem__)
        if kind == RANGE:
            choices = {
                choice: of
                for of in sorted(ends, key=ends.__getitem__)
                if ends[of] - ends[end] <= spare
                for choice in derivations.constants_at(argument, position, of, genotype.codon)
            }
            shortest = ends[end]
            end = choices[genotype.choose(tables.ranges[argument].count, list(choices))]
            spare -= ends[end] - shortest
        position = end
    return genotype.codons


def can_derive(tree: DecisionTree, tables: RuleTables) -> bool:
    """Tell whether a grammar derives a tree, once it is snapped to the grammar's constants.

    Args:
        tree: The tree.
        tables: The compiled grammar.
    """
    try:
        target = snap(tree, tables.grammar)
    except UnencodableTreeError:
        return False
    return Derivations(target, tables).fewest_codons_of_all < math.inf


class _Genotype:
    """A genotype that is edited while it is read."""

    def __init__(self, codons: Codons) -> None:
        self.codons = codons.copy()
        self._position = 0
        # An earlier choice among n leaves a codon free to change by multiples of n only.
        self._moduli = [1] * len(codons)

    @property
    def codon(self) -> int:
        """The codon to be read next."""
        return int(self.codons[self._position])

    def choose(self, n_choices: int, wanted: Sequence[int]) -> int:
        """Read a codon and make the first of the wanted choices that it can, its own before all others."""
        codon, modulus = self.codon, self._moduli[self._position]
        for choice in sorted(wanted, key=lambda choice: choice != codon % n_choices):
            changed = _change_codon(codon, modulus, n_choices, choice)
            if changed is not None:
                self.codons[self._position] = changed
                self._moduli[self._position] = math.lcm(modulus, n_choices)
                self._position = (self._position + 1) % len(self.codons)
                return choice
        raise UnencodableTreeError(
            f"codon {self._position} is read again after a wrap and cannot make both choices; "
            "a longer genotype could"
        )


def _change_codon(codon: int, modulus: int, n_choices: int, choice: int) -> int | None:
    """Return a codon near this one that makes a choice and leaves the same remainder by `modulus`.

    Both congruences together fix the remainder by `lcm(modulus, n_choices)` (Chinese remainder theorem); None
    where they exclude each other or leave no codon below the limit.
    """
    common, period = math.gcd(modulus, n_choices), math.lcm(modulus, n_choices)
    if (choice - codon) % common:
        return None
    steps = (choice - codon) // common * pow(modulus // common, -1, n_choices // common)
    changed = codon - codon % period + (codon + modulus * steps) % period
    if changed >= CODON_LIMIT:
        changed -= period
    return changed if changed >= 0 else None


def _number_of_splits(tree: DecisionTree) -> str:
    number = tree.num_decision_nodes
    return f"{number} decision node{'s' * (number != 1)}"
