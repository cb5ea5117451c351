"""Measurement models: the real mirror and the simulated gimbal.

    python benchmarks/identification.py [--peer-python PYTHON] [--made DATE]

PYTHON is an interpreter with scikit-rf, in an environment of its own; without one the peers' columns of the
last result are kept. Times are of one process with one BLAS thread. Noise seeds 0 to 19.
"""

from __future__ import annotations

import argparse
import datetime
import importlib
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from middeck.files.records import load_record
from middeck.identification import estimate_response, fit_response, model_response, nrmse
from middeck.systems.record import Record
from middeck.systems.response import FrequencyResponse

HERE = Path(__file__).resolve().parent
RESULT = HERE / "results" / "identification.json"
MIRROR = HERE.parent / "data" / "cubespec-fsm"
# The frozen case is shared with the tests.
sys.path.insert(0, str(HERE.parent / "tests" / "truth"))
gimbal_record = importlib.import_module("gimbal_record")

# The data set's own notebook: freq-statespace, 28 states (see data/cubespec-fsm/README.md).
PUBLISHED = (4.54, 7.02, 5.35)
# Median Cramer-Rao bound of the case `multisine` with real modal constants.
BOUND = 1.18e-4
SEEDS = range(20)


def mirror_rows(peer: str | None) -> list[dict]:
    train, test = (load_record(MIRROR / f"mirror-300mV-{part}.npz") for part in ("train", "test"))
    measured = estimate_response(train, band_hz=(0.5, 3000.0))
    begun = time.perf_counter()
    fitted = fit_response(measured, states=28, sample_hz=train.sample_hz)
    seconds = time.perf_counter() - begun
    errors = 100.0 * nrmse(fitted.model, test)
    found = _peer(peer, measured, 10, np.fft.rfftfreq(test.u.shape[2], 1.0 / test.sample_hz))
    theirs = None if found is None else 100.0 * _nrmse_of(found["H"], test)
    note = "held-out; level: published baseline; vector fitting: 10 poles, full residues, 30 states"
    rows = [
        {
            **_row("mirror 300 mV", f"NRMSE of output {o + 1}", "%", errors[o], PUBLISHED[o]),
            "peers": {} if theirs is None else _peer_cell(theirs[o], found),
            "states": 28,
            "note": note,
        }
        for o in range(3)
    ]
    peers = {} if found is None else _peer_cell(float(found["seconds"]), found)
    return [*rows, {**_row("mirror 300 mV", "time of the fit", "s", seconds), "peers": peers, "states": 28}]


def _nrmse_of(H: np.ndarray, test: Record) -> np.ndarray:
    Y = np.einsum("koi,epki->epko", H, np.fft.rfft(test.u, axis=2))
    y = np.fft.irfft(Y, n=test.u.shape[2], axis=2)
    return np.sqrt(np.sum((test.y - y) ** 2, axis=(0, 1, 2)) / np.sum(test.y**2, axis=(0, 1, 2)))


def gimbal_rows(peer: str | None) -> list[dict]:
    f = gimbal_record.SCORED_HZ
    truth = gimbal_record.response(f)
    errors, decibels, delays, theirs, found, seconds = [], [], [], [], None, 0.0
    for seed in SEEDS:
        measured = estimate_response(gimbal_record.multisine(seed))
        begun = time.perf_counter()
        model = fit_response(measured, states=10).model
        seconds += time.perf_counter() - begun
        E = model_response(model, f)
        errors.append(gimbal_record.complex_error(E, truth))
        decibels.append(np.sqrt(np.mean((20.0 * np.log10(np.abs(E / truth))) ** 2)))
        delays.append(1e3 * abs(model.delay_s[0] - gimbal_record.DELAY_S[0]))
        found = _peer(peer, measured, 20, f)
        theirs.append(np.nan if found is None else gimbal_record.complex_error(found["H"], truth))
    peers = {} if found is None else _peer_cell(float(np.median(theirs)), found)
    case, seeds = "gimbal multisine", f"{len(errors)} seeds"
    return [
        {
            **_row(case, f"relative complex error, median of {seeds}", "", np.median(errors), 1.1 * BOUND),
            "states": 10,
            "peers": peers,
            "note": "1.1 times the Cramer-Rao bound; vector fitting has 20 poles, for it has no delay",
        },
        {**_row(case, f"relative complex error, worst of {seeds}", "", max(errors)), "states": 10},
        {
            **_row(case, f"log-magnitude error, median of {seeds}", "dB", np.median(decibels), 0.05),
            "states": 10,
        },
        {**_row(case, f"delay error, worst of {seeds}", "ms", max(delays), 0.05), "states": 10},
        {**_row(case, "time of a fit, mean", "s", seconds / len(errors)), "states": 10},
    ]


def _row(case: str, measure: str, unit: str, value: float, level: float | None = None) -> dict:
    met = None if level is None else bool(value <= level)
    return {
        "case": case,
        "measure": measure,
        "unit": unit,
        "value": float(value),
        "level": level,
        "met": met,
        "peers": {},
    }


def _peer_cell(value: float, found: dict) -> dict:
    return {"scikit-rf vector fitting": {"value": float(value), "version": str(found["version"])}}


def _peer(python: str | None, measured: FrequencyResponse, poles: int, at_hz: np.ndarray) -> dict | None:
    if python is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(source, frequency_hz=measured.frequency_hz, H=measured.H, poles=poles, at_hz=at_hz)
        subprocess.run([python, str(HERE / "peers" / "scikit_rf.py"), str(source), str(target)], check=True)
        with np.load(target, allow_pickle=False) as z:
            return {k: z[k] for k in z.files}


def _keep_peers(rows: list[dict]) -> None:
    """Errors of a peer of a stated version do not change; its times are not kept."""
    if not RESULT.exists():
        return
    before = {(r["case"], r["measure"]): r["peers"] for r in json.loads(RESULT.read_text())["rows"]}
    for row in rows:
        if row["unit"] != "s":
            row["peers"] = row["peers"] or before.get((row["case"], row["measure"]), {})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peer-python")
    parser.add_argument("--made", default=datetime.date.today().isoformat())
    options = parser.parse_args()
    rows = mirror_rows(options.peer_python) + gimbal_rows(options.peer_python)
    if options.peer_python is None:
        _keep_peers(rows)
    result = {
        "made": options.made,
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, one used",
        "command": "python benchmarks/identification.py",
        "rows": rows,
    }
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(result, indent=1) + "\n")
    for row in rows:
        print(
            f"{row['case']:18s} {row['measure']:45s} {row['value']:10.4g} {row['unit']}  level {row['level']}"
        )


if __name__ == "__main__":
    main()
