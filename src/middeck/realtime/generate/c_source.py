"""Stand-alone C99 of a package: a header and a source, the same arithmetic as the reference."""

import re
from collections.abc import Iterator
from importlib import resources

import numpy as np

from middeck.errors import ConfigError
from middeck.realtime.package.overflow import when_nothing_overflows
from middeck.realtime.package.package import ControllerPackage, TestVectors, largest
from middeck.realtime.package.package_bytes import hash_package
from middeck.values import record

WIDTH = 110


@record
class CSource:
    """The text of ``NAME.h`` and of ``NAME.c``, which includes it."""

    header: str
    source: str


def generate_c(package: ControllerPackage, name: str = "", header: str = "") -> CSource:
    """C99 that runs ``package``: no library, no allocation, no global state.

    All names begin with ``name`` (by default the package's), in lower case; the source includes the file
    ``header`` (by default the name and ``.h``). With ``-DNAME_MAIN`` the source
    is a program that replays the test vectors, and returns 0 where every bit agrees. Compile with
    ``-ffp-contract=off``. Raises `ConfigError` for a name that C does not allow, and for a package without
    test vectors.
    """
    name = c_name(name or package.name)
    words = _words(package)
    words["header"] = header or f"{name}.h"
    return CSource(*(_fill(_template(f"law.{ending}.in"), words, name) for ending in "hc"))


def c_name(name: str) -> str:
    """``name`` as C names begin; raises `ConfigError` for one that C does not allow."""
    lower = name.lower().replace("-", "_")
    if not re.fullmatch(r"[a-z][a-z0-9_]*", lower):
        raise ConfigError(f"the C name {lower!r}", hint="a letter, then letters, digits and _")
    return lower


def _words(package: ControllerPackage) -> dict[str, str]:
    core, vectors, single = package.core, package.vectors, package.single
    if vectors is None:
        raise ConfigError("a package without test vectors", hint="add_test_vectors(package)")
    reads = zip(package.inputs, package.input_range.tolist(), strict=True)
    limits = zip(
        package.outputs, package.lower.tolist(), package.upper.tolist(), package.slew.tolist(), strict=True
    )
    return {
        "title": package.name,
        "hash": hash_package(package),
        "precision": "Single precision" if single else "Double precision",
        "proved": _range_text(package),
        "form": "dense law" if core.pairs is None else "modal law",
        "period": repr(package.period_s),
        "rate": f"{1.0 / package.period_s:g}",
        "reads": "\n".join(f" *   {i}  {_plain(p.name, p.unit)}  {r:g}" for i, (p, r) in enumerate(reads)),
        "drives": "\n".join(
            f" *   {i}  {_plain(p.name, p.unit)}  {low:g} to {high:g}, {slew:g}"
            for i, (p, low, high, slew) in enumerate(limits)
        ),
        "real": "float" if single else "double",
        "inputs": str(len(package.inputs)),
        "outputs": str(len(package.outputs)),
        "states": str(len(core.A)),
        "filters": str(len(package.filters)),
        "paths": str(len(package.paths)),
        "ramp": str(package.ramp),
        "modal": str(int(core.pairs is not None)),
        "pairs": str(core.pairs or 0),
        "applied": str(int(core.drives)),
        "kernel": _template("kernel.h"),
        "tables": "\n\n".join(law_tables(package)),
        "samples": str(len(vectors.y)),
        "start_level": str(vectors.start_level),
        "vectors": "\n".join(vector_tables(vectors, single)),
    }


def _range_text(package: ControllerPackage) -> str:
    """What is known of a law while its inputs are cut to their ranges, its condition first, as a comment."""
    holds = when_nothing_overflows(package)
    if not holds:
        return "That no operation overflows within the ranges is not known."
    if package.error_bound is None:
        return f"{holds.capitalize()},\n * no operation overflows or gives NaN."
    bounds = ", ".join(f"{bound:.3g}" for bound in package.error_bound.tolist())
    return (
        f"{holds.capitalize()},\n * no operation overflows or gives NaN, and outputs differ from those in "
        f"double precision by at most\n *   {bounds}."
    )


def _plain(name: str, unit: str) -> str:
    """A port in a comment, which no name can end."""
    return re.sub(r"[^][A-Za-z0-9_ .,:;^()/+-]", "_", f"{name} [{unit}]" if unit else name)


def _template(file: str) -> str:
    return resources.files("middeck.realtime.generate").joinpath(file).read_text(encoding="utf-8")


def _fill(text: str, words: dict[str, str], name: str) -> str:
    named = re.sub(r"\blaw(?=_|\.h)", name, re.sub(r"\bLAW(?=_)", name.upper(), text))
    named = re.sub(r"-DLAW(?=_)", f"-D{name.upper()}", named)
    return re.sub(r"@(\w+)@", lambda found: words[found[1]], named)


def literal(value: float, single: bool = False) -> str:
    """A C99 constant of exactly this value; the largest number for inf.

    >>> literal(0.1), literal(-0.5, single=True), literal(float("inf"), single=True)
    ('0x1.999999999999ap-4', '-0x1.0000000000000p-1f', '0x1.fffffe0000000p+127f')
    """
    return float(np.clip(value, -largest(single), largest(single))).hex() + ("f" if single else "")


def law_tables(package: ControllerPackage) -> Iterator[str]:
    """All tables of the law that are not empty; matrices stand column by column.

    Every number is in hexadecimal, so that none is rounded on the way.
    """
    core, single = package.core, package.single
    if core.pairs is None:
        dynamics = {"A": core.A}
    else:
        first = np.arange(core.pairs)
        dynamics = {
            "diagonal": np.diag(core.A),
            "upper": core.A[first, first + core.pairs],
            "lower": core.A[first + core.pairs, first],
        }
    applied = {"E": core.E} if core.drives else {}
    places = [(f.input, 0) for f in package.filters] + [(p.input, p.output) for p in package.paths]
    sections = [place.section for place in (*package.filters, *package.paths)]
    numbers = {
        **dynamics, "B": core.B, "C": core.C, "D": core.D, **applied,
        "sections": np.array([number for s in sections for number in (*s.b, *s.a)]),
        "reach": package.input_range, "least": package.lower, "most": package.upper, "slew": package.slew,
    }  # fmt: skip
    for name, values in numbers.items():
        if values.size:
            yield _table(name, [literal(v, single) for v in np.ravel(values, order="F").tolist()])
    if places:
        rows = ", ".join(f"{{{i}, {o}}}" for i, o in places)
        yield f"static const int place[{len(places)}][2] = {{{rows}}}; /* input, output */"


def vector_tables(vectors: TestVectors, single: bool) -> Iterator[str]:
    """Inputs, engagement and outputs of the test vectors, sample by sample."""
    engaged = ", ".join(str(int(e)) for e in vectors.engaged.tolist())
    yield f"static const int test_engaged[SAMPLES] = {{{engaged}}};"
    for name, rows in (("test_y", vectors.y), ("test_u", vectors.u)):
        yield _table(name, [literal(v, single) for v in rows.ravel().tolist()])


def _table(name: str, words: list[str]) -> str:
    lines, line = [], "   "
    for word in words:
        if len(line) + len(word) + 2 > WIDTH:
            lines.append(line)
            line = "   "
        line += f" {word},"
    body = "\n".join([*lines, line]).rstrip(",")
    return f"static const real {name}[{len(words)}] = {{\n{body}\n}};"
