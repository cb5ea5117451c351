"""Options that several verbs share."""

from __future__ import annotations

import datetime
import functools
import os
import shlex
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, TypeVar

import click

from middeck.errors import ConfigError

Command = Callable[..., Any]
F = TypeVar("F", bound=Command)

# What each result can be written as; the writer is chosen by the ending.
FIGURES = (".svg", ".png", ".pdf")
SYSTEMS = (".json", ".mat")
COMMANDS = (".csv", ".npz")
RECORDS = (".npz", ".csv", ".h5", ".hdf5", ".mat", ".uff", ".unv", ".uf", ".58")
RESPONSES = (".uff", ".unv", ".uf", ".58")
# Help of options that `design` and `qualify` share.
SENSOR_NOISE = "Sensor noise, two-sided, output unit/sqrt(Hz)."
INPUT_NOISE = "Noise at the inputs, two-sided, unit/sqrt(Hz)."
# Settings of the app, and of each verb, which may be called by itself.
HELP = {"help_option_names": ["-h", "--help"]}
STREAMS = (".h5", ".hdf5", ".csv")
ARTICLES = (".toml",)
COMPONENTS = (".npz", ".mat")
SURVEYS = (".unv", ".uff", ".json")


class Verb(click.Command):
    """A command with ``examples``, whose options are given once, unless they take several values."""

    def __init__(self, *args: Any, examples: str, **settings: Any) -> None:
        epilog = f"\b\nExamples:\n{examples}"
        super().__init__(*args, epilog=epilog, context_settings=HELP, **settings)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse as click does, but refuse a repeated option, of which click takes the last."""
        try:
            seen: list[click.Parameter] = self.make_parser(ctx).parse_args(list(args))[2]
        except click.UsageError as error:
            error.ctx = ctx  # click sets it in some errors only
            raise
        for param in dict.fromkeys(seen):
            if isinstance(param, click.Option) and _is_single(param) and seen.count(param) > 1:
                raise click.UsageError(f"{'/'.join(param.opts)} takes one value and is given twice", ctx)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the verb, but refuse to write over an input, or twice over one file."""
        try:
            self._keep_apart(ctx)
            return super().invoke(ctx)
        finally:
            _written.clear()

    def _keep_apart(self, ctx: click.Context) -> None:
        taken: dict[str, str] = {}
        for param in sorted(self.params, key=lambda param: isinstance(param, OutputOption)):
            for value in _texts(ctx.params.get(param.name or "")):
                file = os.path.realpath(value)
                named = f"{param.opts[0]} {value}" if isinstance(param, click.Option) else value
                if isinstance(param, click.Argument):
                    refuse_nameless(value, param.make_metavar(ctx))
                if isinstance(param, OutputOption) and file in taken:
                    _refuse_over(named, taken[file])
                if os.path.isfile(file) or isinstance(param, OutputOption):
                    taken[file] = named
                if type(param) is OutputOption:
                    to_write(value, named)


def typed(name: str) -> str:
    """The option of a parameter of the running verb, if it was typed; empty otherwise."""
    context = click.get_current_context(silent=True)
    if context is None or context.get_parameter_source(name) is not click.core.ParameterSource.COMMANDLINE:
        return ""
    return next(param.opts[0] for param in context.command.params if param.name == name)


def refuse_unused(where: str, *names: str) -> None:
    """Refuse typed parameters of the running verb that have no effect ``where`` they stand."""
    for option in filter(None, map(typed, names)):
        raise ConfigError(f"{option} has no effect {where}", hint="leave one of them out")


class OutputOption(click.Option):
    """An option that names a file to write."""


class Updated(OutputOption):
    """An option that names a file to read, then write."""


_written: dict[str, str] = {}
"""Files that the verb that runs is to write, as typed."""


def _refuse_reading(event: str, args: tuple[Any, ...]) -> None:
    """Refuse to read what is to be written, whichever document names it (an audit hook, PEP 578).

    All writers write beside it and rename. HDF5 opens its files itself and is not seen.
    """
    if event == "open" and _written and isinstance(args[0], str):
        named = _written.get(os.path.realpath(args[0]))
        if named is not None and os.path.isfile(args[0]):
            _refuse_over(named, args[0])


sys.addaudithook(_refuse_reading)


def to_write(file: str, named: str) -> None:
    """Refuse from now on to read ``file``, which the verb will also write."""
    _written[os.path.realpath(file)] = named


def _refuse_over(named: str, taken: str) -> NoReturn:
    raise ConfigError(f"would be written over {taken}", where=named, hint="another file to write")


def _texts(value: Any) -> list[str]:
    """The words of an option or argument, which may be repeated and have several parts."""
    if isinstance(value, tuple):
        return [text for part in value for text in _texts(part)]
    return [value] if isinstance(value, str) else []


def _is_single(option: click.Option) -> bool:
    """Whether a second one would contradict the first."""
    return not option.multiple and (not option.is_flag or bool(option.secondary_opts))


class Real(click.FloatRange):
    """A number within its range; its square is zero or a normal number."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number of ``value``; fails on NaN, infinity and magnitudes beyond 1e-100 to 1e100."""
        number = super().convert(value, param, ctx)
        if not _is_usual(number):
            self.fail(f"{value} is {UNUSUAL}", param, ctx)
        return number


POSITIVE, NOT_NEGATIVE = Real(min=0.0, min_open=True), Real(min=0.0)
RATE = Real(1e-6, 1e9)
UNUSUAL = "not a finite number of a magnitude from 1e-100 to 1e100"


def _is_usual(number: float) -> bool:
    return number == 0.0 or 1e-100 <= abs(number) <= 1e100


class Numbers(click.ParamType[tuple[float, ...]]):
    """Numbers separated by commas; exactly ``count`` of them if given."""

    name = "numbers"

    def __init__(self, count: int = 0) -> None:
        self.count = count

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The numbers of ``value``; fails on those that `Real` fails on."""
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers such as 0.5,1,8", param, ctx)
        if not all(map(_is_usual, numbers)):
            self.fail(f"{value!r} holds what is {UNUSUAL}", param, ctx)
        if self.count and len(numbers) != self.count:
            self.fail(f"{value!r} has {len(numbers)} numbers; must be {self.count}", param, ctx)
        return numbers


class Frequencies(Numbers):
    """Frequencies within those of `RATE` [Hz]."""

    name = "frequencies"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The numbers of ``value``; fails on any out of range, and on a band that does not rise."""
        numbers = super().convert(value, param, ctx)
        if not 1e-6 <= min(numbers) <= max(numbers) <= 1e9:
            self.fail(f"{value!r} holds a frequency that is not > 0 Hz, from 1e-6 to 1e9", param, ctx)
        if self.count == 2 and not numbers[0] < numbers[1]:
            self.fail(f"{value!r} does not rise from lowest to highest", param, ctx)
        return numbers


def printing(command: F) -> F:
    """``--json`` and ``--debug``, which every verb has."""
    show = click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error.")
    return click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")(show(command))


def defaulted(*flags: str, default: Any, help: str, **settings: Any) -> Callable[[F], F]:
    """An option whose default the help shows."""
    return click.option(*flags, default=default, show_default=True, help=help, **settings)


def several(*flags: str, metavar: str, help: str, **settings: Any) -> Callable[[F], F]:
    """An option that may be repeated."""
    return click.option(*flags, multiple=True, metavar=metavar, help=help, **settings)


def common(command: F) -> F:
    """``--set``, ``--json`` and ``--debug``, of every verb that reads something."""
    change = several("--set", "overrides", metavar="KEY=VALUE", help="Override an input value.")
    return change(printing(command))


def day(given: str | None) -> str:
    """The date given, else today's. Raises `ConfigError` for another form than 2026-11-23."""
    if given is None:
        return datetime.datetime.now(datetime.UTC).date().isoformat()
    try:
        return datetime.date.fromisoformat(given).isoformat()
    except ValueError:
        raise ConfigError(f"{given!r} is no date", where="--date", hint="e.g. 2026-11-23") from None


article = click.argument("article")
environment = defaulted(
    "--environment", default="lab", metavar="NAME|PATH", help="orbit, lab, or an environment file."
)
load_case = click.option(
    "--load-case", metavar="NAME", help="Apply a load case of the article.  [default: none]"
)


class TypedSetup(NamedTuple):
    """An article in an environment, as typed: names, ``--set``, and a load case."""

    article: str
    environment: str
    overrides: tuple[str, ...]
    load_case: str | None


def _as_one(name: str, kind: Any, *asked: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """The options ``asked``, which reach a verb as one value; a field without one takes the verb's own."""

    def decorate(command: Command) -> Command:
        @functools.wraps(command)
        def gathered(**given: Any) -> Any:
            one = kind(**{field: given.pop(field) for field in kind.__annotations__})
            return command(**{name: one}, **given)

        made: Command = gathered
        for option in reversed(asked):
            made = option(made)
        return made

    return decorate


case = _as_one("case", TypedSetup, article, environment, load_case)


count = defaulted("--count", default=26, type=click.IntRange(min=1), help="Number of modes, lowest first.")
_environments = several(
    "--environment",
    "environments",
    metavar="NAME|PATH",
    help="Environment of the articles; may be repeated.  [default: lab]",
)
_shifts = several(
    "--shift",
    "shifts",
    type=(str, Real(0.0, 100.0, min_open=True, max_open=True)),
    metavar="MODES PERCENT",
    help="Shift the frequencies of MODES, a name or LO:HI in Hz, together by -PERCENT and +PERCENT.",
)
_delay_ms = click.option(
    "--delay-ms", type=Real(0.0, 1e6), default=0.0, help="Delay added to each plant [ms]."
)
_sweep = click.option(
    "--sweep",
    is_flag=True,
    help="Shift first bending by 10 % and other flexible modes by 20 %, down and up, alone and together.",
)
_first_bending = click.option(
    "--first-bending",
    metavar="MODES",
    help="Modes that --sweep shifts by 10 %, by name or LO:HI in Hz; needed for a fitted model.",
)


@dataclass(frozen=True, kw_only=True)
class TypedPlants:
    """The plants, as typed, on which a compensator is tried."""

    plants: tuple[str, ...]
    environments: tuple[str, ...]
    load_case: str | None
    count: int
    overrides: tuple[str, ...]
    shifts: tuple[tuple[str, float], ...]
    sweep: bool
    first_bending: str | None
    delay_ms: float

    @property
    def delay_s(self) -> float:
        """Delay added to each plant [s]."""
        return 1e-3 * self.delay_ms


_plants = click.argument("plants", nargs=-1, required=True, metavar="PLANT...")
tried = _as_one(
    "tried", TypedPlants, _plants, _environments, load_case, count, _shifts, _sweep, _first_bending, _delay_ms
)
band = click.option("--band", "band_hz", type=Frequencies(2), metavar="LO,HI", help="Band to fit [Hz].")
periods = click.option(
    "--periods",
    type=click.IntRange(min=1),
    help="Number of whole steady periods in each RECORD.  [default: as its file says]",
)
states = click.option(
    "--states", type=click.IntRange(min=1), help="Order of the fit.  [default: recommended]"
)


def written(
    *flags: str, endings: Sequence[str], help: str, metavar: str = "", cls: type[OutputOption] = OutputOption
) -> Callable[[F], F]:
    """An option for a file to write; see `require_writable`."""

    def check(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
        if value is not None:
            require_writable(value, endings, param.opts[0])
        return value

    named = metavar or f"FILE{'|'.join(endings)}"
    return click.option(*flags, cls=cls, metavar=named, callback=check, help=help)


def output(name: str, endings: Sequence[str], help: str, metavar: str = "") -> Callable[[F], F]:
    """The option ``-o`` for the file of the result."""
    return written("-o", "--output", name, endings=endings, metavar=metavar, help=help)


model_file = output("model_file", SYSTEMS, "Write the model.", "MODEL.json|mat")


def require_writable(path: str, endings: Sequence[str], option: str) -> None:
    """Refuse, before any work, a file in a missing folder or with an ending that no writer has."""
    refuse_nameless(path, option)
    file = Path(path)
    where, known = f"{option} {path}", ", ".join(endings)
    if file.is_dir():
        raise ConfigError("is a folder, not a file", where=where, hint=f"a file in it that ends in {known}")
    if file.suffix.lower() not in endings:
        what = f"no writer for {file.suffix!r} files" if file.suffix else "no ending says what to write"
        raise ConfigError(what, where=where, hint=f"a file that ends in {known}")
    if _folder_above(file, where) != file.parent:
        raise ConfigError("no such folder", where=where, hint=f"mkdir -p {shlex.quote(str(file.parent))}")
    _refuse_locked(file.parent, where)


def _folder_above(path: Path, where: str) -> Path:
    """The nearest folder above ``path`` that is there; raises `ConfigError` where a file is in its place."""
    above = next(p for p in path.parents if p.exists())
    if not above.is_dir():
        raise ConfigError(f"no such folder: {above} is a file", where=where, hint="another folder")
    return above


def refuse_nameless(name: str, option: str) -> None:
    """Refuse the empty name that a variable without a value leaves."""
    if not name.strip():
        raise ConfigError("no name of a file: the text is empty", where=option, hint="the path of a file")


def _refuse_locked(folder: Path, where: str) -> None:
    """Refuse a folder that takes no new file; the system is asked, as rights alone do not decide."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        what = f"{error.strerror}: no file can be written there"
        raise ConfigError(what, where=where, hint="a folder of yours") from None


def require_folder(ctx: click.Context, param: click.Parameter, name: str) -> Path:
    """Refuse, before any work, a folder of results whose name or place is taken by a file."""
    refuse_nameless(name, param.opts[0])
    value = Path(name)
    where = f"{param.opts[0]} {value}"
    if value.exists() and not value.is_dir():
        raise ConfigError("is a file, not a folder", where=where, hint="another name")
    if value.suffix.lower() in (".html", ".htm", ".pdf", *FIGURES, *SYSTEMS, *RECORDS):
        hint = f"a folder, such as {value.with_suffix('')}"
        raise ConfigError(f"a study fills a folder, not a {value.suffix} file", where=where, hint=hint)
    _refuse_locked(value if value.is_dir() else _folder_above(value, where), where)
    return value


def listed(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...] | None:
    """A callback for an option of names that may be repeated: all of them, None without any."""
    return names(ctx, param, value) or None


def names(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
    """`listed` with an empty tuple in place of None."""
    return separate_names(value, param.opts[0])


def chained(
    ctx: click.Context, param: click.Parameter, value: tuple[tuple[float, ...], ...]
) -> tuple[float, ...] | None:
    """`listed` for numbers."""
    return tuple(number for group in value for number in group) or None


def separate_names(values: tuple[str, ...], option: str) -> tuple[str, ...]:
    """Names given by several options, by commas or both; raises `ConfigError` for an empty text.

    >>> separate_names(("a,b", "c"), "--input")
    ('a', 'b', 'c')
    """
    if not all(value.strip(", ") for value in values):
        what = "an option that takes names has none"
        raise ConfigError(what, where=option, hint="a name, or leave the option out")
    return tuple(name.strip() for value in values for name in value.split(",") if name.strip())


if TYPE_CHECKING:
    from middeck.files.records import Columns


class ColumnsTyped(NamedTuple):
    """Inputs and outputs among the columns of a record file, as typed."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sample_hz: float | None
    variable: str

    def named(self) -> Columns | None:
        """Columns by the options; None without any: a file of channels beside the record is then read."""
        from middeck.files.records import name_columns

        u, y = ([text for value in side for text in value.split(",")] for side in (self.inputs, self.outputs))
        return name_columns(u, y, sample_hz=self.sample_hz, variable=self.variable)


_named = functools.partial(several, metavar="COLUMNS")
columns = _as_one(
    "columns",
    ColumnsTyped,
    _named("--inputs", help='Input columns: "torque [N m]", "2=torque [N m]"; may be repeated.'),
    _named("--outputs", help='Output columns: "angle [rad]", "3=angle [rad]"; may be repeated.'),
    click.option("--sample-hz", type=RATE, metavar="HZ", help="Sampling rate, if the file has none."),
    click.option("--variable", default="", metavar="NAME", help="Name of the matrix in a MAT or HDF5 file."),
)
