"""Codons: the integers that a genotype is made of."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

CODON_LIMIT: Final = 2**31 - 1
"""Codons are drawn from `[0, CODON_LIMIT)`."""

Codons = NDArray[np.int32]
"""A genotype [K] or a population of them [P, K]."""
