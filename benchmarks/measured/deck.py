"""A generated deck of 1e5 degrees of freedom: from bulk data to 40 modes and a plant.

The lattice boom of `boom`, clamped at its root, written as CBARs and CONM2s; the textbook's matrices without
middeck say what its frequencies are.
"""

from __future__ import annotations

import dataclasses
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HERE))

from measured.rows import row  # noqa: E402
from measured.textbook_frame import clamped_frequencies  # noqa: E402

MODES, RUNS = 40, 3
GIB = 2.0**30


def deck_of(frame: dict[str, np.ndarray], held: np.ndarray) -> str:
    """Bulk data of plain arrays, see `boom.frame_of_boom`; nodes ``held`` are clamped."""
    from boom import AREA, RHO, SECOND, E, G

    along = frame["x"][frame["ends"][:, 1]] - frame["x"][frame["ends"][:, 0]]
    upright = (along[:, 0] == 0.0) & (along[:, 1] == 0.0)
    lines = ["SOL 103", "CEND", "SPC = 1", "BEGIN BULK", f"MAT1,1,{E:.9E},{G:.9E},,{RHO:.6f}"]
    lines.append(f"PBAR,1,1,{AREA:.15E},{SECOND:.15E},{SECOND:.15E},{2.0 * SECOND:.15E}")
    lines += [f"GRID,{i},,{x:.4f},{y:.4f},{z:.4f}" for i, (x, y, z) in enumerate(frame["x"].tolist(), 1)]
    lines += [
        f"CBAR,{i},1,{a + 1},{b + 1},{'0.,1.,0.' if up else '0.,0.,1.'}"
        for i, ((a, b), up) in enumerate(zip(frame["ends"].tolist(), upright.tolist(), strict=True), 1)
    ]
    bodies = zip(frame["body_node"], frame["body_mass"], frame["body_inertia"], strict=True)
    for node, mass, inertia in bodies:
        a, b, c = (f"{x:.9E}" for x in inertia)
        lines += [f"CONM2,{1_000_000 + node},{node + 1},,{mass:.9f},,,,,", f",{a},,{b},,,{c}"]
    lines += [f"SPC1,1,123456,{node + 1}" for node in held]
    return "\n".join([*lines, "ENDDATA", ""])


def boom_held():
    """The boom and the joints at its root."""
    from boom import SIZES, build_boom

    boom = build_boom(*SIZES["1e5"])
    return boom, np.flatnonzero(boom.joints[:, 0] == 0.0)


def solve_one(article: str, environment: str, target: str) -> None:
    """Modes and a plant of the article, with what they took, as JSON into ``target``."""
    import middeck as md
    from middeck.structure.model.article import Actuator, ActuatorKind, Sensor, SensorKind

    start = time.process_time()
    structure, held = md.load_setup(article, environment)
    tip = max(structure.nodes, key=lambda node: node.position[0]).name
    force = Actuator(name="push", frame=tip, axis=np.array([0.0, 1.0, 0.0]), kind=ActuatorKind.FORCE)
    motion = Sensor(
        name="turn", frame=tip, axis=np.array([0.0, 0.0, 1.0]), axis_frame=tip, kind=SensorKind.ANGLE
    )
    structure = dataclasses.replace(structure, actuators=(force,), sensors=(motion,))
    modes = md.solve_modes(md.solve_equilibrium(structure, held), MODES)
    plant = md.build_plant(modes, inputs=["push"], outputs=["turn"], count=MODES)
    found = {
        "frequency_hz": modes.frequency_hz[:MODES].tolist(),
        "residual": float(modes.residual[:MODES].max()),
        "outputs": len(plant.outputs),
        "cpu": time.process_time() - start,
        "dof": int(modes.equilibrium.model.tree.size),
    }
    Path(target).write_text(json.dumps(found))


def rows() -> list[dict]:
    """Time, memory, the reader's speed, and how far the frequencies are from those of the boom itself."""
    from boom import frame_of_boom

    boom, held = boom_held()
    taken, peak, speed, columns, floor = [], 0.0, [], [], []
    with tempfile.TemporaryDirectory() as folder:
        deck, article, around, out = (
            f"{folder}/{n}" for n in ("boom.dat", "boom.toml", "held.toml", "out.json")
        )
        text = deck_of(frame_of_boom(boom), held)
        Path(deck).write_text(text)
        Path(f"{folder}/columns.dat").write_text(in_columns(text))
        convert = ["-c", "from middeck.cli.main import run; run()", "convert", deck, "--units", "m-kg-s-N"]
        for _ in range(RUNS):
            first = _run([*convert, "-o", article, "--environment", around])
            second = _run([__file__, article, around, out])
            taken.append(first[0] + second[0])
            peak = max(peak, first[1], second[1])
            speed.append(_reader_speed(deck))
            columns.append(_reader_speed(f"{folder}/columns.dat"))
            floor.append(_floor(deck, text.count("\n") - text.count("\n,")))
        found = json.loads(Path(out).read_text())
    case = f"Deck of a lattice boom, {found['dof']} degrees of freedom"
    read, narrow, bare = (float(np.median(part)) for part in (speed, columns, floor))
    gap = np.abs(np.array(found["frequency_hz"]) / _textbook(frame_of_boom(boom), held) - 1.0).max()
    return [
        row(case, "largest difference of 40 frequencies from the textbook's matrices", "", float(gap), 1e-6),
        row(case, "largest residual of 40 modes", "", found["residual"], 1e-9),
        row(case, "from file to 40 modes and a plant", "CPU s", float(np.median(taken)), 60.0),
        row(case, "peak memory", "GiB", peak, 4.0),
        row(case, "reader", "cards/CPU s", read, 1e5) | {"met": read >= 1e5},
        row(case, "reader, columns of eight", "cards/CPU s", narrow, 1e5) | {"met": narrow >= 1e5},
        row(case, "reader over splitting lines at commas", "times", bare / read),
    ]


def _run(command: list[str]) -> tuple[float, float]:
    """CPU seconds and peak memory [GiB] of a program."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    subprocess.run([sys.executable, *command], check=True, env=environment, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return cpu, after.ru_maxrss * 1024.0 / GIB


def _reader_speed(deck: str) -> float:
    from middeck.files.nastran.deck.deck import read_deck

    start = time.process_time()
    found = read_deck(deck)  # kept: to free it is no part of reading it
    return found.cards / (time.process_time() - start)


def in_columns(text: str) -> str:
    """Free-field bulk data in columns of eight, reals with three digits: for the speed alone."""
    head, bulk = text.split("BEGIN BULK\n")
    lines = []
    for line in bulk.splitlines():
        name, *fields = line.split(",")
        short = [f"{float(f):.2E}" if "." in f and len(f) > 8 else f for f in fields]
        lines.append(f"{name:<8}" + "".join(f"{f:>8}" for f in short))
    return f"{head}BEGIN BULK\n" + "\n".join([*lines, ""])


def _floor(deck: str, cards: int) -> float:
    """Cards a second where every line is only split at its commas."""
    start = time.process_time()
    split = [line.split(",") for line in Path(deck).read_text().splitlines()]
    return cards / (time.process_time() - start) if split else 0.0


def _textbook(frame: dict[str, np.ndarray], held: np.ndarray) -> np.ndarray:
    from boom import AREA, RHO, SECOND, E, G

    bar = {"E": E, "G": G, "area": AREA, "second": SECOND, "polar": 2.0 * SECOND, "density": RHO}
    return clamped_frequencies(frame, held, bar, MODES)


if __name__ == "__main__":
    solve_one(*sys.argv[1:])
