"""Run the cases of a campaign that its ledger lacks, in this process or on a pool of processes."""

import contextlib
import importlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from middeck.campaign.cases import Case, cases_digest
from middeck.campaign.encoding import decode_result, encode_result
from middeck.campaign.ledger import Ledger, Outcome
from middeck.errors import ConfigError
from middeck.values import record

Function = Callable[[Case, Any], Any]
DIED = "the worker process died (killed, out of memory, or a fault in compiled code)"


@record(kw_only=True)
class Progress:
    """How far a campaign is; ``remaining_s`` by the mean of this run's cases."""

    done: int
    total: int
    faults: int
    elapsed_s: float
    remaining_s: float


@record
class CampaignResult:
    """Outcomes in the order of the cases, and the hash of them all."""

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
    path, given = _path_of(function), encode_result(inputs)
    _find(path)
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
            found = ((c.index, *_work(path, c, given)) for c in left)
        else:
            found = stack.enter_context(contextlib.closing(_on_pool(workers, path, left, given)))
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


def _path_of(function: str | Function) -> str:
    if isinstance(function, str):
        return function
    path = f"{function.__module__}:{getattr(function, '__qualname__', '')}"
    if function.__module__ == "__main__" or _find(path) is not function:
        raise ConfigError(f"{path} cannot be imported by another process", hint="a function in a module")
    return path


def _find(path: str) -> Function:
    module, _, name = path.partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ConfigError(f"no function {path!r}: {error}", hint="package.module:name") from error


def _work(path: str, case: Case, given: str) -> tuple[bool, str]:
    """Whether it failed, and the result or the error; inputs are made anew, as if in another process."""
    try:
        return False, encode_result(_find(path)(case, decode_result(given)))
    except (Exception, SystemExit) as error:  # leaving the process ends no other case
        return True, f"{type(error).__name__}: {error}"


def _on_pool(
    workers: int, path: str, cases: Sequence[Case], given: str
) -> Generator[tuple[int, bool, str], None, None]:
    """Outcomes as they come; after a death, what ran then runs again one by one, each in its own process."""
    rest = list(cases)
    while rest:
        running: dict[Future[tuple[bool, str]], Case] = {}
        with contextlib.suppress(BrokenProcessPool), _spawned(min(workers, len(rest))) as executor:
            try:
                while rest or running:
                    # Few wait in the queue, so that few are suspected of a death.
                    while rest and len(running) < 2 * workers:
                        running[executor.submit(_work, path, rest[0], given)] = rest[0]
                        rest.pop(0)
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        outcome = future.result()
                        yield running.pop(future).index, *outcome
            except BaseException:
                executor.shutdown(wait=False, cancel_futures=True)
                raise
        if running:
            yield from _one_by_one(path, list(running.values()), given)


def _one_by_one(path: str, cases: Sequence[Case], given: str) -> Generator[tuple[int, bool, str], None, None]:
    """A death is then known to be that of its case. Raises `ConfigError` where no process comes to a case."""
    rest = list(cases)
    while rest:
        with contextlib.suppress(BrokenProcessPool), _spawned(1) as executor:
            _await_start(executor)
            while rest:
                outcome = executor.submit(_work, path, rest[0], given).result()
                yield rest.pop(0).index, *outcome
        if rest:
            yield rest.pop(0).index, True, DIED


def _await_start(executor: ProcessPoolExecutor) -> None:
    """A process that dies before it has a case dies of the script that it imports, not of a case."""
    try:
        executor.submit(os.getpid).result()
    except BrokenProcessPool as error:
        raise ConfigError(
            "the worker processes end before their first case",
            where="campaign",
            hint='in a script, the call goes under if __name__ == "__main__": they import the script',
        ) from error


def _spawned(workers: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _begin_worker)


def _begin_worker() -> None:
    """Ctrl-C ends a worker in silence, and none outlives the campaign's process."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent:
        parent.join()
        os._exit(1)
