"""Hints of the library in the words of the command line: options in place of arguments, and no Python."""

import functools
import pkgutil
import re
from collections.abc import Collection, Mapping
from importlib import import_module
from typing import NamedTuple

import middeck

BESIDE = "in a file beside it, named as the record with .toml added"


class Spoken(NamedTuple):
    """A Python term in a hint, the option for it, and the words for verbs without that option."""

    python: str
    option: str
    words: str
    otherwise: str = ""


SPOKEN = (
    Spoken(
        r"name_columns\(sample_hz=RATE\)", "--sample-hz", "--sample-hz RATE", f"sample_hz = RATE {BESIDE}"
    ),
    Spoken(
        r"name_columns\((\[[^\]]*\]\"\]), (\[[^\]]*\]\"\])\)",
        "--inputs",
        '--inputs "torque [N m]" --outputs "angle [rad]"',
        f"[[channel]] with name, side and unit {BESIDE}",
    ),
    Spoken(r"name_columns\(\[\], \[(\".*?\")\]\)", "--outputs", r"--outputs \1", f"its unit {BESIDE}"),
    Spoken(r"variable=\"NAME\"", "--variable", "--variable NAME", f'variable = "NAME" {BESIDE}'),
    Spoken(r"split_periods\(record, periods\)", "--periods", "--periods N", "a record that is cut into them"),
    Spoken(r"without sample_hz", "--continuous", "--continuous", "a continuous model: identify --continuous"),
    Spoken(r"noise=MeasurementNoise\(([\d.]+), ([\d.]+)\)", "--noise", r"--noise \1,\2", ""),
    Spoken(r"\(count=None\)", "--count", "(--count)", ""),
    Spoken(r"constants='complex'", "--constants", "--constants complex", "complex constants"),
    Spoken(r"delay=False", "--delay", "--delay none", "no delay"),
    Spoken(r" \(delay='output', relative_degree=[01]\)", "", "", ""),
    Spoken(r", sampled=False(?=;)", "", "", ""),
    Spoken(r"a band_hz of", "--band", "a --band of", "a band of"),
    Spoken(r"band_hz=\(low, high\)", "--band", "--band LO,HI", "a narrower band"),
    Spoken(r"Environment\.orbit\(\)", "", "orbit", "orbit"),
    Spoken(r"static=False", "--static", "no --static", ""),
)
CLAUSES = r"(;\s+|,? or\s+)"
CALL = r"\b[A-Za-z_][\w.]*\w\(|(?<![\w.-])[a-z_]+=(?=[\w(\['\"])|\b[A-Z][a-z]+[A-Z]\w*"


@functools.cache
def public_names() -> frozenset[str]:
    """Names of the library and of its rooms."""
    rooms = (import_module(f"middeck.{m.name}") for m in pkgutil.iter_modules(middeck.__path__) if m.ispkg)
    return frozenset(name for place in (middeck, *rooms) for name in getattr(place, "__all__", ()))


def in_options(text: str, own: Collection[str]) -> str:
    """``text`` with the options ``own`` of a verb in place of arguments of the library."""
    for spoken in SPOKEN:
        words = spoken.words if not spoken.option or spoken.option in own else spoken.otherwise
        text = re.sub(spoken.python, words, text)
    return text


def on_command_line(
    hint: str, verb: str, options: Mapping[str, Collection[str]], names: Collection[str]
) -> str:
    """``hint`` for a user of ``verb``.

    ``options`` has those of every verb, ``names`` what the library exports. A clause that still names Python,
    or an option that neither this verb nor one in the hint has, is left out.

    >>> on_command_line("record more, or noise=MeasurementNoise(0.1, 0.2)", "correlate",
    ...                 {"correlate": {"--noise"}}, ())
    'record more, or --noise 0.1,0.2'
    >>> on_command_line("record more; load_campaign takes them", "identify", {}, {"load_campaign"})
    'record more'
    """
    own = options.get(verb, ())
    hint = in_options(hint, own)
    known = {*own, *(o for other in options if re.search(rf"\b{other}\b", hint) for o in options[other])}
    kept = ""
    parts = re.split(CLAUSES, hint)
    for joint, clause in zip(["", *parts[1::2]], parts[::2], strict=True):
        if clause.strip() and not _is_foreign(clause, known, names):
            kept += (joint if kept else "") + clause
    return kept.strip()


def _is_foreign(clause: str, known: Collection[str], names: Collection[str]) -> bool:
    """Whether it names Python, or an option that is not there."""
    words = set(re.findall(r"[A-Za-z_]\w*", clause))
    python = any("_" in word and word in names for word in words) or re.search(CALL, clause) is not None
    return python or not set(re.findall(r"(?<![\w-])--[a-z][\w-]*", clause)) <= {*known, "--help"}
