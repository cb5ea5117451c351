"""Prediction: the sheet refined on simulated ground surveys, against a truth in orbit that it lacks; hardware
refined on some of what was measured, against the rest.

    python benchmarks/prediction.py [--data FOLDER] [--only CASES] [--made DATE]
        [--ledgers FOLDER] [--workers N]

CASES, of sheet, five, response, rig, promise, coverage, slip, frontier, multimodel, motors, Sag, Torsion,
update, chain and verdicts, are run alone and the other rows kept. FOLDER holds pazy_skin_off. Times are CPU
seconds of one process with one BLAS thread. Sheet and five are refined on modal surveys of the truth,
response on its responses too, rig on records of it. The cases "rig", "frontier", "motors" and "slip" take
hours: with a folder they keep the outcome of each truth there, and go on where they were cut off; a folder
holds for one state of the code.
"""

from __future__ import annotations

from measured import (
    all_motors,
    chain_times,
    coverage,
    garteur_promise,
    multimodel_bound,
    pazy_promise,
    prediction,
    promise,
    responses,
    rig_prediction,
    slip_promise,
)
from measured.result_file import options_of, write_rows

CASES = {
    "sheet": lambda _: prediction.rows("sheet", range(20)),
    "five": lambda _: prediction.rows("five", range(prediction.FIRST, prediction.FIRST + 5)),
    "response": lambda _: responses.rows(),
    "rig": rig_prediction.rows,
    "promise": promise.rows,
    "coverage": coverage.rows,
    "slip": slip_promise.rows,
    "frontier": promise.frontier_rows,
    "multimodel": multimodel_bound.rows,
    "motors": all_motors.rows,
    "Sag": lambda o: pazy_promise.rows(o.data),
    "Torsion": lambda o: garteur_promise.rows(o.data),
    "update": lambda _: chain_times.update_rows(),
    "chain": lambda _: chain_times.chain_rows(),
    "verdicts": lambda _: chain_times.verdict_rows(),
}


def main() -> None:
    write_rows(
        "prediction", "python benchmarks/prediction.py", CASES, options_of(__doc__, CASES).parse_args()
    )


if __name__ == "__main__":
    main()
