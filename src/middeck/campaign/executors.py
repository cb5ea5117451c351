"""Call a function for cases: in this process, or on a pool of processes that may die."""

import contextlib
import importlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from middeck.campaign.cases import Case
from middeck.campaign.encoding import decode_result, encode_result
from middeck.errors import ConfigError

Function = Callable[[Case, Any], Any]
DIED = "the worker process died (killed, out of memory, or a fault in compiled code)"


def path_of(function: str | Function) -> str:
    """``"package.module:name"`` of a function that another process can import; `ConfigError` if none can."""
    if isinstance(function, str):
        return function
    path = f"{function.__module__}:{getattr(function, '__qualname__', '')}"
    if function.__module__ == "__main__" or find_function(path) is not function:
        raise ConfigError(f"{path} cannot be imported by another process", hint="a function in a module")
    return path


def find_function(path: str) -> Function:
    """The function of a path; `ConfigError` where there is none."""
    module, _, name = path.partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ConfigError(f"no function {path!r}: {error}", hint="package.module:name") from error


def run_case(path: str, case: Case, given: str) -> tuple[bool, str]:
    """Whether it failed, and the result or the error; inputs are rebuilt, as in another process."""
    try:
        return False, encode_result(find_function(path)(case, decode_result(given)))
    except (Exception, SystemExit) as error:  # leaving the process ends no other case
        return True, f"{type(error).__name__}: {error}"


def outcomes_of_pool(
    workers: int, path: str, cases: Sequence[Case], given: str
) -> Generator[tuple[int, bool, str], None, None]:
    """Outcomes as they come; cases that ran when a process died run again one by one, each in its own."""
    rest = list(cases)
    while rest:
        running: dict[Future[tuple[bool, str]], Case] = {}
        with contextlib.suppress(BrokenProcessPool), _spawned(min(workers, len(rest))) as executor:
            try:
                while rest or running:
                    # Few wait in the queue, so that few are suspected of a death.
                    while rest and len(running) < 2 * workers:
                        running[executor.submit(run_case, path, rest[0], given)] = rest[0]
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
                outcome = executor.submit(run_case, path, rest[0], given).result()
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
