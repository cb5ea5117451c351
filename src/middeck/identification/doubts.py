"""What a fit should not be trusted for: said with the result, since the result may still be of use."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import FitError
from middeck.identification.uncertainty import Uncertainty
from middeck.systems.response import FrequencyResponse

# A steady record of a test article repeats itself within a few per cent, sensor noise and weak
# nonlinearity included (the mirror's 300 mV: 5 %); a model worth using explains nine tenths.
SCATTER = 0.1
LEFT = 0.1
# Least squares leave no more than the response itself; twice that means that the search has failed.
FAILED = 2.0


def doubts_of_record(measured: FrequencyResponse) -> list[str]:
    """Outputs whose periods or experiments disagree."""
    if measured.variance is None:
        return []
    size = np.sum(np.abs(measured.H) ** 2, axis=(0, 2))
    scatter = np.sqrt(np.sum(measured.variance, axis=(0, 2)) / size)
    return [
        f"output {port.name}: the response scatters by {share:.0%} between periods or experiments; is the "
        "record steady, without drift, spikes or dropouts?"
        for port, share in zip(measured.outputs, scatter, strict=True)
        if share > SCATTER
    ]


def doubts_of_model(
    measured: FrequencyResponse, error: Float[np.ndarray, " output"], model_error: float, share: float
) -> list[str]:
    """Outputs that the model does not explain, or deviations that do not cover what it lacks.

    ``model_error`` is the part of the assumed variance that is not noise, ``share`` its size as a part of
    the mean square response. Raises `FitError` for a model that is worse than none.
    """
    if np.any(error > FAILED):
        worst = int(np.argmax(error))
        raise FitError(
            f"the best model found leaves {error[worst]:.0f} times the response itself",
            where=f"output {measured.outputs[worst].name}",
            hint="ask for more states, or for a band without half a mode at its edge",
        )
    poor = [
        f"output {port.name}: the model leaves {left:.0%} of the response unexplained; its parameters mean "
        "little. Look at the record, the band and the order"
        for port, left in zip(measured.outputs, error, strict=True)
        if left > LEFT
    ]
    if poor or model_error <= 0.5:
        return poor
    return [
        f"most of what the fit leaves is not noise but modes it lacks ({np.sqrt(share):.1%} of the "
        "response): the stated deviations do not cover that"
    ]


def causal_delay(
    measured: FrequencyResponse, delay_s: np.ndarray, uncertainty: Uncertainty
) -> tuple[np.ndarray, list[str]]:
    """Delays of zero or more; a small advance is a warning, a long one an error."""
    warnings: list[str] = []
    for o, tau in enumerate(delay_s):
        name = measured.outputs[o].name
        if tau < -1.0 / measured.frequency_hz[-1]:
            raise FitError(
                f"the output leads its input by {-tau:.6g} s",
                where=f"output {name}",
                hint="check which channel is the input, and that the period is more than twice the delay",
            )
        if tau < 0.0:
            warnings.append(
                f"output {name}: the fit leads by {-tau * 1e3:.3g} ms (+-{uncertainty.delay_s[o] * 1e3:.2g});"
                " its delay is set to zero"
            )
    return np.maximum(delay_s, 0.0), warnings
