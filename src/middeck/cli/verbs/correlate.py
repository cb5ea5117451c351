"""``middeck correlate``: a model against measured modes, judged by a profile of criteria."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import figures, options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, case_lines, show
from middeck.errors import ConfigError
from middeck.study.words import fields

if TYPE_CHECKING:
    import numpy as np

    from middeck.structure.correlation.correlate import Correlation, Finding
    from middeck.structure.correlation.frequencies import FrequencyComparison
    from middeck.structure.correlation.review_criteria import Profile

EXAMPLES = """\
  middeck correlate articles/mace-simple.toml \\
    data/virtual-survey/mace-simple-lab.json
  middeck correlate articles/mace-simple.toml \\
    data/virtual-survey/mace-simple-lab.json \\
    --profile orion-adequate --reduction guyan --json
"""
# As in structure/correlation (profiles, reduction), which --help must not import; a test holds them together.
PROFILES = ("ecss-e-st-32-11c", "nasa-std-5002", "smc-s-004", "orion-well", "orion-adequate", "coppolino")
REDUCTIONS = ("serep", "guyan", "irs")
QUANTITIES = (
    "frequency-error", "cross-off-diagonal", "self-off-diagonal", "cross-diagonal", "mac", "comac",
)  # fmt: skip
SHOWN = 6
NEAR = 1.1  # times the highest measured frequency: modes of the model that the test is about
PAIRS_NOTE = """\
cross: cross-orthogonality of the pair (1 is equality); off: its largest value
with another pair's mode. self off: largest orthogonality of the measured mode
with another measured one. All use the model's mass reduced to the sensors."""
EFFECTIVE_NOTE = """\
Share of the mass, and of the inertia about the centre of mass (rx, ry, rz), that
a mode represents when the supports move. The suspension modes have most of it if
the article hangs, the rigid-body modes all of it if the article is free. The mass at
clamped nodes belongs to no mode, so that the sum is then below 100 %."""


@click.command("correlate", cls=options.Verb, examples=EXAMPLES)
@options.case
@click.argument("test", metavar="MODES")
@options.defaulted(
    "--profile",
    default=PROFILES[0],
    type=click.Choice(PROFILES),
    metavar="NAME",
    help=f"Criteria: {', '.join(PROFILES)}.",
)
@options.several(
    "--limit",
    "limits",
    metavar="QUANTITY VALUE",
    type=(click.Choice(QUANTITIES), options.Real(0.0, 1.0)),
    help=f"Another limit than the profile's, for all its modes, repeatable: {', '.join(QUANTITIES)}.",
)
@options.defaulted(
    "--reduction",
    default=REDUCTIONS[0],
    type=click.Choice(REDUCTIONS),
    help="Reduction of the mass matrix to the sensors.",
)
@click.option(
    "--noise",
    type=options.Numbers(2),
    metavar="F,S",
    help="Standard deviations of frequencies and shapes, relative.  [default: as the test states]",
)
@options.defaulted("--runs", default=1000, type=click.IntRange(min=1), help="Noisy tests of a correct model.")
@options.defaulted("--seed", default=0, type=click.IntRange(min=0), help="Seed of the noise.")
@click.option("--require", is_flag=True, help="End with exit code 1 if the model does not pass.")
@figures.shapes
@options.common
def verb(
    case: options.TypedSetup,
    test: str,
    profile: str,
    limits: tuple[tuple[str, float], ...],
    reduction: str,
    noise: tuple[float, float] | None,
    runs: int,
    seed: int,
    require: bool,
    figure_file: str | None,
    as_json: bool,
) -> None:
    """Compare modes of ARTICLE with measured MODES, by a standard.

    Prints frequency error, cross- and self-orthogonality, MAC, COMAC and effective mass, and for each
    criterion of the profile the probability that a correct model would meet it, given the noise of the test.
    MODES is JSON, a universal file (.unv, .uff) or CSV. If it has frequencies alone, only criteria on
    frequencies are judged.
    """
    import numpy as np

    from middeck.cli.given.typed_article import solve_case

    measured = md.load_measured_modes(test)
    given = None if noise is None else md.structure.MeasurementNoise(*noise)
    criteria = _criteria(profile, limits)
    top = NEAR * float(measured.frequency_hz.max())
    modes = solve_case(case, top_hz=top)
    with reading(test):
        if not measured.node:
            found = md.structure.compare_frequencies(modes, measured, criteria)
            document = {**describe_frequencies(found), "test": test, "test_source": measured.source}
            blocks = _frequency_tables(document)
        else:
            found = md.correlate_modes(
                modes, measured, criteria, rng=np.random.default_rng(seed), noise=given,
                reduction=md.structure.Reduction(reduction), runs=runs,
            )  # fmt: skip
            document = {**describe(found), "seed": seed, "test": test, "test_source": measured.source}
            blocks = _tables(document)
        if figure_file is not None:
            _draw(found, figure_file, test)
    show(as_json, document, *blocks)
    if require and not found.passed:
        click.get_current_context().exit(1)


def _criteria(profile: str, limits: tuple[tuple[str, float], ...]) -> Profile:
    """The profile with the limits of ``--limit``."""
    criteria = md.structure.find_profile(profile)
    for name, limit in limits:
        quantity = md.structure.Quantity[name.replace("-", "_").upper()]
        criteria = md.structure.change_limit(criteria, quantity, limit, "--limit of the command line")
    return criteria


def _draw(found: Correlation | FrequencyComparison, file: str, test: str) -> None:
    from middeck.plot.correlation import correlation_figure, frequencies_figure
    from middeck.structure.correlation.correlate import Correlation

    shapes = isinstance(found, Correlation)
    if file.lower().endswith(".html"):
        if not shapes:
            raise click.UsageError(f"{test} has frequencies alone, and {file} would show shapes")
        figures.draw_survey_to(found, file)
        return
    of = f"of {len(found.pairs)} pairs."
    figures.write_figure(
        correlation_figure(found) if shapes else frequencies_figure(found),
        file,
        key="correlation",
        title=f"Correlation of {found.modes.equilibrium.model.structure.title} with {test}",
        description=f"MAC of the modes, and frequency errors {of}" if shapes else f"Frequency errors {of}",
    )


def describe(found: Correlation) -> dict[str, Any]:
    """The JSON document; matrices have a row for each mode of the model, a column for each measured one.

    Keys that end in ``index`` count from zero, whatever a text or a figure calls the measured modes.
    """
    judged, theirs = found.evaluation, found.pairs[:, 1]
    return {
        "schema": "middeck.correlate/2",
        **_common(found),
        "probability_of_a_correct_model": _probability(found.probability),
        "criteria": [_criterion(f) for f in found.findings],
        "frequency_error": judged.frequency_error,
        "pair_mac": judged.mac[judged.pairs[:, 0], theirs],
        **fields(judged, "cross_orthogonality", "self_orthogonality", "mac"),
        "mac_model_index": found.candidates,
        "comac": {
            name: None if rests else value
            for name, value, rests in zip(found.measured.channels, judged.comac, judged.at_rest, strict=True)
        },
        "phase_collinearity": found.phase_collinearity,
        "effective_mass_fraction": found.effective_mass.fraction[found.pairs[:, 0]],
        "effective_mass_sum": found.effective_mass.completeness,
        "rigid_mass": found.effective_mass.rigid,
        "reduction": found.reduced.reduction,
        "sensor_condition": condition if math.isfinite(condition := found.reduced.condition) else None,
    }


def describe_frequencies(found: FrequencyComparison) -> dict[str, Any]:
    """The JSON document of a survey of frequencies alone."""
    return {
        "schema": "middeck.correlate-frequencies/2",
        **_common(found),
        "criteria": [
            {
                **fields(f.criterion, "quantity", "group", "limit"),
                "worst": f.worst,
                "met": f.met,
            }
            for f in found.findings
        ],
        "unjudged": [str(c) for c in found.unjudged],
        "frequency_error": found.frequency_error,
        "undecided_test_index": found.undecided,
    }


def _common(found: Correlation | FrequencyComparison) -> dict[str, Any]:
    """The content that both documents share: the case, the verdict, the pairs and the modes without one."""
    modes, (ours, theirs) = found.modes, found.pairs.T
    return {
        "article": modes.equilibrium.model.structure.title,
        "environment": modes.equilibrium.environment.title,
        "profile": found.profile.name,
        "profile_title": found.profile.title,
        **fields(found, "passed", "verdict"),
        "model_index": ours,
        "test_index": theirs,
        "name": [modes.name[i] for i in ours],
        "frequency_hz": modes.frequency_hz[ours],
        "measured_hz": found.measured.frequency_hz[theirs],
        **_damping(modes, ours, found.measured.damping[theirs]),
        "unpaired_test_index": found.unpaired,
        "unmeasured_model_index": found.unmeasured,
        "warnings": (*modes.warnings, *found.warnings),
    }


def _damping(modes: md.Modes, ours: np.ndarray, measured: np.ndarray) -> dict[str, Any]:
    """Damping ratios of the pairs, where the test states any: zero is none, as in universal files."""
    from middeck.structure.plants.damping import estimate_damping

    stated = [float(zeta) if zeta > 0.0 else None for zeta in measured]
    if not any(stated):
        return {"measured_damping": None, "damping": None}
    try:
        model = estimate_damping(modes, count=int(max(ours)) + 1).zeta[ours].tolist()
    except ConfigError:  # the ratios do not reach so far; `modes` says why
        model = [None] * len(ours)
    return {"measured_damping": stated, "damping": model}


def _damping_columns(document: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Headers and cells of the pairs' damping; none where the test states none."""
    if document["damping"] is None:
        return [], [[] for _ in document["name"]]
    both = zip(document["measured_damping"], document["damping"], strict=True)
    cells = [["" if zeta is None else f"{100.0 * zeta:.2f}" for zeta in pair] for pair in both]
    return ["test zeta %", "model zeta %"], cells


def _judged(criterion: dict[str, Any], key: str) -> list[str]:
    """Worst value and whether the criterion is met; open where the model's fundamental was not measured."""
    met, worst = criterion[key], criterion["worst"]
    if worst is None:
        return ["no mode", "-"] if met else ["not measured", "open"]
    return [f"{worst:.4f}", "yes" if met else "NO"]


def _frequency_tables(document: dict[str, Any]) -> list[str | ScreenTable]:
    keys = ("model_index", "test_index", "measured_hz", "frequency_hz", "frequency_error", "name")
    damping, cells = _damping_columns(document)
    rows = [
        [
            str(j + 1),
            str(i),
            f"{t:.4f}",
            f"{m:.4f}",
            f"{100.0 * e:+.2f}",
            *zeta,
            "no" if j in document["undecided_test_index"] else "yes",
            n,
        ]
        for i, j, t, m, e, n, zeta in zip(*(document[k] for k in keys), cells, strict=True)
    ]
    judged = [
        [
            f"{c['quantity'].value}, {c['group'].value}",
            f"<= {c['limit']:g}",
            *_judged(c, "met"),
        ]
        for c in document["criteria"]
    ]
    headers = ["test", "model", "test Hz", "model Hz", "error %", *damping, "only one", "name"]
    return [
        *case_lines(document),
        *_source(document),
        f"profile      {document['profile']}: {document['profile_title']}",
        f"verdict      {document['verdict']}{': see the warnings' * (document['verdict'] == 'open')}",
        ScreenTable("pairs by frequency alone", headers, rows),
        ScreenTable("criteria on frequencies", ["criterion", "limit", "worst", "met"], judged),
    ]


def _probability(probability: Any) -> dict[str, Any]:
    low, high = probability.interval
    counts = {"passed": probability.passed, "runs": probability.runs}
    return {"value": probability.value, "low_95": low, "high_95": high, **counts}


def _criterion(finding: Finding) -> dict[str, Any]:
    criterion = finding.criterion
    return {
        **fields(criterion, "quantity", "group", "limit"),
        "limit_is": "largest" if criterion.quantity.has_upper_limit else "smallest",
        **fields(criterion, "source", "status", "recalled"),
        **fields(finding, "items", "values", "worst", "passed"),
        "probability_of_a_correct_model": _probability(finding.probability),
        "expected_of_a_correct_model": finding.expected,
    }


def _tables(document: dict[str, Any]) -> list[str | ScreenTable]:
    from middeck.structure.model.connectivity import some_names

    overall = document["probability_of_a_correct_model"]
    criteria = document["criteria"]
    marks = sorted({f"[R] = {c['status']}" for c in criteria if c["recalled"]})
    moving = [(name, value) for name, value in document["comac"].items() if value is not None]
    at_rest = [name for name, value in document["comac"].items() if value is None]
    lowest = sorted(moving, key=lambda item: item[1])[:SHOWN]
    return [
        *case_lines(document),
        *_source(document),
        f"profile      {document['profile']}: {document['profile_title']}",
        f"sensors      {_condition(document['sensor_condition'])}; mass by {document['reduction'].value}",
        f"verdict      {document['verdict']}{': see the warnings' * (document['verdict'] == 'open')}",
        f"a correct model would pass with probability {_interval(overall)} in {overall['runs']} runs",
        _pairs(document),
        PAIRS_NOTE,
        ScreenTable(
            "criteria",
            ["criterion", "limit", "worst", "met", "P(correct model meets it)", "its worst, 5 to 95 %"],
            [_criterion_row(c) for c in criteria],
        ),
        *marks,
        _effective(document),
        EFFECTIVE_NOTE,
        ScreenTable("lowest COMAC", ["channel", "COMAC"], [[name, f"{value:.4f}"] for name, value in lowest]),
        *([f"at rest, in the model and within the noise of the test: {some_names(at_rest)}"] * bool(at_rest)),
    ]


def _source(document: dict[str, Any]) -> list[str]:
    """Origin of the survey, if its file states it."""
    return [f"test         {document['test_source']}"] if document["test_source"] else []


def _condition(condition: float | None) -> str:
    return "too few to distinguish the modes" if condition is None else f"condition {condition:.3g}"


def _interval(p: dict[str, Any]) -> str:
    return f"{p['value']:.3f} ({p['low_95']:.3f} to {p['high_95']:.3f})"


def _pairs(document: dict[str, Any]) -> ScreenTable:
    from middeck.structure.correlation.assurance import largest_other

    cross, themselves = document["cross_orthogonality"], document["self_orthogonality"]
    others, own = largest_other(cross), largest_other(themselves)
    damping, cells = _damping_columns(document)
    rows = [
        [
            str(j + 1),
            str(i),
            f"{document['measured_hz'][p]:.4f}",
            f"{document['frequency_hz'][p]:.4f}",
            f"{100.0 * document['frequency_error'][p]:+.2f}",
            *cells[p],
            f"{document['pair_mac'][p]:.4f}",
            f"{cross[p, p]:.4f}",
            f"{others[p]:.4f}",
            f"{own[j]:.4f}",
            document["name"][p],
        ]
        for p, (i, j) in enumerate(zip(document["model_index"], document["test_index"], strict=True))
    ]
    headers = ["test", "model", "test Hz", "model Hz", "error %", *damping]
    headers += ["MAC", "cross", "off", "self off", "name"]
    return ScreenTable("pairs", headers, rows)


def _criterion_row(c: dict[str, Any]) -> list[str]:
    sign = "<=" if c["limit_is"] == "largest" else ">="
    mark = " [R]" if c["recalled"] else ""
    shows = c["expected_of_a_correct_model"]
    return [
        f"{c['quantity'].value}, {c['group'].value}",
        f"{sign} {c['limit']:g}{mark}",
        *_judged(c, "passed"),
        _interval(c["probability_of_a_correct_model"]),
        "" if shows is None else f"{shows[0]:.4f} to {shows[2]:.4f}",
    ]


def _effective(document: dict[str, Any]) -> ScreenTable:
    rows = [
        [name, *(f"{100.0 * part:.2f}" for part in parts)]
        for name, parts in zip(
            [*document["name"], "sum over all modes"],
            [*document["effective_mass_fraction"], document["effective_mass_sum"]],
            strict=True,
        )
    ]
    return ScreenTable("effective mass, % of the rigid article", ["", "x", "y", "z", "rx", "ry", "rz"], rows)
