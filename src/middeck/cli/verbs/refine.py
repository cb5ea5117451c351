"""``middeck refine``: an article refined on modes measured on the ground, and its prediction for orbit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, cells, show
from middeck.study.words import fields

if TYPE_CHECKING:
    from middeck.updating.orbit.predicted_frequencies import Prediction
    from middeck.updating.refinement.findable_unknowns import Choice
    from middeck.updating.refinement.refine import Refined, RefinedFriction
    from middeck.updating.residuals.damping_rows import ComparedDamping

EXAMPLES = """\
  middeck refine articles/mace-simple.toml \\
    data/virtual-survey/refine.toml
  middeck refine articles/mace-simple.toml \\
    data/virtual-survey/refine.toml --count 12 -o refined.toml
"""


@click.command("refine", cls=options.Verb, examples=EXAMPLES)
@options.article
@click.argument("refinement", metavar="REFINEMENT")
@options.defaulted(
    "--predict",
    "environment",
    default="orbit",
    metavar="NAME|PATH",
    help="Predict modes in this environment.",
)
@options.defaulted("--count", default=10, type=click.IntRange(min=1), help="How many modes to predict.")
@click.option(
    "--choose",
    is_flag=True,
    help="Only rate the unknowns: print which of them the surveys determine, and which have the same effect.",
)
@options.written("-o", "--output", "target", endings=(".toml",), help="Write the refined article.")
@options.printing
def verb(
    article: str,
    refinement: str,
    environment: str,
    count: int,
    choose: bool,
    target: str | None,
    as_json: bool,
) -> None:
    """Update ARTICLE on ground tests and predict modes in orbit.

    REFINEMENT names the surveys, the parameters that may change, and their standard deviations before the
    tests (docs/reference/files.md). The result is the most probable article with the standard deviations of
    its parameters. -o writes ARTICLE with these as a table of factors.
    """
    from middeck.cli.given.typed_article import find_case
    from middeck.files.disk.atomic import write_text
    from middeck.files.refinements.documents import load_refinement, refined_text
    from middeck.updating.refinement.findable_unknowns import weigh_unknowns

    if choose:
        options.refuse_unused("beside --choose", "target", "environment", "count")
    files = find_case(article, environment)
    structure, there = md.load_setup(*files)
    asked = load_refinement(refinement, files[0])
    if choose:
        with reading(files[0], refinement):
            weighed = weigh_unknowns(structure, *asked.of_refine)
        weights = describe_choice(weighed)
        show(as_json, weights, _choice_table(weights))
        return
    with reading(files[0], refinement):
        refined = md.refine(structure, *asked.of_refine)
        predicted = md.predict_modes(refined, there, count=count)
    document = describe(refined, predicted)
    if target is not None:
        write_text(target, refined_text(files[0], refined.factors))
    show(as_json, document, *_blocks(document, target))


def describe(refined: Refined, predicted: Prediction) -> dict[str, Any]:
    """The JSON document."""
    from middeck.updating.orbit.released_clamps import released_clamps
    from middeck.updating.refinement.findings import findings

    found = refined.estimate
    there = predicted.modes.equilibrium.environment
    released = released_clamps(refined, there)
    damping_std = predicted.damping * predicted.damping_std(0.0)
    return {
        "schema": "middeck.refine/1",
        "article": refined.structure.title,
        "converged": refined.converged,
        "steps": refined.history,
        "unknowns": [
            {
                **fields(u, "name", "parameters", "added", "mean", "spread"),
                "x": x,
                "std": std,
            }
            for u, x, std in zip(refined.unknowns, refined.x, found.x_std, strict=True)
        ],
        "surveys": [_survey(refined, k) for k in range(len(refined.compared))],
        "responses": [
            {
                **fields(r, "survey", "lines", "magnitude_db", "phase_deg", "miss"),
                "lost_hz": [zero.frequency_hz for zero in r.lost],
            }
            for r in refined.responses
        ],
        "damping": [_damping(d) for d in refined.damped],
        "friction": [_friction(f) for f in refined.friction()],
        "statics": [_static(refined, k) for k in range(len(refined.statics))],
        "model_error": dict(zip(refined.sorts, found.tau, strict=True)),
        "environment": there.title,
        "predicted": {
            "name": [predicted.modes.name[i] for i in predicted.index],
            "frequency_hz": predicted.frequency_hz,
            "interval_95_hz": predicted.interval_hz,
            "of_the_refined_model_hz": predicted.modes.frequency_hz[predicted.index],
            "damping": predicted.damping,
            **({"damping_deviation": damping_std} if refined.damped else {}),
            "seen": predicted.seen,
        },
        "not_in_the_article": [u.name for u in refined.left_out],
        "warnings": [
            *findings(refined),
            *([f"the prediction in {there.title} does not include {released}"] if released else []),
        ],
    }


def describe_choice(choice: Choice) -> dict[str, Any]:
    """The JSON document of ``--choose``."""
    return {
        "schema": "middeck.refine-choice/1",
        "unknowns": [
            {
                "name": u.name,
                "strength": choice.strength[k],
                "alignment": choice.alignment[k],
                "reason": choice.reason(k),
            }
            for k, u in enumerate(choice.unknowns)
        ],
        "cosine": choice.cosine,
    }


def _choice_table(document: dict[str, Any]) -> ScreenTable:
    rows = [cells(u, "name", "strength:.3g", "alignment:+.2f", "reason") for u in document["unknowns"]]
    headers = ["unknown", "moves by [deviations]", "with the error", "left out or merged?"]
    return ScreenTable("what one prior deviation of each does to the surveys", headers, rows)


def _survey(refined: Refined, k: int) -> dict[str, Any]:
    compared = refined.compared[k]
    ours, theirs = compared.pairs.T
    hz = compared.survey.measured.frequency_hz
    # What is measured is a complex mode, which damping shifts.
    damped = {d.survey.name: d.frequency_hz for d in refined.damped}
    return {
        "name": compared.survey.name,
        "mode": [compared.modes.name[i] for i in ours],
        "measured_hz": hz[theirs],
        "before_hz": [None if math.isnan(before) else before for before in refined.before_hz[k]],
        "frequency_hz": damped.get(compared.survey.name, compared.modes.frequency_hz[ours]),
        "unpaired_hz": hz[list(compared.unpaired)],
    }


def _damping(damped: ComparedDamping) -> dict[str, Any]:
    ours, theirs = damped.pairs.T
    measured = damped.survey.measured.damping[theirs]
    return {
        "survey": damped.survey.name,
        "mode": [damped.modes.name[i] for i in ours],
        "measured": measured,
        "deviation": measured * damped.std,
        "damping": damped.zeta,
    }


def _friction(refined: RefinedFriction) -> dict[str, Any]:
    torque, angle = refined.value.tolist()
    torque_std, angle_std = (refined.value * refined.log_std).tolist()
    return {
        "joint": refined.joint,
        "slip_torque_nm": torque,
        "slip_torque_deviation_nm": torque_std,
        "slip_angle_deg": math.degrees(angle),
        "slip_angle_deviation_deg": math.degrees(angle_std),
    }


def _static(refined: Refined, k: int) -> dict[str, Any]:
    compared = refined.statics[k]
    return {
        "name": compared.test.name,
        "gauge": [gauge.name for gauge in compared.test.gauges],
        "unit": [gauge.unit for gauge in compared.test.gauges],
        "measured": compared.test.value,
        "before": refined.before[k],
        "value": compared.value,
    }


def _blocks(document: dict[str, Any], target: str | None) -> Sequence[str | ScreenTable]:
    return [
        _unknowns_table(document["unknowns"]),
        "",
        *(block for s in document["surveys"] for block in (_survey_table(s), "")),
        *([_response_table(document["responses"]), ""] if document["responses"] else []),
        *(block for d in document["damping"] for block in (_damping_table(d), "")),
        *([_friction_table(document["friction"]), ""] if document["friction"] else []),
        *([_static_table(document["statics"]), ""] if document["statics"] else []),
        _predicted_table(document["environment"], document["predicted"]),
        *(["", f"wrote {target}{_without(document)}"] if target else []),
    ]


def _unknowns_table(unknowns: list[dict[str, Any]]) -> ScreenTable:
    def change(u: dict[str, Any], x: float) -> str:
        return f"{x:+.4g}" if u["added"] else f"{100.0 * math.expm1(x):+.2f} %"

    def deviation(u: dict[str, Any], std: float, x: float) -> str:
        return f"{std:.4g}" if u["added"] else f"{100.0 * std * math.exp(x):.2f} %"

    rows = [
        [u["name"], change(u, u["mean"]), deviation(u, u["spread"], u["mean"]), change(u, u["x"]),
         deviation(u, u["std"], u["x"])]
        for u in unknowns
    ]  # fmt: skip
    return ScreenTable("unknowns", ["name", "before", "+-", "refined", "+-"], rows)


def _survey_table(survey: dict[str, Any]) -> ScreenTable:
    measured = survey["measured_hz"]

    def errors(model: Sequence[float | None]) -> list[str]:
        """Relative errors [%] as texts, "-" for a mode that had no partner before."""
        both = zip(model, measured, strict=True)
        return ["-" if ours is None else f"{100.0 * (ours / hz - 1.0):+.3f}" for ours, hz in both]

    columns = survey["mode"], measured, errors(survey["before_hz"]), errors(survey["frequency_hz"])
    rows = [[name, f"{hz:.4f}", old, new] for name, hz, old, new in zip(*columns, strict=True)]
    headers = ["mode", "measured [Hz]", "error before [%]", "after [%]"]
    return ScreenTable(f"survey {survey['name']}", headers, rows)


def _predicted_table(environment: str, p: dict[str, Any]) -> ScreenTable:
    rows = [
        [name, f"{hz:.4f}", f"{low:.4f} to {high:.4f}", zeta, f"{100.0 * min(seen, 1.0):.0f}"]
        for name, hz, (low, high), zeta, seen in zip(
            p["name"], p["frequency_hz"], p["interval_95_hz"], _ratios(p), p["seen"], strict=True
        )
    ]
    headers = ["mode", "frequency [Hz]", "95 % interval [Hz]", "damping [%]", "seen on the ground [%]"]
    return ScreenTable(f"predicted in {environment}", headers, rows)


def _ratios(predicted: dict[str, Any]) -> list[str]:
    """Damping in per cent, with its deviation where it was refined."""
    found = [f"{100.0 * zeta:.2f}" for zeta in predicted["damping"]]
    known = predicted.get("damping_deviation")
    return found if known is None else [f"{z} +- {100.0 * s:.2f}" for z, s in zip(found, known, strict=True)]


def _damping_table(damping: dict[str, Any]) -> ScreenTable:
    rows = [
        [name, *(f"{100.0 * ratio:.3f}" for ratio in ratios)]
        for name, *ratios in zip(
            *(damping[key] for key in ("mode", "measured", "deviation", "damping")), strict=True
        )
    ]
    headers = ["mode", "measured [%]", "+- [%]", "refined [%]"]
    return ScreenTable(f"damping in survey {damping['survey']}", headers, rows)


def _friction_table(joints: Sequence[dict[str, Any]]) -> ScreenTable:
    keys = ("slip_torque_nm", "slip_torque_deviation_nm", "slip_angle_deg", "slip_angle_deviation_deg")
    rows = [cells(j, "joint", *(f"{key}:.3g" for key in keys)) for j in joints]
    return ScreenTable("friction of joints", ["joint", "slips at [N m]", "+-", "after [deg]", "+-"], rows)


def _response_table(responses: Sequence[dict[str, Any]]) -> ScreenTable:
    keys = ("survey", "lines", "magnitude_db:.3g", "phase_deg:.3g", "miss:.2f")
    rows = [cells(r, *keys) for r in responses]
    headers = ["survey", "lines", "off by [dB rms]", "[deg rms]", "in deviations"]
    return ScreenTable("responses of the refined article", headers, rows)


def _static_table(statics: Sequence[dict[str, Any]]) -> ScreenTable:
    rows = [
        [t["name"], name, f"{seen:.5g} {unit}", f"{old:.5g}", f"{new:.5g}"]
        for t in statics
        for name, unit, seen, old, new in zip(
            t["gauge"], t["unit"], t["measured"], t["before"], t["value"], strict=True
        )
    ]
    return ScreenTable("static tests", ["test", "gauge", "measured", "model before", "refined"], rows)


def _without(document: dict[str, Any]) -> str:
    """Refined values that have no place in the article's file, as hints to the reader."""
    names = document["not_in_the_article"]
    return f"; not in it, as no factor of an article: {', '.join(names)}" if names else ""
