"""Prediction: the sheet refined on simulated ground surveys, against a truth in orbit that it lacks.

    python benchmarks/prediction.py [--only CASES] [--made DATE]

CASES, of sheet, five, rig, promise and frontier, are run alone and the other rows kept. Times are CPU seconds
of one process with one BLAS thread. Sheet and five are refined on modal surveys of the truth, rig on records
of it, which take an hour.
"""

from __future__ import annotations

from measured import prediction, promise, rig_prediction
from measured.result_file import options_of, write_rows

CASES = {
    "sheet": lambda _: prediction.rows("sheet", range(20)),
    "five": lambda _: prediction.rows("five", range(prediction.FIRST, prediction.FIRST + 5)),
    "rig": lambda _: rig_prediction.rows(),
    "promise": promise.rows,
    "frontier": promise.frontier_rows,
}


def main() -> None:
    write_rows(
        "prediction", "python benchmarks/prediction.py", CASES, options_of(__doc__, CASES).parse_args()
    )


if __name__ == "__main__":
    main()
