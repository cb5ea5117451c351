"""``middeck generate``: a controller package of a compensator, and its C."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import middeck as md
from middeck.cli import options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, number, show
from middeck.errors import ConfigError, DataError

EXAMPLES = """\
  middeck generate law.json --rate 500 --limit 0.25 --range 0.1 \\
    -o law.mdk -o law.c
  middeck generate law.mdk --without-applied --single -o small.mdk
"""
LIMITS = ("input_range", "limit", "slew_rate")
NONE = "in no operation, and no NaN: inputs are cut to their ranges"
OWN = "for the law's own commands, applied in full; none is known where others limit or add to them"
PACKAGES = (".mdk", ".json", ".c", ".h")


def _writable(ctx: click.Context, param: click.Parameter, values: tuple[str, ...]) -> tuple[str, ...]:
    for value in values:
        options.require_writable(value, PACKAGES, param.opts[0])
    return values


def _each(flag: str, name: str, help: str) -> Any:
    return click.option(flag, name, type=options.Numbers(), metavar="X[,X...]", help=help)


@click.command("generate", cls=options.Verb, examples=EXAMPLES)
@click.argument("law_file", metavar="LAW.json|mat|mdk")
@options.several(
    "-o",
    "--output",
    "target",
    metavar="FILE.mdk|json|c|h",
    cls=options.OutputOption,
    callback=_writable,
    help="Write the package, its JSON twin, its C source with the header, or the header; may be repeated.",
)
@click.option("--rate", type=options.RATE, metavar="HZ", help="Sampling rate of a continuous law.")
@click.option(
    "--rule",
    type=click.Choice(["tustin", "hold", "matched"]),
    help="How a continuous law is sampled.  [default: tustin]",
)
@_each("--range", "input_range", "Largest magnitude of each input, its unit; one stands for all.")
@_each("--limit", "limit", "Largest magnitude of each output; same.")
@_each("--slew", "slew_rate", "Largest rate of each output, its unit/s; same.")
@click.option(
    "--ramp",
    "ramp_s",
    type=options.NOT_NEGATIVE,
    metavar="SECONDS",
    help="Time to full authority.  [default: 0]",
)
@click.option(
    "--form",
    type=click.Choice(["auto", "modal", "dense"]),
    help="Form of the law; auto is modal where its poles are far enough apart.  [default: auto]",
)
@click.option("--unstable", is_flag=True, help="Declare poles on or outside the unit circle.")
@click.option(
    "--without-applied",
    is_flag=True,
    help="Let the estimator use the commanded outputs, not the applied ones.",
)
@click.option("--single", is_flag=True, help="Single precision, with a proved bound of its error.")
@click.option("--name", metavar="NAME", help="Name of the package.  [default: that of LAW]")
@options.printing
def verb(law_file: str, target: tuple[str, ...], as_json: bool, **given: Any) -> None:
    """Write a compensator as controller package and C code.

    A package is data, identified by its hash: the law, its ports, limits and test vectors. The C code gives
    the same bits as the Python reference on every processor. LAW is a compensator (--rate samples a
    continuous one), or a package to write again or in single precision.
    """
    from middeck.files.laws.packages import write_package

    _require_consistent(target, given)
    with reading(law_file):
        package = _package(law_file, given)
    files = [file for path in target for file in write_package(path, package)]
    document = describe(package, files)
    show(as_json, document, *_tables(document))


def _require_consistent(target: tuple[str, ...], given: dict[str, Any]) -> None:
    from middeck.realtime.generate.c_source import c_name

    for path in map(Path, target):
        if path.suffix.lower() in (".c", ".h"):
            with reading(f"-o {path}"):
                c_name(path.stem)
            options.to_write(str(path.with_suffix(".h")), f"-o {path}")  # which a .c brings along
    if given["single"] and given["form"] == "dense":
        raise ConfigError("--single with --form dense", hint="single precision is modal where it can be")


def _package(law_file: str, given: dict[str, Any]) -> md.ControllerPackage:
    from middeck.cli.given.compensators import load_law
    from middeck.files.disk.kind_of_content import PACKAGE, looks_like
    from middeck.files.laws.packages import AGAIN, load_package
    from middeck.realtime.gate.steps_without_rig import check_vectors
    from middeck.realtime.package.package_law import package_law, without_applied

    limits = {key: given[key] for key in LIMITS if given[key] is not None}
    settings: Any = {key: v[0] if len(v) == 1 else v for key, v in limits.items()}
    if looks_like(law_file) == PACKAGE:
        named = [key for key in ("ramp_s", "rate", "rule", "form", "name") if given[key] is not None]
        if settings or named or given["unstable"]:
            raise ConfigError(
                "name, rate, form, ranges and limits are fixed in a package and cannot be given again",
                where=law_file,
                hint="generate from the compensator",
            )
        package = load_package(law_file)
        step = check_vectors(package)
        if not step.passed:
            raise DataError(f"its test vectors are not this law's: {step.said}", where=law_file, hint=AGAIN)
    else:
        law = load_law(law_file)
        if law.period_s is None:
            if given["rate"] is None:
                raise ConfigError("a continuous law", where=law_file, hint="--rate HZ, at which it is to run")
            law = md.emulate(law, 1.0 / given["rate"], given["rule"] or "tustin")
        elif given["rate"] is not None and not same_rate(law.period_s, given["rate"]):
            raise ConfigError(
                f"--rate is {given['rate']:g} Hz, the law is sampled at {1.0 / law.period_s:g} Hz",
                where=law_file,
                hint="leave --rate out",
            )
        elif given["rule"] is not None:
            raise ConfigError(
                "--rule is for a continuous law; this one is sampled", where=law_file, hint="leave --rule out"
            )
        name = Path(law_file).stem if given["name"] is None else given["name"]
        package = package_law(
            law,
            name,
            ramp_s=given["ramp_s"] or 0.0,
            form=given["form"] or "auto",
            unstable=given["unstable"],
            **settings,
        )
    if given["without_applied"]:
        package = without_applied(package)
    return md.realtime.to_single(package) if given["single"] else package


def same_rate(period_s: float, rate_hz: float) -> bool:
    """Whether the two rates agree to rounding."""
    return abs(period_s * rate_hz - 1.0) < 1e-9


def describe(package: md.ControllerPackage, files: list[Path]) -> dict[str, Any]:
    """The JSON document; null stands for an absent limit."""
    from middeck.files.laws.packages import package_document
    from middeck.realtime.package.package_bytes import encode_package

    keys = (
        "sha256", "name", "period_s", "precision", "unstable", "inputs", "input_range", "outputs", "lower",
        "upper", "slew_per_sample", "ramp_samples", "error_bound",
    )  # fmt: skip
    twin = package_document(package)
    return {
        "schema": "middeck.generate/1",
        **{key: twin[key] for key in keys},
        "error_bound_own": package.error_bound_own if package.single else None,
        "form": "dense" if package.core.pairs is None else "modal",
        "states": len(package.core.A),
        "applied": package.core.drives,
        "pole_radius": package.core.radius,
        "bytes": len(encode_package(package)),
        "samples": len(twin["vectors"].y),
        "files": files,
    }


def _tables(document: dict[str, Any]) -> list[str | ScreenTable]:
    stable = "UNSTABLE by itself, declared" if document["unstable"] else "stable"
    sees = "the torque really applied" if document["applied"] else "the torque asked for"
    ranges = zip(document["inputs"], document["input_range"], strict=True)
    columns = ("lower", "upper", "slew_per_sample", "error_bound")
    none = [None] * len(document["outputs"])
    limits = [none if document[k] is None else document[k] for k in columns]
    outputs = zip(document["outputs"], *limits, strict=True)
    return [
        f"package      {document['name']}, {document['bytes']} bytes, SHA-256 {document['sha256']}",
        f"law          {document['states']} states, {document['form']}, {document['precision']}, {stable}",
        f"rate         {1.0 / document['period_s']:g} Hz, ramp of {document['ramp_samples']} samples",
        f"estimates    from {sees}",
        f"tested by    {document['samples']} samples, to the last bit",
        *(["overflow     " + NONE] if document["error_bound"] is not None else []),
        *(["error bound  " + OWN] if document["error_bound_own"] else []),
        ScreenTable(
            "inputs", ["input", "unit", "range"], [[p.name, p.unit, number(r, "g")] for p, r in ranges]
        ),
        ScreenTable(
            "outputs",
            ["output", "unit", "from", "to", "slew a sample", "error of single"],
            [[p.name, p.unit, *(number(x, "g") for x in numbers)] for p, *numbers in outputs],
        ),
        *(f"wrote        {file}" for file in document["files"]),
    ]
