"""Rest state and lowest modes of suspended frames, from a hundred to a million degrees of freedom.

    python benchmarks/structure.py [--peer-python PYTHON] [--made DATE] [--sizes 1e2,1e3,...]

PYTHON is an interpreter with what `peers/structure-requirements.txt` names; without one there are no peers'
columns. Every solution is a process of its own with one BLAS thread; times are its CPU seconds, the median of
several runs, rest state and modes together, without building the input. OPENSEES_BLAS, a library, takes
the place of the reference BLAS that OpenSees brings; the committed rows were made with Debian's OpenBLAS.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
RESULT = HERE / "results" / "structure.json"
MODES = 40
PARAMETERS = 50
# (case, size): runs of each program, and the peers that can do it in minutes.
PLAN = {
    ("bus", "1e2"): (5, ("opensees", "exudyn", "mujoco")),
    ("bus", "1e3"): (5, ("opensees", "exudyn", "mujoco")),
    ("boom", "1e4"): (3, ("opensees", "opensees-consistent", "exudyn")),
    ("boom", "1e5"): (3, ("opensees", "opensees-consistent")),
    ("boom", "1e6"): (1, ()),
}
TITLES = {
    "opensees": "OpenSeesPy, lumped mass",
    "opensees-consistent": "OpenSeesPy, consistent mass",
    "exudyn": "Exudyn",
    "mujoco": "MuJoCo",
}
# Asked: within 3 times the fastest up to 1e4, no slower from 1e5.
RATIO = {"1e2": 3.0, "1e3": 3.0, "1e4": 3.0, "1e5": 1.0}
GIB = 1024.0**3
MACHINE = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"


def model_of(case: str, size: str):
    """Structure, environment, and a function that gives the same as plain arrays."""
    if case == "bus":
        from bus import SIZES, frame_of_bus, structure_of_bus

        return (*structure_of_bus(SIZES[size]), lambda: frame_of_bus(SIZES[size]))
    from boom import SIZES, build_boom, frame_of_boom, structure_of_boom

    boom = build_boom(*SIZES[size])
    return (*structure_of_boom(boom), lambda: frame_of_boom(boom))


def solve_one(case: str, size: str, target: Path) -> None:
    """In a process of its own: times, peak memory and frequencies."""
    from middeck.structure.modes.solve import solve_modes
    from middeck.structure.rest.equilibrium import solve_equilibrium

    structure, environment, _ = model_of(case, size)
    clock = [time.process_time()]
    rest = solve_equilibrium(structure, environment)
    clock.append(time.process_time())
    modes = solve_modes(rest, MODES)
    clock.append(time.process_time())
    result = {
        "cpu_seconds": dict(zip(("equilibrium", "modes"), np.diff(clock).tolist(), strict=True)),
        "peak_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "dof": rest.model.tree.size,
        "residual": max(rest.residual, float(modes.residual.max())),
        "frequency_hz": modes.frequency_hz[:MODES].tolist(),
    }
    target.write_text(json.dumps(result))


def differentiate_one(case: str, target: Path) -> None:
    """Sensitivities of 40 frequencies to 50 parameters spread over all there are; one eigensolution."""
    from middeck.files.setups import load_setup
    from middeck.structure.modes.solve import solve_modes
    from middeck.structure.rest.equilibrium import solve_equilibrium
    from middeck.structure.sensitivity.frequency_derivatives import differentiate_frequencies
    from middeck.structure.sensitivity.parameters import list_parameters

    files = (HERE.parent / "articles" / "mace-dm.toml", HERE.parent / "environments" / "lab.toml")
    structure, environment = load_setup(*files) if case == "mace-dm" else model_of("boom", case)[:2]
    rest = solve_equilibrium(structure, environment)
    every = list_parameters(structure, environment)
    some = [every[i] for i in np.linspace(0, len(every) - 1, PARAMETERS).astype(int)]
    times: list[list[float]] = []
    for _ in range(3):  # the first run loads libraries
        clock = [time.process_time()]
        modes = solve_modes(rest, MODES)
        clock.append(time.process_time())
        differentiate_frequencies(modes, some, MODES)
        clock.append(time.process_time())
        times.append(np.diff(clock).tolist())
    modes_s, sensitivities_s = np.median(times, axis=0)
    target.write_text(
        json.dumps({"dof": rest.model.tree.size, "modes": modes_s, "sensitivities": sensitivities_s})
    )


def sensitivity_rows(case: str) -> list[dict]:
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "out.json"
        subprocess.run(
            [sys.executable, str(Path(__file__)), "--differentiate", case, str(target)], check=True
        )
        found = json.loads(target.read_text())
    label = (
        "mace-dm in the lab" if case == "mace-dm" else f"suspended boom, {found['dof']} degrees of freedom"
    )
    measure = f"{MODES} frequencies to {PARAMETERS} parameters, in eigensolutions of {MODES} modes"
    return [
        _row(label, "one eigensolution", "CPU s", found["modes"]),
        _row(label, measure, "", found["sensitivities"] / found["modes"], 5.0),
    ]


def run_ours(case: str, size: str, runs: int) -> dict:
    return _median(runs, [sys.executable, str(Path(__file__)), "--one", case, size])


def run_peer(python: str, name: str, source: Path, runs: int) -> dict | None:
    program, *mass = name.split("-")
    command = [python, str(HERE / "peers" / f"{program}_structure.py"), str(source)]
    return _median(runs, command, mass or (["lumped"] if program == "opensees" else []))


def _median(runs: int, command: list[str], more: list[str] | None = None) -> dict | None:
    """The last of ``runs`` results with the median of their times."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    found: list[dict] = []
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            target = Path(folder) / "out.json"
            done = subprocess.run([*command, str(target), *(more or [])], env=environment, cwd=folder)
            if done.returncode:
                return None
            found.append(json.loads(target.read_text()))
    seconds = [f["cpu_seconds"]["equilibrium"] + f["cpu_seconds"]["modes"] for f in found]
    return {**found[-1], "seconds": float(np.median(seconds))}


def rows_of(case: str, size: str, runs: int, peers: dict[str, dict], ours: dict) -> list[dict]:
    """Error first, then time, memory and the ratio to the fastest."""
    label = f"suspended {case}, {ours['dof']} degrees of freedom"
    rows = []
    if case == "bus":
        errors = {n: _bus_error(p["frequency_hz"]) for n, p in peers.items()}
        rows.append(
            _row(
                label,
                "largest error of 15 frequencies, to the limit of the mesh",
                "",
                _bus_error(ours["frequency_hz"]),
            )
            | {"peers": _cells(peers, errors)}
        )
    elif peers:
        gaps = {n: _gap(ours["frequency_hz"], p["frequency_hz"]) for n, p in peers.items()}
        note = "the peer's column is its distance from ours; lumped masses and no rotary inertia are theirs"
        rows.append(
            {
                **_row(label, "largest difference of 40 frequencies", "", 0.0),
                "peers": _cells(peers, gaps),
                "note": note,
            }
        )
    else:
        rows.append(_row(label, "largest residual, rest state and 40 modes", "", ours["residual"], 1e-9))
    times = {n: p["seconds"] for n, p in peers.items()}
    rows.append(
        {**_row(label, "rest state and 40 modes", "CPU s", ours["seconds"]), "peers": _cells(peers, times)}
    )
    memory = {n: p["peak_bytes"] / GIB for n, p in peers.items()}
    level = 16.0 if size == "1e6" else None
    rows.append(
        {**_row(label, "peak memory", "GiB", ours["peak_bytes"] / GIB, level), "peers": _cells(peers, memory)}
    )
    if times:
        fastest = min(times, key=times.get)
        rows.append(
            {
                **_row(
                    label, "time over the fastest peer", "", ours["seconds"] / times[fastest], RATIO[size]
                ),
                "note": TITLES[fastest],
            }
        )
    return rows


def _bus_error(frequency_hz: list[float]) -> float:
    """Against the frequencies that two peers extrapolated (tests/cross/suspended_bus)."""
    source = HERE.parent / "tests" / "cross" / "suspended_bus" / "results.json"
    truth = np.array(json.loads(source.read_text())["variants"]["bare_1g"]["mujoco"]["hz"][:15])
    return float(np.abs(np.array(frequency_hz[: len(truth)]) / truth - 1.0).max())


def _gap(ours: list[float], theirs: list[float]) -> float:
    return float(np.abs(np.array(theirs[:MODES]) / np.array(ours[:MODES]) - 1.0).max())


def growth_rows(ours: dict[tuple[str, str], dict]) -> list[dict]:
    """Exponent of time against degrees of freedom, between the booms."""
    booms = [v for (case, _), v in ours.items() if case == "boom"]
    if len(booms) < 2:
        return []
    dof, seconds = (np.log([b[k] for b in booms]) for k in ("dof", "seconds"))
    exponent = float(np.polyfit(dof, seconds, 1)[0])
    return [_row("suspended boom", "growth exponent of the time", "", exponent, 1.3)]


def _row(case: str, measure: str, unit: str, value: float, level: float | None = None) -> dict:
    met = None if level is None else bool(value <= level)
    return {
        "case": case,
        "measure": measure,
        "unit": unit,
        "value": value,
        "level": level,
        "met": met,
        "peers": {},
    }


def _cells(peers: dict[str, dict], values: dict[str, float]) -> dict[str, dict]:
    return {TITLES[n]: {"value": values[n], "version": p["version"]} for n, p in peers.items()}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--peer-python")
    parser.add_argument("--made", default=datetime.date.today().isoformat())
    parser.add_argument("--sizes", default="1e2,1e3,1e4,1e5,1e6")
    parser.add_argument("--differentiate", nargs=2, metavar=("CASE", "OUT"), help=argparse.SUPPRESS)
    parser.add_argument("--one", nargs=3, metavar=("CASE", "SIZE", "OUT"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        solve_one(given.one[0], given.one[1], Path(given.one[2]))
        return
    if given.differentiate:
        differentiate_one(given.differentiate[0], Path(given.differentiate[1]))
        return
    rows: list[dict] = []
    ours: dict[tuple[str, str], dict] = {}
    for (case, size), (runs, names) in PLAN.items():
        if size not in given.sizes.split(","):
            continue
        ours[case, size] = run_ours(case, size, runs)
        peers = {}
        with tempfile.TemporaryDirectory() as folder:
            source = Path(folder) / "frame.npz"
            if given.peer_python and names:
                np.savez(source, modes=MODES, **model_of(case, size)[2]())
            for name in names if given.peer_python else ():
                found = run_peer(given.peer_python, name, source, runs if size != "1e5" else 1)
                peers |= {name: found} if found else {}
        rows += rows_of(case, size, runs, peers, ours[case, size])
    rows += growth_rows(ours)
    for case in ("mace-dm", "1e4"):
        rows += sensitivity_rows(case)
    RESULT.write_text(
        json.dumps(
            {
                "made": given.made,
                "machine": MACHINE,
                "command": "python benchmarks/structure.py",
                "rows": rows,
            },
            indent=1,
        )
        + "\n"
    )


if __name__ == "__main__":
    main()
