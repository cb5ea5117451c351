"""Headings, sentences and table of Figure 6."""

from middeck.plot.port_words import port_words
from middeck.study.words import Numbers, Table, fixed


def title(figures: Numbers, output: int) -> str:
    """From torque to rate."""
    numbers = figures["figure_6"]
    torque, rate = numbers["input"], numbers["outputs"][output]
    return f"Figure 6{'ab'[output]}: {port_words(torque)} torque to {port_words(rate)}"


def sentence(figures: Numbers, output: int) -> str:
    """Agreement of each model with the rig."""
    numbers = figures["figure_6"]
    name, band = port_words(numbers["outputs"][output]), numbers["magnitude_error_band_hz"]
    if band is None:
        follows = f"The {name} has no measurement in 0.3 to 30 Hz, where models are compared"
    else:
        errors = {env: fixed(e[output], 2) for env, e in numbers["magnitude_error_db"].items()}
        follows = (
            f"In the {name} the 1-g model follows the simulated rig's magnitude within {errors['lab']} dB rms"
            f" from {band[0]:g} to {band[1]:g} Hz, the 0-g model within {errors['orbit']} dB"
        )
    if numbers["phase_gap_s"] is None:
        return f"{follows}; nothing is measured above 5 Hz, where the phase would show the rig's delay."
    return (
        f"{follows}. Above 5 Hz the phase of the rig relative to the 1-g model is that of a delay of"
        f" {fixed(1e3 * numbers['phase_gap_s'][output], 2)} ms; the rig's delay is"
        f" {fixed(1e3 * numbers['delay_s'], 2)} ms."
    )


def response_tables(figures: Numbers) -> list[Table]:
    """Magnitude errors and the delay that explains the phase."""
    numbers = figures["figure_6"]
    error, gap = numbers["magnitude_error_db"], numbers["phase_gap_s"]
    band = numbers["magnitude_error_band_hz"]
    rows = [
        [
            port_words(name),
            *(fixed(error[side] and error[side][k], 3) for side in ("orbit", "lab")),
            fixed(gap and 1e3 * gap[k], 4),
            fixed(1e3 * numbers["delay_s"], 4),
        ]
        for k, name in enumerate(numbers["outputs"])
    ]
    head = (
        "output",
        "0-g error [dB]",
        "1-g error [dB]",
        "phase difference as delay [ms]",
        "rig's delay [ms]",
    )
    where = "" if band is None else f" in {band[0]:g}-{band[1]:g} Hz"
    return [Table(f"Models against the simulated rig, rms of log magnitude{where}", head, rows)]
