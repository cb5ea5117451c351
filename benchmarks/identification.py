"""Measurement models: the simulated gimbal, an article of 46 states, the real mirror and two real arms.

    python benchmarks/identification.py [--peer-python PYTHON] [--data FOLDER] [--only CASES] [--made DATE]

PYTHON is an interpreter with the peers of peers/identification-requirements.txt, in an environment of its
own; without one the peers' columns of the last result are kept. FOLDER holds cubespec_fsm, daisy_robot_arm
and daisy_cd_player_arm. CASES, of gimbal, article, mirror and arms, are run alone and the other rows kept.
Times are CPU seconds of one process with one BLAS thread.
"""

from __future__ import annotations

from measured import arms, article, gimbal, mirror
from measured.result_file import options_of, write_rows

CASES = {
    "gimbal": lambda o: gimbal.rows(o.peer_python),
    "article": lambda _: article.rows(),
    "mirror": lambda o: mirror.rows(o.data / "cubespec_fsm", o.peer_python),
    "arms": lambda o: arms.rows(o.data, o.peer_python),
}


def main() -> None:
    write_rows(
        "identification",
        "python benchmarks/identification.py",
        CASES,
        options_of(__doc__, CASES).parse_args(),
    )


if __name__ == "__main__":
    main()
