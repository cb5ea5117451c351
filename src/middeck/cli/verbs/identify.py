"""``middeck identify``: a model from measured records."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import figures, options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, delay_cells, deviation_words, mode_rows, show
from middeck.errors import NumericalError
from middeck.study.words import fields

if TYPE_CHECKING:
    from middeck.cli.work.fit_records import Identified
    from middeck.files.records import Columns
    from middeck.identification.friction.find import JointFriction

EXAMPLES = """\
  middeck identify data/cubespec-fsm/mirror-300mV-train.npz \\
    --sampled --band 100,1000 --validate \\
    data/cubespec-fsm/mirror-300mV-test.npz
  middeck identify data/cubespec-fsm/mirror-300mV-train.npz --states 6 \\
    --band 300,1000 --continuous -o model.json --json
"""
METHODS = ("samples", "periods", "local rational", "local polynomial", "h1", "h2", "hv")


@click.command("identify", cls=options.Verb, examples=EXAMPLES)
@click.argument("records", nargs=-1, required=True, metavar="RECORD...")
@options.columns
@options.periods
@options.states
@options.band
@click.option(
    "--sampled/--continuous",
    default=None,
    help="Kind of model.  [default: sampled if the band extends above 1/8 of the sampling rate, the inputs "
    "drive all frequencies or the periods are steady, and no option is given that only a continuous model "
    "has]",
)
@click.option(
    "--held/--not-held",
    default=None,
    help="Whether inputs were held between samples; if so, a continuous model excludes the hold.  "
    "[default: as the record says]",
)
@click.option(
    "--method",
    type=click.Choice(METHODS),
    help="Fit the samples, or a response estimated by this method.  [default: steady periods, else samples]",
)
@options.several(
    "--reference",
    metavar="CHANNEL,...",
    callback=options.listed,
    help="External reference channels of a record taken in closed loop.",
)
@click.option(
    "--cost",
    type=click.Choice(["weighted", "logarithmic"]),
    help="Cost to minimise: the weighted error, or that of log magnitude and phase.  [default: weighted]",
)
@click.option(
    "--constants",
    type=click.Choice(["real", "complex"]),
    help="Modal constants.  [default: real; complex if sampled or if an output is a velocity or "
    "acceleration]",
)
@click.option(
    "--delay",
    type=click.Choice(["none", "output", "path", "common"]),
    help="Delays to fit.  [default: one for each output; none with complex constants]",
)
@click.option("--rigid", type=click.IntRange(0, 6), help="Number of free rigid-body modes (1/s^2).")
@click.option("--integrators", type=click.IntRange(0, 6), help="Number of single poles at zero (1/s).")
@click.option("--residuals", is_flag=True, default=None, help="Fit terms for the modes outside the band.")
@click.option("--full-rank", is_flag=True, default=None, help="Residue matrices of any rank, not one.")
@click.option(
    "--relative-degree", type=click.IntRange(0, 2), help="Relative degree of a model with complex constants."
)
@options.several(
    "--friction",
    metavar="JOINT,...",
    callback=options.listed,
    help="Joints whose friction is estimated and removed: MOTOR=ANGLE, or one name that both have.",
)
@options.several("--validate", metavar="RECORD", help="Record to test the fit on; may be repeated.")
@options.model_file
@figures.figure
@options.written(
    "--stabilisation",
    "stabilisation_file",
    endings=options.FIGURES,
    help="Also draw the stabilisation diagram (poles of rising orders).",
)
@options.common
def verb(
    records: tuple[str, ...],
    columns: options.ColumnsTyped,
    validate: tuple[str, ...],
    model_file: str | None,
    figure_file: str | None,
    stabilisation_file: str | None,
    overrides: tuple[str, ...],
    as_json: bool,
    **given: Any,
) -> None:
    """Fit poles, residues and delays to measured records.

    RECORDs are .npz, .h5, .mat, .csv, .npy or universal files; several are experiments of one test. If the
    record has whole steady periods (recognised from the input, or given by --periods), the frequency response
    is estimated and fitted. Otherwise the samples are fitted, with a transient that shares the poles. --set
    takes the names of the options: states, band_hz, sampled, held, method, reference, cost, constants, delay,
    rigid, integrators, residuals, full_rank, relative_degree, friction and periods.
    """
    from middeck.cli.given.checked_options import FitSettings, settle
    from middeck.cli.shown.progress import status
    from middeck.cli.work.fit_records import identify
    from middeck.files.records import require_record

    settings = settle(FitSettings, given, overrides)
    named = columns.named()
    for file in validate:
        require_record(file)
    with status("identify") as show_stage:
        found = identify(records, settings, named, show_stage)
        show_stage("zeros of the paths, held-out records, figures")
        document = {
            **describe(found),
            "held_out_nrmse": _validate(found, validate, settings.periods, named),
            "records": records,
        }
        if model_file is not None:
            md.write(model_file, found.fit)
        _draw(found, figure_file, stabilisation_file)
    show(as_json, document, *_tables(document))


def _draw(found: Identified, figure_file: str | None, stabilisation_file: str | None) -> None:
    from middeck.cli.work.fit_records import response_of

    if figure_file is not None:
        from middeck.plot.fit import fit_figure

        figures.write_figure(
            fit_figure(response_of(found), found.fit),
            figure_file,
            key="fit",
            title="Measured response and fit",
            description="Magnitude of each path with the bounds of the fit",
        )
    if stabilisation_file is not None:
        from middeck.plot.stabilisation import stabilisation as stabilisation_figure

        model, measured = found.fit.model, response_of(found)
        figures.write_figure(
            stabilisation_figure(
                md.stabilisation(measured, sample_hz=model.sample_hz), measured, states=model.states
            ),
            stabilisation_file,
            key="stabilisation",
            title="Stabilisation diagram",
            description="Poles of rising orders over frequency",
        )


def _validate(
    found: Identified, files: tuple[str, ...], periods: int | None, named: Columns | None
) -> dict[str, float] | None:
    """Error of the simulated outputs on held-out records; None without any.

    A periodic record is simulated in its steady state, another one from the initial state that its first
    quarter determines. Offsets and ramps, and a start of periods that is told, are removed as the fit removes
    them: no model has them. What may be noise is scored.
    """
    from middeck.cli.work.fit_records import load_periods
    from middeck.identification.record_fit.record_spectra import as_fitted
    from middeck.identification.record_fit.simulate_record import record_nrmse
    from middeck.identification.spectra.start_up import steadied

    if not files:
        return None
    held_out, _ = load_periods(files, periods, named)
    model = found.fit.model
    with reading(*files):
        if held_out.periodic:
            steady = steadied(held_out)
            error = md.identification.nrmse(model, steady.record if steady.what else held_out)
        else:
            error = record_nrmse(model, as_fitted(held_out, model), state_share=0.25)
    return {p.name: float(e) for p, e in zip(model.outputs, error, strict=True)}


def describe(found: Identified) -> dict[str, Any]:
    """The JSON document."""
    from middeck.identification.model.measurement_model import damping_ratio, is_mode, natural_hz
    from middeck.identification.uncertainty.parameter_deviations import stated

    fit, model, measured = found.fit, found.fit.model, found.measured
    names = [p.name for p in model.outputs]
    modes = is_mode(model, found.record.sample_hz)
    _, periods, samples, _ = found.record.u.shape
    return {
        "schema": "middeck.identify/1",
        **fields(model, "inputs", "outputs", "states"),
        "order_reason": fit.order_reason,
        "sample_hz": found.record.sample_hz,
        "sampled": model.sample_hz is not None,
        "hold_s": model.hold_s,
        "band_hz": found.band_hz,
        "lines": None if measured is None else len(measured.frequency_hz),
        "samples": periods * samples,
        "frequency_hz": natural_hz(model)[modes],
        "frequency_std_hz": stated(fit.uncertainty.natural_hz[modes]),
        "damping": damping_ratio(model)[modes],
        "damping_std": stated(fit.uncertainty.damping[modes]),
        "standing": [standing for standing, mode in zip(fit.standing, modes, strict=True) if mode],
        "steady_lines": fit.lines,
        "pole": model.poles[modes],
        "pole_of_no_mode": model.poles[~modes],
        "zeros": _zeros(model),
        "delay_s": dict(zip(names, model.delay_s, strict=True)),
        "delay_std_s": dict(zip(names, stated(fit.uncertainty.delay_s), strict=True)),
        "delay_standing": dict(zip(names, fit.delay_standing, strict=True)),
        "deviations_robust": fit.covariance.robust,
        "error": dict(zip(names, fit.error, strict=True)),
        "cost": fit.cost,
        "friction": _friction(found.friction),
        "warnings": found.warnings,
    }


def _friction(found: JointFriction | None) -> dict[str, Any] | None:
    """The friction taken out of the record; None for nothing."""
    if found is None:
        return None
    return {
        "input": found.inputs,
        "output": found.outputs,
        **fields(found, "slip_torque", "slip_torque_std", "slip_angle", "slip_angle_std", "delay_s"),
        "variance_before": found.before,
        "variance_after": found.after,
    }


def _zeros(model: md.MeasurementModel) -> list[dict[str, Any]]:
    """Zeros of every path; none, with the reason, for a path whose zeros are lost in rounding."""
    found: list[dict[str, Any]] = []
    for output in model.outputs:
        for input_ in model.inputs:
            path = {"output": output.name, "input": input_.name}
            try:
                zeros = md.identification.path_zeros(model, output.name, input_.name)
            except NumericalError as error:
                found.append({**path, "zero": [], "non_minimum_phase": [], "reason": str(error)})
                continue
            wrong = [bool(x) for x in zeros.is_nonminimum_phase]
            found.append({**path, "zero": zeros.value, "non_minimum_phase": wrong, "reason": ""})
    return found


def _tables(document: dict[str, Any]) -> list[str | ScreenTable]:
    held_out = document["held_out_nrmse"] or {}
    outputs = [
        [port.name, port.unit]
        # A sampled model has no delays.
        + (["-", "-", ""] if document["sampled"] else delay_cells(document, port.name))
        + [f"{document['error'][port.name]:.2%}"]
        + ([f"{held_out[port.name]:.2%}"] if held_out else [])
        for port in document["outputs"]
    ]
    kind = "sampled" if document["sampled"] else "continuous"
    low, high = document["band_hz"]
    fitted = f"{document['lines']} lines" if document["lines"] else f"{document['samples']} samples"
    heads = ["output", "unit", "delay ms", "+-", "", "error of fit"]
    heads += ["held-out NRMSE"] if held_out else []
    return [
        f"{document['states']} states, {kind}, fitted to {fitted} in {low:g}-{high:g} Hz",
        f"order: {document['order_reason']}",
        *_hold(document["hold_s"]),
        ScreenTable("poles", ["Hz", "+-", "damping", "+-", ""], mode_rows(document)),
        *_no_modes(document),
        *_friction_table(document["friction"]),
        ScreenTable("outputs", heads, outputs),
        ScreenTable("zeros of the paths", ["output", "input", "Hz", ""], _zero_rows(document)),
    ]


def _friction_table(found: dict[str, Any] | None) -> list[str | ScreenTable]:
    if found is None:
        return []
    keys = ("input", "slip_torque", "slip_torque_std", "slip_angle", "slip_angle_std")
    rows = [
        [name, f"{T:.4g}", deviation_words(dT), f"{a:.4g}", deviation_words(da)]
        for name, T, dT, a, da in zip(*(found[k] for k in keys), strict=True)
    ]
    return [
        ScreenTable("friction, taken out", ["joint", "slips at N m", "+-", "gives rad", "+-"], rows),
        f"experiments differ by {found['variance_before']:.3g} times the noise before and by "
        f"{found['variance_after']:.3g} after",
    ]


def _hold(hold_s: float | None) -> list[str]:
    return [f"hold: that of {hold_s * 1e3:g} ms is taken out, and no part of the delays"] if hold_s else []


def _no_modes(document: dict[str, Any]) -> list[str]:
    """Note on poles that cannot be modes at the sampling rate."""
    import numpy as np

    found = np.exp(np.asarray(document["pole_of_no_mode"]) / document["sample_hz"])
    if not len(found):
        return []
    where = ", ".join(f"{z:.3g}" if z.imag else f"{z.real:.3g}" for z in found)
    stands = "stand for a delay, a filter or what is beyond half the rate"
    return [f"no modes: {len(found)} poles at z = {where} {stands}"]


def _zero_rows(document: dict[str, Any]) -> list[list[str]]:
    """One line for each path: its zeros in hertz, those in the right half-plane in brackets."""
    import numpy as np

    rows: list[list[str]] = []
    for path in document["zeros"]:
        hz = np.abs(path["zero"]) / (2.0 * np.pi)
        # Those of a sampled model beyond half the rate are of sampling, not of the article.
        shown = hz < (0.5 * document["sample_hz"] if document["sampled"] else np.inf)
        words = [
            f"[{f:.4g}]" if wrong else f"{f:.4g}"
            for f, wrong, seen in zip(hz, path["non_minimum_phase"], shown, strict=True)
            if seen
        ]
        note = "[ ] non-minimum phase" if any(path["non_minimum_phase"]) else path["reason"]
        rows.append([path["output"], path["input"], ", ".join(words), note])
    return rows
