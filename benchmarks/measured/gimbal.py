"""The simulated gimbal: `multisine`, `mimo` and `random`, each over its noise seeds."""

from __future__ import annotations

import dataclasses
import importlib
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from measured.bounds import Bound, Gimbal, cramer_rao
from measured.rows import cell, peer, row
from middeck import estimate_response, fit_response, model_response
from middeck.identification import FitResult, damping_ratio
from middeck.identification.model.measurement_model import natural_hz
from middeck.identification.record_fit.fit_record import fit_record
from middeck.signals.record import Record

# The frozen case is shared with the tests.
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "truth"))
case = importlib.import_module("gimbal_record")

SEEDS = 50
# benchmark-cases: median Cramer-Rao bound of `multisine` with real modal constants.
STATED = 1.18e-4
PERIODS = 3
# A mode is found where a pole lies within a tenth of its half-power bandwidth.
FOUND = 0.1 * 2.0 * case.ZETA


@dataclasses.dataclass(frozen=True)
class Score:
    """One fit against the truth."""

    error: float
    decibels: float
    damping: np.ndarray
    delay_ms: float
    states: int
    found: bool
    seconds: float


def rows(python: str | None) -> list[dict[str, Any]]:
    """All three cases."""
    return [*_multisine(python), *_mimo(), *_random()]


def _multisine(python: str | None) -> list[dict[str, Any]]:
    bound = _bound(case.multisine(0), 1, 1)
    chosen = [_periodic(seed, 1, 1, None) for seed in range(SEEDS)]
    by_hand = [_periodic(seed, 1, 1, 10) for seed in range(SEEDS)]
    name = "gimbal multisine"
    peers = _peers(python)
    return [
        *_rows(name, chosen, STATED, bound, peers=peers),
        *_rows(f"{name}, order by hand", by_hand, STATED, bound),
    ]


def _mimo() -> list[dict[str, Any]]:
    bound = _bound(case.multisine(0, outputs=3, inputs=2), 3, 2)
    return _rows("gimbal mimo", [_periodic(s, 3, 2, None) for s in range(SEEDS)], bound.error, bound)


def _random() -> list[dict[str, Any]]:
    scores = [_score(case.random_record(s), 1, 1, fit_record) for s in range(SEEDS)]
    name = "gimbal random"
    return [
        row(name, f"relative complex error, median of {SEEDS}", "", _median(scores, "error"), 1.5e-4,
            states=_common_order(scores)),
        row(name, "relative complex error, 95th percentile", "", _percentile(scores)),
        row(name, "delay error, worst", "ms", max(s.delay_ms for s in scores), 0.05),
        row(name, "fits in a wrong minimum", "", sum(not s.found for s in scores), 0),
        row(name, "time of a fit, median", "CPU s", _median(scores, "seconds")),
    ]  # fmt: skip


def _rows(
    name: str, scores: list[Score], stated: float, bound: Bound, peers: dict[str, Any] | None = None
) -> list[dict[str, Any]]:
    damping = float(np.sqrt(np.mean([(s.damping / bound.damping) ** 2 for s in scores])))
    note = f"bound: {stated:.3g}"
    return [
        row(name, f"relative complex error, median of {len(scores)}", "", _median(scores, "error"),
            1.1 * stated, states=_common_order(scores), note=f"1.1 times the {note}", peers=peers or {}),
        row(name, "relative complex error, 95th percentile", "", _percentile(scores), 1.6 * stated,
            note=f"1.6 times the {note}; an efficient fit has {bound.error_95:.3g}"),
        row(name, "log-magnitude error, median", "dB", _median(scores, "decibels"), 0.05),
        row(name, "rms of damping errors over their bounds", "", damping, 1.1,
            note=f"over {len(scores)} draws of 5 modes"),
        row(name, "delay error, worst", "ms", max(s.delay_ms for s in scores)),
        row(name, "fits in a wrong minimum", "", sum(not s.found for s in scores), 0),
        row(name, "time of a fit, median", "CPU s", _median(scores, "seconds")),
    ]  # fmt: skip


def _periodic(seed: int, outputs: int, inputs: int, states: int | None) -> Score:
    record = case.multisine(seed, outputs=outputs, inputs=inputs)
    return _score(record, outputs, inputs, lambda r: fit_response(estimate_response(r), states=states))


def _score(record: Record, outputs: int, inputs: int, fit: Callable[[Record], FitResult]) -> Score:
    begun = time.process_time()
    model = fit(record).model
    seconds = time.process_time() - begun
    truth = case.response(case.SCORED_HZ, outputs, inputs)
    E = model_response(model, case.SCORED_HZ)
    decibels = np.sqrt(np.mean((20.0 * np.log10(np.abs(E / truth))) ** 2))
    hz = natural_hz(model)
    nearest = np.array([int(np.argmin(np.abs(hz - f))) for f in case.MODES_HZ])
    found = bool(np.all(np.abs(hz[nearest] / case.MODES_HZ - 1.0) < FOUND)) and len(set(nearest)) == 5
    delay = 1e3 * float(np.abs(model.delay_s - case.DELAY_S[:outputs]).max())
    error = case.complex_error(E, truth)
    damping = damping_ratio(model)[nearest] - case.ZETA
    return Score(error, float(decibels), damping, delay, model.states, found, seconds)


def _bound(record: Record, outputs: int, inputs: int) -> Bound:
    truth = Gimbal(
        case.MODES_HZ, np.full(5, case.ZETA), case.PHI[:outputs], case.PSI[:inputs], case.DELAY_S[:outputs]
    )
    samples = record.u.shape[2]
    f = np.fft.rfftfreq(samples, 1.0 / record.sample_hz)
    on = (f >= 0.1) & (f <= 60.0)
    U = np.fft.rfft(record.u[:, 0], axis=1).transpose(1, 2, 0)[on]
    Y = np.einsum("koi,kie->koe", truth.response(f[on]), U)
    # rms^2 of an output by Parseval, and white noise averaged over the periods on each line.
    rms2 = 2.0 * np.mean(np.sum(np.abs(Y) ** 2, axis=0), axis=1) / samples**2
    return cramer_rao(truth, f[on], U, samples * 0.01**2 * rms2 / PERIODS, case.SCORED_HZ)


def _peers(python: str | None) -> dict[str, Any]:
    """On the first seed: vector fitting with 20 poles, for it has no delay; sdypy-EMA on 0.5-20 Hz."""
    truth = case.response(case.SCORED_HZ)
    record = case.multisine(0)
    columns: dict[str, Any] = {}
    whole, part = estimate_response(record), estimate_response(record, band_hz=(0.5, 20.0))
    fitting = peer(python, "scikit_rf.py", frequency_hz=whole.frequency_hz, H=whole.H, poles=20,
                   at_hz=case.SCORED_HZ)  # fmt: skip
    if fitting is not None:
        columns |= cell("scikit-rf vector fitting", fitting, case.complex_error(fitting["H"], truth))
    modal = peer(python, "sdypy_ema.py", frequency_hz=part.frequency_hz, H=part.H, order=30,
                 natural_hz=case.MODES_HZ, at_hz=case.SCORED_HZ)  # fmt: skip
    if modal is not None:
        columns |= cell("sdypy-EMA", modal, case.complex_error(modal["H"], truth))
    return columns


def _median(scores: list[Score], name: str) -> float:
    return float(np.median([getattr(s, name) for s in scores]))


def _percentile(scores: list[Score]) -> float:
    return float(np.percentile([s.error for s in scores], 95))


def _common_order(scores: list[Score]) -> int:
    return int(np.median([s.states for s in scores]))
