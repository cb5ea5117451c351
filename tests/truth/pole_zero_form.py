"""The response of a path in poles, zeros, gain and delay, by its definition."""

import numpy as np


def response_of_form(form, hz):
    s = 2j * np.pi * np.asarray(hz)
    sampled = form.sample_hz is not None

    def roots(half):
        half = np.exp(half / form.sample_hz) if sampled else half
        # Rounding of log(-1) apart.
        return np.concatenate([half, half[np.imag(half) > 1e-12 * np.abs(half)].conj()])

    q = (np.exp(s / form.sample_hz) if sampled else s)[:, None]
    zeros, poles = q - roots(form.zeros), q - roots(form.poles)
    spare = poles.shape[1] - zeros.shape[1]
    # A zero with each pole, so that nothing overflows.
    ratio = np.prod(zeros / poles[:, spare:], axis=1) / np.prod(poles[:, :spare], axis=1)
    return form.gain * ratio * np.exp(-s * form.delay_s)
