"""``middeck excite``: a test signal, and the accuracy of a test with it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import options
from middeck.cli.shown.screen import ScreenTable, rows_of, show
from middeck.errors import ConfigError
from middeck.study.words import fields

if TYPE_CHECKING:
    from middeck.cli.work.design_excitation import ExciteSettings
    from middeck.identification.uncertainty.accuracy import ExpectedAccuracy
    from middeck.signals.excitation.signal import Excitation

EXAMPLES = """\
  middeck excite multisine --band 0.1,60 --period 64 --rate 256 \\
    --rms 0.1 --periods 3 -o torque.csv
  middeck excite multisine --band 0.5,30 --period 32 --rate 256 \\
    --peak 0.5 --phases compact --grid random-odd --json
"""


@click.command("excite", cls=options.Verb, examples=EXAMPLES)
@click.argument("kind", type=click.Choice(["multisine", "sweep", "noise", "burst", "mls", "binary"]))
@click.option("--band", "band_hz", type=options.Frequencies(2), metavar="LO,HI", help="Band [Hz].")
@click.option("--period", "period_s", type=float, help="Length of a period [s].")
@click.option("--rate", "sample_hz", type=float, required=True, help="Sampling rate [Hz].")
@click.option("--rms", type=float, help="Largest rms; at least one limit is needed.")
@click.option("--peak", type=float, help="Largest sample.")
@click.option("--slew", type=float, help="Largest step times rate [unit/s].")
@click.option("--order", type=int, help="mls: a period of 2^ORDER - 1 samples.")
@click.option("--grid", type=click.Choice(["full", "odd", "odd-odd", "random-odd"]), help="multisine: lines.")
@click.option("--phases", type=click.Choice(["random", "schroeder", "compact"]), help="multisine: phases.")
@click.option("--law", type=click.Choice(["linear", "logarithmic"]), help="sweep: frequency over time.")
@click.option("--inputs", type=int, help="Number of inputs, separated over as many experiments.")
@click.option("--realisations", type=int, help="Independent sets of experiments.")
@click.option("--periods", type=int, help="Periods of each experiment.  [default: 1]")
@click.option("--seed", type=int, help="Seed of the random numbers.  [default: 0]")
@click.option(
    "--model", "model_file", metavar="MODEL.json", help="Model of the article, as identify -o writes it."
)
@click.option(
    "--noise",
    "noise_rms",
    type=options.Numbers(),
    multiple=True,
    callback=options.chained,
    help="Rms of each output's noise, with --model.",
)
@options.several(
    "--name", "names", metavar="NAME", callback=options.names, help="Name of each input: repeat it, or A,B."
)
@options.defaulted("--unit", default="N m", help="Unit of the inputs.")
@options.output("command_file", options.COMMANDS, "Write the samples.", "COMMAND.csv|npz")
@options.common
def verb(
    model_file: str | None,
    noise_rms: tuple[float, ...] | None,
    names: tuple[str, ...],
    unit: str,
    command_file: str | None,
    overrides: tuple[str, ...],
    as_json: bool,
    **given: Any,
) -> None:
    """Design a test signal within limits, as large as they allow.

    --model and --noise add the accuracy with which such a test would identify that model.
    --set takes the names of the options, with units: band_hz, period_s, sample_hz.
    """
    from middeck.cli.given.checked_options import settle
    from middeck.cli.work.design_excitation import ExciteSettings, design, expect
    from middeck.files.records.commands import write_command

    settings = settle(ExciteSettings, given, overrides)
    if (model_file is None) != (noise_rms is None):
        raise ConfigError(
            "the expected accuracy of a test needs a model and its noise", hint="--model and --noise"
        )
    named = names or _numbered(settings.inputs)
    if len(named) != settings.inputs:
        raise ConfigError(
            f"{len(named)} names for {settings.inputs} inputs",
            where="--name",
            hint="one for each: --name a --name b, or --name a,b",
        )
    made = design(settings)
    expected = None
    if model_file is not None and noise_rms is not None:
        expected = expect(made, model_file, noise_rms, settings.periods)
    written: tuple[Any, ...] = ()
    if command_file is not None:
        ports = [md.Port(name, unit) for name in named]
        written = write_command(command_file, made, settings.periods, ports)
    document = describe(made, settings, expected) | {"unit": unit, "files": [str(p) for p in written]}
    show(as_json, document, *_tables(document), *(f"wrote {path}" for path in written))


def _numbered(inputs: int) -> tuple[str, ...]:
    return ("input",) if inputs == 1 else tuple(f"input_{i + 1}" for i in range(inputs))


def describe(made: Excitation, settings: ExciteSettings, expected: ExpectedAccuracy | None) -> dict[str, Any]:
    """The JSON document."""
    experiments, samples, _ = made.u.shape
    return {
        "schema": "middeck.excite/1",
        **fields(made, "kind", "what", "sample_hz", "period_s"),
        "samples": samples,
        "experiments": experiments,
        "periods": settings.periods,
        "duration_s": experiments * settings.periods * made.period_s,
        "lines": len(made.lines),
        "band_hz": [made.frequency_hz[0], made.frequency_hz[-1]],
        **fields(made, "rms", "peak", "crest_factor", "slew"),
        "expected": None if expected is None else _accuracy(expected),
    }


def _accuracy(expected: ExpectedAccuracy) -> dict[str, Any]:
    from middeck.identification.model.measurement_model import damping_ratio, natural_hz

    model, known = expected.covariance.model, expected.uncertainty
    names = [p.name for p in model.outputs]
    return {
        "frequency_hz": natural_hz(model),
        "frequency_std_hz": known.natural_hz,
        "damping": damping_ratio(model),
        "damping_std": known.damping,
        "delay_std_s": dict(zip(names, known.delay_s, strict=True)),
        "error": dict(zip(names, expected.error, strict=True)),
    }


def _tables(document: dict[str, Any]) -> list[str | ScreenTable]:
    unit = f"[{document['unit']}]"
    rows = [
        [str(i + 1), *(f"{document[key][i]:.4g}" for key in ("rms", "peak", "crest_factor", "slew"))]
        for i in range(len(document["rms"]))
    ]
    many = "" if document["periods"] == 1 else "s"
    head = f"{document['experiments']} x {document['periods']} period{many} of {document['period_s']:g} s: "
    head += f"{document['duration_s']:g} s"
    blocks: list[str | ScreenTable] = [
        document["what"],
        head,
        ScreenTable(
            "inputs", ["input", f"rms {unit}", f"peak {unit}", "crest", f"slew [{document['unit']}/s]"], rows
        ),
    ]
    expected = document["expected"]
    if expected is not None:
        forms = ("frequency_hz:.5f", "frequency_std_hz:.1e", "damping:.5f", "damping_std:.1e")
        outputs = [
            [name, f"{expected['delay_std_s'][name] * 1e3:.2g}", f"{error:.3%}"]
            for name, error in expected["error"].items()
        ]
        blocks += [
            ScreenTable(
                "expected of a fit", ["mode Hz", "+- Hz", "damping", "+-"], rows_of(expected, *forms)
            ),
            ScreenTable("expected of outputs", ["output", "delay +- ms", "error of response"], outputs),
        ]
    return blocks
