"""Measured hardware that nobody here made: our models and fits beside measurements and the models of others.

    python benchmarks/hardware.py [--data FOLDER] [--only CASES] [--made DATE]

FOLDER holds takacs_beam and pazy_skin_off; GARTEUR's geometry is in its case.
"""

from __future__ import annotations

from measured import deck, garteur, pazy, takacs
from measured.result_file import options_of, write_rows

CASES = {
    "Takacs": lambda o: takacs.rows(o.data),
    "Pazy": lambda o: pazy.rows(o.data),
    "GARTEUR": lambda o: garteur.rows(o.data),
    "Deck": lambda o: deck.rows(),
}


def main() -> None:
    write_rows("hardware", "python benchmarks/hardware.py", CASES, options_of(__doc__, CASES).parse_args())


if __name__ == "__main__":
    main()
