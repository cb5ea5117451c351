"""Models that users bring, beside measured hardware, the models of others, and closed forms.

    python benchmarks/hardware.py [--data FOLDER] [--only CASES] [--made DATE]

FOLDER holds takacs_beam and pazy_skin_off; GARTEUR's geometry is in its case.
"""

from __future__ import annotations

from measured import bent, component, constraints, deck, garteur, pazy, rotor, superelement, takacs
from measured.result_file import options_of, write_rows

CASES = {
    "Takacs": lambda o: takacs.rows(o.data),
    "Pazy": lambda o: pazy.rows(o.data),
    "GARTEUR": lambda o: garteur.rows(o.data),
    "Bent": lambda _: bent.rows(),
    "Rotor": lambda o: rotor.rows(o.peer_python),
    "Loop": lambda _: constraints.loop_rows(),
    "RBE3": lambda _: constraints.rbe3_rows(),
    "Component": lambda _: component.rows(),
    "Truss": lambda _: superelement.rows(),
    "Deck": lambda _: deck.rows(),
}


def main() -> None:
    write_rows("hardware", "python benchmarks/hardware.py", CASES, options_of(__doc__, CASES).parse_args())


if __name__ == "__main__":
    main()
