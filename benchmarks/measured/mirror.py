"""The real mirror at both amplitudes: order chosen by the program, then set by hand."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from measured.rows import cell, peer, row
from middeck import estimate_response, fit_response
from middeck.identification import nrmse
from middeck.signals.ports import Port
from middeck.signals.record import Record

SAMPLE_HZ = 6400.0
BAND_HZ = (0.5, 3000.0)
# By amplitude [mV], then by order; None: no level at this order was asked for.
LEVELS = {300: {28: (4.2, 5.6, 4.8), 40: (3.6, 4.0, 3.5)}, 100: {28: (5.6, 6.0, 6.5)}}
REPEATS = 3
BLOCK_ROWS = 20  # of nfoursid, twice the states over the outputs


def rows(data: Path, python: str | None) -> list[dict[str, Any]]:
    """Held-out errors and times; ``data`` is the folder of the records."""
    found: list[dict[str, Any]] = []
    for amplitude, levels in LEVELS.items():
        train, test = (load(data, amplitude, part) for part in ("train", "test"))
        found += _errors(f"mirror {amplitude} mV", train, test, None, levels[28])
        for states, level in levels.items():
            found += _errors(f"mirror {amplitude} mV, order by hand", train, test, states, level)
    return found + _beside_vector_fitting(data, python) + _beside_nfoursid(data, python)


def load(data: Path, amplitude: int, part: str) -> Record:
    """(sample, channel, realisation, period) in the files of the data set."""
    u, y = (np.load(data / f"{x}_{amplitude}mV_{part}.npy").transpose(2, 3, 0, 1) for x in "uy")
    inputs = tuple(Port(f"piezo {i}", "V") for i in (1, 2, 3))
    outputs = tuple(Port(f"displacement {i}", "m") for i in (1, 2, 3))
    return Record(sample_hz=SAMPLE_HZ, u=u, y=y, inputs=inputs, outputs=outputs, periodic=True)


def _errors(
    case: str, train: Record, test: Record, states: int | None, levels: tuple[float, ...]
) -> list[dict[str, Any]]:
    measured = estimate_response(train, band_hz=BAND_HZ)
    begun = time.process_time()
    model = fit_response(measured, states=states, sample_hz=SAMPLE_HZ).model
    seconds = time.process_time() - begun
    errors = 100.0 * nrmse(model, test)
    note = "held out" if states else "held out; order by the program, level: that of 28 states"
    return [
        *(
            row(case, f"NRMSE of output {o + 1}", "%", errors[o], levels[o], states=model.states, note=note)
            for o in range(3)
        ),
        row(case, "time of the fit", "CPU s", seconds, states=model.states),
    ]


def _beside_vector_fitting(data: Path, python: str | None) -> list[dict[str, Any]]:
    """Both at 30 states: ten poles with full residues there, rank-one residues here."""
    case, states = "mirror 300 mV beside vector fitting", 30
    train, test = (load(data, 300, part) for part in ("train", "test"))
    measured = estimate_response(train, band_hz=BAND_HZ)
    at_hz = np.fft.rfftfreq(test.u.shape[2], 1.0 / SAMPLE_HZ)
    seconds, theirs = [], []
    theirs_found = None
    for _ in range(REPEATS):
        begun = time.process_time()
        model = fit_response(measured, states=states, sample_hz=SAMPLE_HZ).model
        seconds.append(time.process_time() - begun)
        theirs_found = peer(python, "scikit_rf.py", frequency_hz=measured.frequency_hz, H=measured.H,
                            poles=states // 3, at_hz=at_hz)  # fmt: skip
        theirs.append(np.nan if theirs_found is None else float(theirs_found["seconds"]))
    name = "scikit-rf vector fitting"
    ours = 100.0 * nrmse(model, test)
    peers = [{}] * 4
    if theirs_found is not None:
        errors = 100.0 * _nrmse_of(theirs_found["H"], test)
        peers = [cell(name, theirs_found, v) for v in (*errors, float(np.median(theirs)))]
    time_row = row(case, "time of the fit, median of 3", "CPU s", float(np.median(seconds)), states=states,
                   peers=peers[3])  # fmt: skip
    ratio = float(np.median(seconds) / np.median(theirs))
    errors_rows = [
        row(case, f"NRMSE of output {o + 1}", "%", ours[o], states=states, peers=peers[o]) for o in range(3)
    ]
    if np.isnan(ratio):
        return [*errors_rows, time_row]
    return [
        *errors_rows,
        time_row,
        row(case, "time over that of vector fitting", "", ratio, 1.0, states=states),
    ]


def _beside_nfoursid(data: Path, python: str | None) -> list[dict[str, Any]]:
    """All samples here, from records to model; there one experiment of six: all do not fit in its memory."""
    case, states = "mirror 300 mV beside nfoursid", 30
    train, test = (load(data, 300, part) for part in ("train", "test"))
    begun = time.process_time()
    model = fit_response(estimate_response(train, band_hz=BAND_HZ), states=states, sample_hz=SAMPLE_HZ).model
    seconds = time.process_time() - begun
    u, y = (x[0].reshape(-1, x.shape[3]) for x in (train.u, train.y))
    found = peer(python, "time_domain.py", tool="nfoursid", u=u, y=y, states=states, block_rows=BLOCK_ROWS)
    peers: list[dict[str, Any]] = [{}] * 4
    if found is not None:
        z = np.exp(2j * np.pi * np.fft.rfftfreq(test.u.shape[2]))[:, None, None]
        A, B, C, D = (found[k] for k in "ABCD")
        errors = 100.0 * _nrmse_of(C @ np.linalg.solve(z * np.eye(len(A)) - A, B + 0j * z) + D, test)
        peers = [cell("nfoursid", found, v) for v in (*errors, float(found["seconds"]))]
    ours = 100.0 * nrmse(model, test)
    result = [
        row(case, f"NRMSE of output {o + 1}", "%", ours[o], states=states, peers=peers[o]) for o in range(3)
    ]
    note = "all samples; nfoursid: one experiment of them"
    result.append(row(case, "time from samples to model", "CPU s", seconds, states=states, peers=peers[3],
                      note=note))  # fmt: skip
    if found is not None:
        ratio = seconds / float(found["seconds"])
        result.append(row(case, "time over that of nfoursid", "", ratio, 1.0, states=states, note=note))
    return result


def _nrmse_of(H: np.ndarray, test: Record) -> np.ndarray:
    Y = np.einsum("koi,epki->epko", H, np.fft.rfft(test.u, axis=2))
    y = np.fft.irfft(Y, n=test.u.shape[2], axis=2)
    return np.sqrt(np.sum((test.y - y) ** 2, axis=(0, 1, 2)) / np.sum(test.y**2, axis=(0, 1, 2)))
