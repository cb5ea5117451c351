"""The console script: runs one verb and turns every ending into a documented exit code.

== ==========================================================================================
 0 done
 1 the answer is no (only where a verdict was asked for)
 2 usage or configuration
 3 an optional package is not installed
 4 bad data
 5 numerical failure: there is no trustworthy answer
70 a fault of middeck itself (EX_SOFTWARE of sysexits.h), so that no script takes it for a "no"
130 interrupted, by Ctrl-C or by SIGTERM
== ==========================================================================================

Nothing heavy is imported before `run` has arranged for interruptions.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    import click

INTERNAL = 70
INTERRUPTED = 130
# None within a name or path: run1.uff, gimbal_1, mode-2, '3', day/4/run.uff.
NUMBER = re.compile(r"""(?<![\w.'"/])(?<!\w-)\d+(\.\d+)?([eE][+-]?\d+)?(?![\w'"/-]|\.\w)""")
NO_NUMBER = re.compile(r"'([^']*)' is not a valid (float|integer)(?: range)?\.$")
SHOWN: Counter[str] = Counter()
"""How often each warning came, numbers aside."""


def run() -> NoReturn:
    """Entry point of the ``middeck`` command."""
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(variable, "1")  # docs/decisions/0004-one-blas-thread.md
    interrupted = catch_interrupts()
    warnings.showwarning = _show_warning  # ty: ignore[invalid-assignment]
    code = execute(sys.argv[1:], interrupted)
    # Python takes handlers away as it ends: a signal that is on its way would kill it.
    signal.signal(signal.SIGALRM, signal.SIG_IGN)
    _count_alike()
    sys.exit(code)


def execute(arguments: Sequence[str], interrupted: Callable[[], bool]) -> int:
    """Run the command line ``arguments``; errors go to stderr, the exit code is returned."""
    try:
        from middeck.cli.app import app

        code = app.main(list(arguments), prog_name="middeck", standalone_mode=False)
        return code if isinstance(code, int) else 0
    except Exception as error:
        signal.setitimer(signal.ITIMER_REAL, 0.0)  # an interruption is lost no more
        if "--debug" in arguments:
            import traceback

            traceback.print_exc()
        if interrupted():  # whatever the interruption was turned into on its way up
            return _fail("interrupted", INTERRUPTED)
        return _explain(_translated(error, arguments))
    except KeyboardInterrupt:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        return _fail("interrupted", INTERRUPTED)


def _translated(error: Exception, arguments: Sequence[str]) -> Exception:
    """The error with its hint in options; what is wrong with a document names keys, not Python."""
    from middeck.errors import MiddeckError

    if not isinstance(error, MiddeckError) or not error.hint or "faults" in error.data:
        return error
    from middeck.cli.app import VERBS, verb_options
    from middeck.cli.shown.advice import on_command_line, public_names

    typed = next((a for a in arguments if a in VERBS), "")
    error.hint = on_command_line(error.hint, typed, {v: verb_options(v) for v in VERBS}, public_names())
    return error


def _explain(error: Exception) -> int:
    import click

    from middeck.errors import MiddeckError

    match error:
        case MiddeckError():
            return _fail(f"error: {error}", error.exit_code)
        case click.Abort():
            return _fail("interrupted", INTERRUPTED)
        case click.exceptions.NoArgsIsHelpError():
            return _fail(error.format_message(), error.exit_code)
        case click.UsageError() if error.ctx is not None:
            return _usage(error, error.ctx)
        case click.ClickException():
            return _fail(f"error: {error.format_message()}", error.exit_code)
        case MemoryError():
            return _fail(f"error: not enough memory: {error}\n  try: fewer states, samples or periods", 5)
        case OSError() if error.filename is not None:
            return _fail(f"error: {error.filename}: {error.strerror}\n  try: another path", 2)
        case _:
            what = " ".join(str(error).split())
            return _fail(
                f"error: a fault of middeck: {type(error).__name__}: {what}; "
                "please report it with what `middeck --version` and the same command with --debug print",
                INTERNAL,
            )


def _usage(error: click.UsageError, context: click.Context) -> int:
    import click

    message = error.format_message()
    known = [name for one in context.command.params for name in one.opts]
    extra = re.search(r"unexpected extra argument \((\S*)\)", message)
    if extra is not None and "--set" in known and (extra[1][:1].isdigit() or "=" in extra[1]):
        message = f"{message}: an override is one word, as --set key=value"
    elif "unexpected extra argument" in message and "--environment" in known:
        message = f"{message}: an environment is an option, as --environment lab"
    if (typed := NO_NUMBER.search(message)) is not None:
        message = message[: typed.start()] + _no_number(*typed.groups())
    if isinstance(error, click.NoSuchOption):
        # Whoever shortens an option means that one, not one of as many letters.
        meant = [f"'{name}'" for name in known if name.startswith(error.option_name)]
        message = f"{error.message} Did you mean {' or '.join(meant)}?" if meant else message
    advice = f"{context.get_usage()}\n  try: {context.command_path} --help"
    return _fail(f"error: {message}\n{advice}", error.exit_code)


def _no_number(typed: str, kind: str) -> str:
    """What stands where an option takes a number."""
    from middeck.files.toml.plain_number import as_number

    number = as_number(typed) if kind == "float" else ""
    wanted = "a number" if kind == "float" else "a whole number"
    return f"{typed!r} is not {wanted}" + (f": a decimal point, as {number}" if number else "")


def _show_warning(message: Warning | str, *place: object) -> None:
    """A library's warning in the form of ours, without the line of code.

    Of warnings that differ in numbers alone, as those of the plants of many draws do, it shows the first.
    """
    words = NUMBER.sub("#", str(message))
    SHOWN[words] += 1
    if SHOWN[words] == 1:
        print(f"warning: {message}", file=sys.stderr)


def _count_alike() -> None:
    alike = SHOWN.total() - len(SHOWN)
    if alike:
        print(f"warning: more that differ from one above in numbers alone: {alike}", file=sys.stderr)


def _fail(message: str, code: int) -> int:
    print(message, file=sys.stderr)
    return code


AGAIN_S = 0.05


def catch_interrupts() -> Callable[[], bool]:
    """Raise KeyboardInterrupt on SIGINT and SIGTERM; the function returned says whether one has come.

    An interruption can be lost on its way up: Python drops what reaches it inside a weak-reference callback
    or a destructor, and an extension that is being imported turns it into an ImportError, which its importer
    may accept. It is therefore raised again every moment while nothing handles it.
    """
    seen: list[int] = []

    def interrupt(number: int, frame: Any) -> None:
        # No thread: one that still raises while Python ends is a fatal error of Python.
        signal.setitimer(signal.ITIMER_REAL, AGAIN_S)
        if number == signal.SIGALRM and _handles_interruption(sys.exc_info()[1]):
            return
        seen.append(number)
        raise KeyboardInterrupt

    def dropped(lost: Any) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            sys.__unraisablehook__(lost)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
        signal.signal(number, interrupt)
    sys.unraisablehook = dropped
    return lambda: bool(seen)


def _handles_interruption(error: BaseException | None) -> bool:
    """Whether a KeyboardInterrupt, or what was raised out of one, is being cleaned up after.

    A generator that it leaves receives its own end alone.
    """
    while error is not None and not isinstance(error, (KeyboardInterrupt, GeneratorExit)):
        error = error.__context__
    return error is not None
