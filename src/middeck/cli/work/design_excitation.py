"""From options to a designed excitation, and the accuracy of a test with it."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from middeck.cli.shown.file_of_an_error import reading
from middeck.errors import ConfigError
from middeck.files.measured.models import load_model
from middeck.files.toml.form import Band, Form, Positive, whole, within
from middeck.identification.uncertainty.accuracy import ExpectedAccuracy, expected_accuracy
from middeck.signals.excitation.band_noise import design_burst, design_noise
from middeck.signals.excitation.binary_signals import design_binary, design_mls
from middeck.signals.excitation.limits import Limits
from middeck.signals.excitation.multisine import design_multisine
from middeck.signals.excitation.signal import Excitation
from middeck.signals.excitation.sweep import design_sweep


class ExciteSettings(Form):
    """Settings of an excitation; limits are those of every input."""

    kind: Literal["multisine", "sweep", "noise", "burst", "mls", "binary"]
    sample_hz: Positive
    band_hz: Band | None = None
    period_s: Positive | None = None
    order: Annotated[int, whole(2, 24)] | None = None
    rms: Positive | None = None
    peak: Positive | None = None
    slew: Positive | None = None
    inputs: Annotated[int, whole(1, 64)] = 1
    realisations: Annotated[int, whole(1, 1000)] = 1
    periods: Annotated[int, whole(1, 100_000)] = 1
    grid: Literal["full", "odd", "odd-odd", "random-odd"] = "full"
    phases: Literal["random", "schroeder", "compact"] = "random"
    law: Literal["linear", "logarithmic"] = "linear"
    seed: Annotated[int, within(least=0)] = 0


WITHIN_A_BAND = ("multisine", "sweep", "noise", "burst", "binary")
DRAWN_AGAIN = ("multisine", "noise", "burst")
# Kinds that have a use for a setting.
KINDS = {
    "band_hz": WITHIN_A_BAND,
    "period_s": WITHIN_A_BAND,
    "order": ("mls",),
    "realisations": DRAWN_AGAIN,
    "grid": ("multisine",),
    "phases": ("multisine",),
    "law": ("sweep",),
}


def design(settings: ExciteSettings) -> Excitation:
    """The excitation; raises `ConfigError` for a missing band, period, order or limit, and for settings that
    its kind has no use for."""
    for name, kinds in KINDS.items():
        default = ExciteSettings.model_fields[name].default
        if settings.kind not in kinds and getattr(settings, name) != default:
            option = f"--{name.partition('_')[0]}"
            raise ConfigError(f"{option} is for {', '.join(kinds)}", where=settings.kind, hint="leave it out")
    rng, inputs = np.random.default_rng(settings.seed), settings.inputs
    limits = Limits(settings.rms, settings.peak, settings.slew)
    if settings.kind == "mls":
        if settings.order is None:
            raise ConfigError("a maximum length sequence needs its order", hint="--order N, 2^N - 1 bits")
        return design_mls(settings.order, settings.sample_hz, limits, rng, inputs=inputs)
    if settings.band_hz is None or settings.period_s is None:
        raise ConfigError(f"a {settings.kind} needs a band and a period", hint="--band LO,HI --period S")
    where = (settings.band_hz, settings.period_s, settings.sample_hz, limits)
    match settings.kind:
        case "multisine":
            return design_multisine(
                *where, rng, inputs=inputs, realisations=settings.realisations, grid=settings.grid,
                phases=settings.phases,
            )  # fmt: skip
        case "sweep":
            return design_sweep(*where, law=settings.law, inputs=inputs)
        case "binary":
            return design_binary(*where, rng, inputs=inputs)
        case "noise":
            return design_noise(*where, rng, inputs=inputs, experiments=settings.realisations * inputs)
        case "burst":
            return design_burst(*where, rng, inputs=inputs, experiments=settings.realisations * inputs)


def expect(made: Excitation, model_file: str, noise_rms: tuple[float, ...], periods: int) -> ExpectedAccuracy:
    """The accuracy of a test of the model in a file."""
    if Path(model_file).suffix.lower() == ".toml":
        raise ConfigError(
            "a TOML file is no measurement model",
            where=f"--model {model_file}",
            hint="a JSON file of middeck identify -o; or a guess, by middeck.write: "
            "docs/how-to/from-a-record-to-a-plant.md",
        )
    model = load_model(model_file)
    if len(noise_rms) not in (1, len(model.outputs)):
        raise ConfigError(
            f"{len(noise_rms)} noises for {len(model.outputs)} outputs", hint="one for all, or one for each"
        )
    with reading(model_file):
        return expected_accuracy(model, made, np.array(noise_rms), periods=periods)
