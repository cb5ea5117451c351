"""Write mace-simple-lab.json: python data/virtual-survey/make.py (README.md says what it is)."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

import middeck as md
from middeck.files.measured_modes import write_measured_modes
from middeck.structure.correlation.measured_modes import MeasuredModes, MeasurementNoise, measure_modes

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
CHANGED = ["material.lexan.E_pa=2.44e9", "node.2.mass_kg=9.2"]
CHANNELS = [(f"n{i}", d) for i in range(1, 6) for d in ("x", "y", "z", "rx")] + [
    (joint, "angle") for joint in ("pri_x", "pri_z", "sec_x", "sec_z")
]
FLEXIBLE = 8
SEED = 1995


def survey() -> MeasuredModes:
    """The first flexible modes of the changed article in the laboratory, with noise."""
    files = (ROOT / "articles" / "mace-simple.toml", ROOT / "environments" / "lab.toml")
    modes = md.solve_modes(md.solve_equilibrium(*md.load_setup(*files, CHANGED)))
    first = modes.kind.index("flexible")
    return measure_modes(
        modes,
        CHANNELS,
        chosen=range(first, first + FLEXIBLE),
        noise=MeasurementNoise(frequency=1e-3, shape=0.02),
        rng=np.random.default_rng(SEED),
    )


def rounded(measured: MeasuredModes) -> MeasuredModes:
    """To the digits that a test would print."""
    names = ("frequency_hz", "damping", "shape", "frequency_std_hz", "shape_std")
    return dataclasses.replace(measured, **{n: np.round(getattr(measured, n), 6) for n in names})


if __name__ == "__main__":
    write_measured_modes(HERE / "mace-simple-lab.json", rounded(survey()))
