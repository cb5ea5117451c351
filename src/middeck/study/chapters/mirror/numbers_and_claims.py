"""The mirror in numbers.json, with the claims."""

from middeck.files.json.results import fitted_numbers
from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.study.chapters.mirror.computation import PUBLISHED_NRMSE, MirrorFit
from middeck.study.words import Claim, Numbers, percent, row


def mirror(fit: MirrorFit) -> Numbers:
    """A real mirror: all entries of the measured and the fitted response, and the held-out error."""
    entries = [
        fitted_numbers(fit.measured, fit.fitted, output=output, input=input)
        for output in range(len(fit.measured.outputs))
        for input in range(len(fit.measured.inputs))
    ]
    return {
        "states": fit.fit.model.states,
        "held_out_nrmse": fit.held_out_nrmse,
        "published_nrmse": PUBLISHED_NRMSE,
        "relative_error": fit.fit.error,
        "natural_hz": natural_hz(fit.fit.model),
        "damping": damping_ratio(fit.fit.model),
        "entries": entries,
        "warnings": fit.fit.warnings,
    }


def mirror_claims(numbers: Numbers) -> list[Claim]:
    """One for each output."""
    pairs = zip(numbers["held_out_nrmse"], numbers["published_nrmse"], strict=True)
    return [
        row(
            f"mirror, output {k + 1}: held-out NRMSE no worse than the published {percent(theirs)}",
            ours <= theirs,
            percent(ours),
            f"≤ {percent(theirs)}",
        )
        for k, (ours, theirs) in enumerate(pairs)
    ]
