"""A promise's draws as a campaign: on several processes, kept in a ledger that outlives a kill."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from middeck.campaign.cases import Case
from middeck.campaign.run_cases import Progress, run_campaign
from middeck.errors import DataError, NumericalError
from middeck.files.promises.plans import load_plan
from middeck.files.promises.promise_documents import hash_files, versions
from middeck.updating.promise.blocks_of_draws import (
    BLOCK,
    Measured,
    Site,
    blocks,
    measure_block,
    restore_block,
    values_of,
)
from middeck.updating.promise.plan import Plan
from middeck.updating.promise.promise import set_sites
from middeck.updating.refinement.refine import Refined, refine

FIELDS = ("environment", "block")
"""Fields of a case: which environment of the plan, from 0, and which block of its draws."""
LATEST: dict[tuple[str, str, tuple[tuple[str, str], ...]], tuple[Site, ...]] = {}
"""Sites of the latest article, plan and digests in this process, shared by all blocks that it measures."""


def measured_in_ledger(
    refined: Refined,
    plan: Plan,
    files: tuple[Path, Path],
    digests: Sequence[tuple[str, str]],
    ledger: str | Path,
    *,
    workers: int = 1,
    progress: Callable[[Progress], None] | None = None,
) -> dict[str, list[Measured]]:
    """Blocks of draws by environment, as `promise` takes them; those in ``ledger`` are not computed again.

    ``files`` are article and plan, from which each further process refines anew, and ``digests`` the names
    and hashes of all files behind them. Raises `NumericalError` for a block that failed; it runs again with
    the next call. Raises `DataError` for the ledger of another promise, and as `run_campaign`.
    """
    sites, count = set_sites(refined, plan), blocks(plan)
    both = [(e, k) for e in range(len(sites)) for k in range(count)]
    cases = [Case(i, i, FIELDS, np.array(at, dtype=float)) for i, at in enumerate(both)]
    inputs = {
        "article": str(files[0].resolve()),
        "plan": str(files[1].resolve()),
        "files": digests,
        "versions": versions(),
    }
    _keep(inputs["article"], inputs["plan"], tuple(digests), tuple(sites.values()))
    done = run_campaign(
        measured_case, cases, ledger, inputs=inputs, workers=workers, progress=progress, again=True
    )
    for outcome, (_, k) in zip(done.outcomes, both, strict=True):
        if outcome.fault is not None:
            raise NumericalError(
                outcome.fault,
                where=f"{ledger}, draws from {k * BLOCK}",
                hint="run it again: finished blocks stay in the ledger, failed ones are repeated",
            )
    results = iter([outcome.result for outcome in done.outcomes])
    return {name: [restore_block(next(results), site) for _ in range(count)] for name, site in sites.items()}


def measured_case(case: Case, inputs: Mapping[str, Any]) -> dict[str, Any]:
    """A block of draws, from files alone."""
    digests = tuple((name, digest) for name, digest in inputs["files"])
    sites = _sites(inputs["article"], inputs["plan"], digests)
    site = sites[int(case["environment"])]
    return values_of(measure_block(site, int(case["block"])))


def _sites(article: str, plan: str, digests: tuple[tuple[str, str], ...]) -> tuple[Site, ...]:
    if (article, plan, digests) in LATEST:
        return LATEST[article, plan, digests]
    loaded = load_plan(plan, article)
    if hash_files(loaded.files) != digests:
        raise DataError(
            "a file behind the promise was changed while it was made",
            where=plan,
            hint="start again from files that stay as they are",
        )
    refined = refine(loaded.structure, *loaded.refinement.of_refine)
    return _keep(article, plan, digests, tuple(set_sites(refined, loaded.plan).values()))


def _keep(
    article: str, plan: str, digests: tuple[tuple[str, str], ...], sites: tuple[Site, ...]
) -> tuple[Site, ...]:
    LATEST.clear()
    LATEST[article, plan, digests] = sites
    return sites
