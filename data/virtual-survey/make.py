"""Write surveys and outcome of this folder: python data/virtual-survey/make.py (README.md tells of them)."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

import middeck as md
from middeck.control.robust.verification.monte_carlo import outcomes_on
from middeck.files.measured.modes import write_measured_modes
from middeck.files.promises.plans import load_plan
from middeck.structure.correlation.measured_modes import MeasuredModes, MeasurementNoise, measure_modes
from middeck.updating.promise.plan import close_inner, group_loop, plant_of, weights_of
from middeck.updating.promise.promise import design_ladder
from middeck.updating.residuals.surveys import set_up

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
ARTICLE = ROOT / "articles" / "mace-simple.toml"
FLOWN = "mace-simple-orbit.json"
CHANGED = ["material.lexan.E_pa=2.44e9", "node.2.mass_kg=9.2"]
CHANNELS = [(f"n{i}", d) for i in range(1, 6) for d in ("x", "y", "z", "rx")] + [
    (joint, "angle") for joint in ("pri_x", "pri_z", "sec_x", "sec_z")
]
FLEXIBLE = 8
SEED = 1995


def survey() -> MeasuredModes:
    """The first flexible modes of the changed article in the laboratory, with noise."""
    files = (ARTICLE, ROOT / "environments" / "lab.toml")
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
    stated = {n: value for n in names if (value := getattr(measured, n)) is not None}
    few = {n: np.round(value, 6) for n, value in stated.items()}
    return dataclasses.replace(measured, **few, position_m=None)


def in_orbit() -> md.Modes:
    """Of the changed article."""
    article = md.load_structure(ARTICLE, CHANGED)
    return md.solve_modes(md.solve_equilibrium(article, md.Environment.orbit()))


def survey_in_orbit() -> MeasuredModes:
    """Its first flexible modes, without noise."""
    modes = in_orbit()
    first = modes.kind.index("flexible")
    return measure_modes(modes, CHANNELS, chosen=range(first, first + FLEXIBLE))


def outcome() -> str:
    """What comes of promise.toml: the changed article in orbit under the compensators of the ladder."""
    loaded = load_plan(HERE / "promise.toml", ARTICLE)
    plan = loaded.plan
    refined = md.refine(loaded.structure, *loaded.refinement.of_refine)
    orbit = plan.environments["orbit"]
    there = set_up(refined.structure, orbit, (), refined.unknowns).solve(refined.x)
    whole = md.delay_plant(close_inner(plan, plant_of(plan, in_orbit())), plan.loop.delay_s)
    lines = ['schema = "middeck.outcome/1"', "", "[[survey]]", 'environment = "orbit"']
    lines += [f'modes = "{FLOWN}"']
    for name, law in design_ladder(there, plan).items():
        (flown,) = outcomes_on(
            [group_loop(plan, whole, plan.ladder.drives, plan.ladder.reads)],
            law,
            weights_of(plan, law.outputs, law.inputs),
        )
        stable = bool(flown.stable[0])
        lines += ["", "[[compensator]]", 'environment = "orbit"', f'name = "{name}"']
        lines += [f"stable = {str(stable).lower()}", *([f"rms_db = {flown.db[0]:.2f}"] if stable else [])]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    write_measured_modes(HERE / "mace-simple-lab.json", rounded(survey()))
    write_measured_modes(HERE / FLOWN, rounded(survey_in_orbit()))
    (HERE / "outcome.toml").write_text(outcome(), encoding="utf-8")
