"""Whether the mirror's model is no worse than the published one."""

from __future__ import annotations

from middeck.study.claim import Claim, row
from middeck.study.words import Numbers, percent


def mirror_claims(numbers: Numbers) -> list[Claim]:
    """One for each output."""
    pairs = zip(numbers["held_out_nrmse"], numbers["published_nrmse"], strict=True)
    return [
        row(
            f"mirror, output {k + 1}: held-out NRMSE no worse than the published {percent(theirs)}",
            ours <= theirs,
            percent(ours),
            f"≤ {percent(theirs)}",
        )
        for k, (ours, theirs) in enumerate(pairs)
    ]
