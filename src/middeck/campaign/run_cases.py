"""Run the cases of a campaign that its ledger lacks."""

import contextlib
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from middeck.campaign.cases import Case, cases_digest
from middeck.campaign.encoding import encode_result
from middeck.campaign.executors import Function, find_function, outcomes_of_pool, path_of, run_case
from middeck.campaign.ledger import Ledger, Outcome
from middeck.errors import ConfigError
from middeck.values import record


@record(kw_only=True)
class Progress:
    """Progress of a campaign; ``remaining_s`` by the mean of this run's cases."""

    done: int
    total: int
    faults: int
    elapsed_s: float
    remaining_s: float


@record
class CampaignResult:
    """Outcomes in the order of the cases, and their hash."""

    outcomes: tuple[Outcome, ...]
    digest: str


def run_campaign(
    function: str | Function,
    cases: Sequence[Case],
    ledger: str | Path,
    *,
    inputs: Any = None,
    workers: int = 1,
    progress: Callable[[Progress], None] | None = None,
    clock: Callable[[], float] = time.monotonic,
    again: bool = False,
) -> CampaignResult:
    """Call ``function(case, inputs)`` for every case that the file ``ledger`` lacks.

    Each result is kept as soon as it is there; after Ctrl-C, ``kill -9`` or a full disk the same call goes on
    where it stopped, with identical results. A case that raises an error, or that kills its process, is kept
    as a fault and does not run again unless ``again``.

    Args:
        function: ``"package.module:name"``, or a function at the top of a module; its result must follow from
            case and inputs alone.
        cases: Cases of a sampler.
        ledger: A file for this campaign alone. Function (by name), inputs and cases must be those of its
            first run: `DataError` if not, or while another process is at it.
        inputs: Common to all cases; numbers, text, arrays, and lists and mappings of them (tuples arrive as
            lists, arrays locked).
        workers: 1: in this process; more: in processes, started afresh (spawn).
        progress: Called after each case.
        clock: Seconds.
    """
    path, given = path_of(function), encode_result(inputs)
    find_function(path)
    if workers < 1 or len({c.index for c in cases}) < len(cases):
        raise ConfigError(
            f"{workers} workers, {len(cases)} cases", hint="one worker at least; different indices"
        )
    identity = {"function": path, "inputs": given, "cases": cases_digest(cases)}
    with Ledger(ledger, identity) as book, contextlib.ExitStack() as stack:
        if again:
            book.forget_faults()
        known = book.done()
        left = [c for c in cases if c.index not in known]
        if workers == 1:
            found = ((c.index, *run_case(path, c, given)) for c in left)
        else:
            found = stack.enter_context(contextlib.closing(outcomes_of_pool(workers, path, left, given)))
        start, faults = clock(), sum(known.values())
        for k, (index, fault, body) in enumerate(found, 1):
            book.add(index, body, fault=fault)
            faults += fault
            if progress:
                progress(_progress(len(known), k, len(left), faults, clock() - start))
        return CampaignResult(book.outcomes(), book.digest())


def _progress(known: int, k: int, left: int, faults: int, elapsed_s: float) -> Progress:
    """After ``k`` of the cases that were left, at their mean pace."""
    remaining_s = elapsed_s / k * (left - k)
    done, total = known + k, known + left
    return Progress(done=done, total=total, faults=faults, elapsed_s=elapsed_s, remaining_s=remaining_s)
