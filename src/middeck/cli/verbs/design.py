"""``middeck design``: an LQG compensator for an article, a fitted model or a record."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import figures, options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, number, rows_of, show
from middeck.errors import ConfigError

if TYPE_CHECKING:
    from middeck.cli.given.checked_options import LoopSettings
    from middeck.cli.given.design_plants import FittedPlant, Wanted
    from middeck.cli.work.design_loop import DesignedLoop

EXAMPLES = """\
  middeck design articles/mace-dm.toml --environment lab --count 12 \\
    --control pri_rel_z --measure pri_in_z --log10-authority 2 -o gimbal.json
  middeck design model.json --control piezo_1 --measure position_1 \\
    --log10-authority 12 --angle-noise 1e-7 --disturbance 0.1 -o law.json
"""

# Parameters that have a use for some kinds of source alone, and which these are.
FOR = {
    **dict.fromkeys(("load_case", "environment", "count"), "an article"),
    "pade_order": "a fitted model or a record",
    **dict.fromkeys(("periods", "states", "fit_band_hz"), "a record"),
}
UNREACHED = "left out of the design, as no port reaches or sees it"


@click.command("design", cls=options.Verb, examples=EXAMPLES)
@click.argument("sources", nargs=-1, required=True, metavar="ARTICLE|MODEL.json|RECORD...")
@options.environment
@options.load_case
@options.count
@options.several("--control", metavar="PORT", callback=options.names, help="Input to drive; may be repeated.")
@options.several(
    "--measure",
    metavar="PORT",
    callback=options.names,
    help="Output to measure and keep small; may be repeated.",
)
@click.option(
    "--authority", type=options.POSITIVE, help="1/rho, rho the factor on the control weights.  [default: 10]"
)
@click.option("--log10-authority", type=float, help="log10 of the authority, in place of --authority.")
@options.defaulted("--angle-noise", default=2e-5, help=options.SENSOR_NOISE)
@options.defaulted("--disturbance", default=1e-2, help=options.INPUT_NOISE)
@options.defaulted("--pade-order", default=3, help="Padé order of each delay of a fitted model.")
@click.option(
    "--band",
    "band_hz",
    type=options.Frequencies(2),
    metavar="LO,HI",
    help="Band of the rms [Hz].  [default: half the lowest frequency above zero to twice the highest]",
)
@options.periods
@options.states
@click.option(
    "--fit-band",
    "fit_band_hz",
    type=options.Frequencies(2),
    metavar="LO,HI",
    help="Band to fit a RECORD in [Hz].",
)
@options.output("law_file", options.SYSTEMS, "Write the compensator.", "LAW.json|mat")
@figures.figure
@options.common
def verb(
    sources: tuple[str, ...],
    environment: str,
    load_case: str | None,
    count: int,
    control: tuple[str, ...],
    measure: tuple[str, ...],
    authority: float | None,
    log10_authority: float | None,
    law_file: str | None,
    figure_file: str | None,
    overrides: tuple[str, ...],
    as_json: bool,
    **given: Any,
) -> None:
    """LQG design for a plant, and its predicted closed loop.

    The disturbance enters at the control inputs; every measured output is kept small. A fitted model is
    reduced to the paths from --control to --measure; delays whose difference is within their uncertainty
    become one. --set takes the article's and the environment's keys, or for a fitted plant log10_authority,
    angle_noise, disturbance, pade_order, band_hz, states, fit_band_hz, sampled and periods.
    """
    from middeck.cli.given.checked_options import LoopSettings, settle
    from middeck.cli.given.design_plants import Wanted
    from middeck.cli.work.design_loop import design_loop

    measured = (".json", ".npy", *options.RECORDS)
    from_article = len(sources) == 1 and Path(sources[0]).suffix.lower() not in measured
    asked = {
        "log10_authority": _log10_authority(authority, log10_authority),
        "angle_noise_rad_per_rthz": given["angle_noise"],
        "disturbance_nm_per_rthz": given["disturbance"],
        **{k: given[k] for k in ("pade_order", "band_hz", "states", "fit_band_hz", "periods")},
    }
    is_model = len(sources) == 1 and Path(sources[0]).suffix.lower() == ".json"
    _refuse_unused("an article" if from_article else "a fitted model" if is_model else "a record")
    settings = settle(LoopSettings, asked, () if from_article else overrides)
    for name in ("periods", "states", "fit_band_hz", "sampled"):
        if is_model and getattr(settings, name) is not None:
            raise ConfigError(f"--set {name} is for a record", hint="leave it out: the model is fitted")
    wanted = Wanted(control, measure)
    warnings: tuple[str, ...] = ()
    if from_article:
        from middeck.cli.given.design_plants import article_plant
        from middeck.cli.given.typed_article import solve_case

        case = options.TypedSetup(sources[0], environment, overrides, load_case)
        modes = solve_case(case, count, standstill=True)
        with reading(sources[0]):
            plant, band_hz = article_plant(modes, count, wanted)
    else:
        fitted = _fitted_plant(sources, settings, wanted)
        plant, band_hz, warnings = fitted.plant, fitted.band_hz, fitted.warnings
    with reading(*sources):
        designed = design_loop(plant, settings, settings.band_hz or band_hz)
    document = describe(designed, plant, settings, warnings)
    if law_file is not None:
        md.write(law_file, designed.compensator)
    if figure_file is not None:
        with reading(*sources):
            _draw(plant, designed, settings, figure_file)
    show(as_json, document, *_tables(document))


def _refuse_unused(kind: str) -> None:
    """Refuse what was typed and would have no effect on this ``kind`` of source."""
    for name, others in FOR.items():
        if kind not in others and (option := options.typed(name)):
            raise ConfigError(f"{option} is for {others}", hint=f"name {others} alone, or leave it out")


def _draw(plant: md.Plant, designed: DesignedLoop, settings: LoopSettings, file: str) -> None:
    """Nyquist's plot of each loop, broken at the plant's inputs."""
    law = designed.compensator
    figures.write_figure(
        md.plot.draw_nyquist(md.control.trace_return_ratio(plant, law), md.measure_margins(plant, law)),
        file,
        key="design",
        title=f"Return ratio at log10 authority {settings.log10_authority:g}",
        description=f"Nyquist plots of the loops broken at {', '.join(plant.u)}, with margins.",
    )


def _log10_authority(authority: float | None, log10_authority: float | None) -> float:
    if authority is not None and log10_authority is not None:
        raise click.UsageError("--authority and --log10-authority are the same: give one")
    if log10_authority is not None:
        return log10_authority
    return math.log10(10.0 if authority is None else authority)


def _fitted_plant(sources: tuple[str, ...], settings: LoopSettings, wanted: Wanted) -> FittedPlant:
    from middeck.cli.given.checked_options import FitSettings, settle
    from middeck.cli.given.design_plants import model_plant, require_ports
    from middeck.cli.work.fit_records import identify
    from middeck.files.measured.models import load_fitted
    from middeck.files.records import open_record

    if len(sources) == 1 and Path(sources[0]).suffix.lower() == ".json":
        model, covariance = load_fitted(sources[0])
    else:
        keys = {
            "states": settings.states,
            "band_hz": settings.fit_band_hz,
            "sampled": settings.sampled or False,
            "periods": settings.periods,
        }
        with reading(sources[0]):
            require_ports(open_record(sources[0]), wanted)
        fit = identify(sources, settle(FitSettings, keys, ())).fit
        model, covariance = fit.model, fit.covariance
    with reading(*sources):
        return model_plant(model, covariance, settings.pade_order, wanted)


def describe(
    designed: DesignedLoop, plant: md.Plant, settings: LoopSettings, warnings: tuple[str, ...]
) -> dict[str, Any]:
    """The JSON document; rms and decibels are null where they do not exist."""
    import numpy as np

    from middeck.control.qualification import decibels
    from middeck.systems.poles.verdict import is_stable
    from middeck.systems.state_space.statespace import poles

    law, loop = designed.compensator, designed.loop
    upper = np.array(sorted((p for p in loop.poles if p.imag >= 0.0), key=abs))
    open_, closed = designed.rms_open, designed.rms_closed
    judged = loop.stable and np.isfinite(open_).all()
    db = [decibels(a, b) if a > 0.0 and judged else None for a, b in zip(closed, open_, strict=True)]
    names = [p.name for p in loop.outputs]

    def by_output(values: Any) -> dict[str, Any]:
        return dict(
            zip(names, (v if v is not None and np.isfinite(v) else None for v in values), strict=True)
        )

    return {
        "schema": "middeck.design/1",
        "log10_authority": settings.log10_authority,
        "control": plant.u,
        "measure": plant.y,
        "plant_order": len(plant.system.A),
        "inert": law.inert,
        "order": len(law.system.A),
        "compensator_stable": is_stable(law.system),
        "compensator_pole": poles(law.system),
        "stable": loop.stable,
        "pole": upper,
        "frequency_hz": np.abs(upper) / (2.0 * np.pi),
        "damping": -np.real(upper) / np.where(upper == 0.0, 1.0, np.abs(upper)),
        "band_hz": designed.band_hz,
        "rms_open": by_output(open_),
        "rms_closed": by_output(closed),
        "db": by_output(db),
        "riccati_residual": [law.regulator.residual, law.estimator.residual],
        "warnings": [
            *warnings,
            *(f"{UNREACHED}: {name}" for name in law.inert),
            *([] if settings.band_hz else _rigid_below(plant, designed.band_hz[0])),
        ],
    }


def _rigid_below(plant: md.Plant, low_hz: float) -> list[str]:
    """Warning of rigid modes that the loop moves and that the band of the rms leaves out by default."""
    from middeck.control.law.partition import partition_modes

    modal = partition_modes(plant).active.modal
    count = 0 if modal is None else int((modal.omega == 0.0).sum())
    if not count:
        return []
    return [
        f"the band of the rms begins at {low_hz:.3g} Hz, above {count} rigid mode{'s' * (count > 1)}, whose "
        "rms without control is not finite: the dB do not count them; --band LO,HI begins lower"
    ]


def _tables(document: dict[str, Any]) -> list[str | ScreenTable]:
    low, high = document["band_hz"]
    rows = [
        [name, *(number(document[k][name], ".4e") for k in ("rms_open", "rms_closed")), number(db, ".2f")]
        for name, db in document["db"].items()
    ]

    stable = "stable" if document["stable"] else "UNSTABLE"
    law = "stable" if document["compensator_stable"] else "unstable by itself"
    return [
        f"loop         {stable}, log10 authority {document['log10_authority']:g}",
        f"compensator  {document['order']} states, {law}, for a plant of {document['plant_order']}",
        f"from         {', '.join(document['measure'])} to {', '.join(document['control'])}",
        ScreenTable(f"rms in {low:g}-{high:g} Hz", ["output", "open", "closed", "dB"], rows),
        ScreenTable(
            "poles of the loop", ["Hz", "damping"], rows_of(document, "frequency_hz:.5f", "damping:.5f")
        ),
    ]
