"""Stand-alone C99 of a package: a header and a source, the same arithmetic as the reference."""

from __future__ import annotations

import re
from importlib import resources

from middeck.errors import ConfigError
from middeck.realtime.generate.c_tables import law_tables, vector_tables
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_bytes import hash_package
from middeck.values import record


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


def _plain(name: str, unit: str) -> str:
    """A port in a comment, which no name can end."""
    return re.sub(r"[^][A-Za-z0-9_ .,:;^()/+-]", "_", f"{name} [{unit}]" if unit else name)


def _template(file: str) -> str:
    return resources.files("middeck.realtime.generate").joinpath(file).read_text(encoding="utf-8")


def _fill(text: str, words: dict[str, str], name: str) -> str:
    named = re.sub(r"\blaw(?=_|\.h)", name, re.sub(r"\bLAW(?=_)", name.upper(), text))
    named = re.sub(r"-DLAW(?=_)", f"-D{name.upper()}", named)
    return re.sub(r"@(\w+)@", lambda found: words[found[1]], named)
