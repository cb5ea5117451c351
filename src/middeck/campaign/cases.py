"""Cases of a campaign: frozen values with an index, a seed and named numbers."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.values import record


@record
class Case:
    """One case; equal cases have equal results.

    Attributes:
        index: Place in the campaign, from 0.
        seed: Seed of the case's own random numbers, ``numpy.random.default_rng(case.seed)``.
        names, values: The sampled parameters.
    """

    index: int
    seed: int
    names: tuple[str, ...]
    values: Float[np.ndarray, " parameter"]

    def __getitem__(self, name: str) -> float:
        return float(self.values[self.names.index(name)])


def case_seed(seed: int, index: int) -> int:
    """Seed of case ``index``, independent of the number of cases, their order and the workers.

    The child ``index`` of ``SeedSequence(seed).spawn``, as 128 bits.

    >>> case_seed(7, 3) == case_seed(7, 3) != case_seed(7, 4)
    True
    """
    words = np.random.SeedSequence(seed, spawn_key=(index,)).generate_state(4)
    return sum(int(word) << (32 * k) for k, word in enumerate(words))


def cases_digest(cases: Sequence[Case]) -> str:
    """Hash of all indices, seeds, names and values, to the last bit."""
    found = hashlib.sha256()
    for case in cases:
        text = json.dumps([case.index, case.seed, case.names, [float(v).hex() for v in case.values]])
        found.update(text.encode() + b"\n")
    return found.hexdigest()
