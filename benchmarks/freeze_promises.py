"""Promises about hardware that others built and measured, sealed: promises/*.json (its README tells of them).

    python benchmarks/freeze_promises.py [--data FOLDER] [--date YYYY-MM-DD]

Needs pazy_skin_off and garteur_smag19 of FOLDER. A promise that is there is never written over.
"""

from __future__ import annotations

import argparse
import datetime
import shutil
import tempfile
from pathlib import Path

import middeck as md
import pazy_files
from measured import garteur, garteur_promise
from measured.result_file import DATA
from middeck.cli.main import execute
from middeck.files.json.output import write_json
from middeck.files.promises.promise_documents import hash_files, loads_document

HERE = Path(__file__).resolve().parents[1] / "promises"
# By the load cases of each; restated before any outcome was known, with what larger loads may change.
PAZY = {
    "pazy-mid-chord": "pazy-mid-chord.toml",
    "pazy-behind": "pazy-behind.toml",
    "pazy-behind-restated": "pazy-behind.toml",
}
GARTEUR = {"garteur-from-three": (0, 1, 2), "garteur-from-five": (0, 1, 2, 3, 4)}
MODES = 12


def pazy(name: str, loads: str, data: Path, date: str) -> None:
    """By the verb, from files alone."""
    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder)
        pazy_files.write(files, data / "pazy_skin_off")
        shutil.copy(HERE / loads, files)
        asked = ["promise", str(files / pazy_files.ARTICLE), "--load-cases", str(files / loads)]
        code = execute([*asked, "--date", date, "-o", str(HERE / f"{name}.json")], lambda: False)
        assert code == 0, name


def aeroplane(name: str, chosen: tuple[int, ...], data: Path, date: str) -> None:
    """Frequencies on the bungees."""
    place = garteur.on_bungees()
    modes = md.solve_modes(md.solve_equilibrium(garteur.aeroplane(), place), garteur.MODES)
    found = garteur_promise.refined(modes, chosen)
    said = md.predict_modes(found, place, count=MODES)
    source = data / "garteur_smag19" / "garteur_geometry_tut.jl"
    document = loads_document(found, "bungees", (), said, files=hash_files((source,)), date=date)
    write_json(HERE / f"{name}.json", document)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--date", default=datetime.datetime.now(datetime.UTC).date().isoformat())
    options = parser.parse_args()
    for name, loads in PAZY.items():
        if not (HERE / f"{name}.json").exists():
            pazy(name, loads, options.data, options.date)
    for name, chosen in GARTEUR.items():
        if not (HERE / f"{name}.json").exists():
            aeroplane(name, chosen, options.data, options.date)


if __name__ == "__main__":
    main()
