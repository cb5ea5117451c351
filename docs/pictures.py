"""Draw the pictures of the pages, docs/images/*.svg, by the project's own code; `make pictures`.

    python docs/pictures.py [NAME ...]

The docstring of a function is the description that stands inside its picture.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.figure import Figure

import middeck as md
from middeck.files.disk.atomic import write_text
from middeck.files.promises.outcomes import comparison_document, load_outcomes
from middeck.files.promises.promise_file import read_promise
from middeck.plot.amplitude import draw_amplitude
from middeck.plot.budget import budget_figure
from middeck.plot.curves import draw_magnitude
from middeck.plot.fit import fit_figure
from middeck.plot.gimbal_family import draw_gimbal_family
from middeck.plot.gravity_path import gravity_path_figure
from middeck.plot.nyquist import draw_nyquist
from middeck.plot.promises import promise_figure
from middeck.plot.shapes import Shown, shapes_figure
from middeck.plot.stabilisation import stabilisation
from middeck.plot.style import COLOUR, DASHES, LABEL, frequency_axis, new_figure, styled
from middeck.plot.svg import svg_text
from middeck.structure.gravity.compare_modes import ModeComparison
from middeck.study.chapters.gravity_modes.figure_3 import figure_3
from middeck.study.chapters.gravity_modes.figures_4_5 import figure_4
from middeck.study.chapters.zero_g_control.chapter import ZERO_G_CONTROL
from middeck.study.chapters.zero_g_control.computation import ZeroGControl
from middeck.study.chapters.zero_g_control.figure_7 import figure_7a
from middeck.study.picture import picture
from middeck.study.shared import compare_environments

ROOT = Path(__file__).parents[1]
IMAGES = ROOT / "docs" / "images"
GIMBAL = {"inputs": ["pri_rel_z"], "outputs": ["pri_in_z"]}
GROUPS = {"w": ["pri_rel_z"], "u": ["pri_rel_z"], "z": ["pri_in_z"], "y": ["pri_in_z"]}


@cache
def study() -> md.Study:
    return md.load_study(ROOT / "studies" / "mace-1993.toml")


@cache
def comparison() -> ModeComparison:
    return compare_environments(study())


@cache
def control() -> ZeroGControl:
    return ZERO_G_CONTROL.compute(study(), ZERO_G_CONTROL.rng(study().seed), comparison())


@cache
def case(article: str) -> tuple[md.Structure, md.Environment]:
    return md.load_setup(ROOT / "articles" / f"{article}.toml", ROOT / "environments" / "lab.toml")


@cache
def hung() -> md.Modes:
    """The development model in the laboratory."""
    return md.solve_modes(md.solve_equilibrium(*case("mace-dm")))


@cache
def measured(noise: float) -> tuple[md.FrequencyResponse, md.FitResult]:
    """Response and fit of a simulated record of two modes with a delay of 8 ms; ``noise`` in rad."""
    omega, zeta = 2.0 * np.pi * np.array([3.2, 9.35]), 0.01
    poles = -zeta * omega + 1j * omega * np.sqrt(1.0 - zeta**2)
    shapes = np.array([[1.0, 0.8], [0.6, -1.0]]) / (2j * poles.imag)
    torque, angles = (md.Port("torque", "N m"),), (md.Port("base", "rad"), md.Port("tip", "rad"))
    none = np.zeros((2, 1))
    truth = md.MeasurementModel(
        poles=poles,
        shapes=shapes,
        participation=np.array([[1.0], [0.8]]),
        direct=none,
        lower=none,
        delay_s=np.full(2, 0.008),
        inputs=torque,
        outputs=angles,
    )
    rng = np.random.default_rng(2)
    signal = md.design_multisine((0.5, 16.0), 16.0, 128.0, md.Limits(rms=1.0), rng).u
    f = np.fft.rfftfreq(signal.shape[1], 1.0 / 128.0)
    H = np.zeros((len(f), 2, 1), complex)
    H[1:] = md.model_response(truth, f[1:])
    y = np.fft.irfft(np.einsum("koi,eki->eko", H, np.fft.rfft(signal, axis=1)), signal.shape[1], axis=1)
    u, y = (np.repeat(x[:, None], 3, axis=1) for x in (signal, y))
    y = y + noise * rng.standard_normal(y.shape)
    record = md.Record(sample_hz=128.0, u=u, y=y, inputs=torque, outputs=angles, periodic=True)
    response = md.estimate_response(record, band_hz=(0.5, 16.0))
    return response, md.fit_response(response, states=4)


def mace_1993() -> Figure:
    """Performance of 0-g controllers in 0-g and 1-g, suspension modes, ratios of flexible modes."""
    return picture(comparison(), control())


def shape() -> Figure:
    """The article as it floats in 0-g and as it hangs in 1-g, displacements exaggerated."""
    return figure_3(comparison())


def shapes() -> Figure:
    """Shapes of three modes of the development model in the laboratory, coloured by their motion."""
    coarse = md.load_structure(ROOT / "articles" / "mace-dm.toml", ["mesh.elements_per_strut=2"])
    rest = md.solve_equilibrium(coarse, case("mace-dm")[1])
    drawing = md.structure.build_mode_drawing(md.solve_modes(rest), [8, 10, 12])
    return shapes_figure([drawing], [[Shown(0, i)] for i in range(3)])


def modes() -> Figure:
    """Frequencies of the suspension modes, and of the flexible modes in 1-g over 0-g."""
    return figure_4(comparison())


def authority() -> Figure:
    """Performance of controllers designed in 0-g against authority, on the 0-g and the 1-g model."""
    return figure_7a(control())


def budget() -> Figure:
    """Shift of each mode from 0-g to 1-g as shares of suspension, internal forces and deformation."""
    c = comparison()
    return budget_figure(md.build_budget(c.orbit, c.lab, 20))


def path() -> Figure:
    """Frequencies of the modes while gravity falls from the Earth's to zero, with their veerings."""
    article, lab = case("mace-simple")
    return gravity_path_figure(md.follow_gravity(article, lab, count=20))


@styled
def response() -> Figure:
    """Response of the payload angle to the gimbal torque, in 0-g and hung in 1-g."""
    f = np.geomspace(0.1, 60.0, 4000)
    figure = new_figure(2.8)
    axes = figure.subplots()
    orbit = md.solve_modes(md.solve_equilibrium(case("mace-dm")[0], md.Environment.orbit()))
    for name, found in {"orbit": orbit, "lab": hung()}.items():
        H = md.evaluate_plant(md.build_plant(found, **GIMBAL), f).H[:, 0, 0]
        draw_magnitude(axes, f, H, color=COLOUR[name], linestyle=DASHES[name], label=LABEL[name])
    frequency_axis(axes, 0.1, 60.0)
    axes.set_ylabel("payload angle [dB re rad/(N m)]")
    axes.legend(loc="lower left")
    return figure


def fit() -> Figure:
    """Measured frequency responses of two sensors, the fitted model, and its 95 % bounds."""
    return fit_figure(*measured(6e-3))


def orders() -> Figure:
    """Stabilisation diagram: poles that stay as the order rises, over the measured response."""
    found, _ = measured(1e-3)
    return stabilisation(md.stabilisation(found, orders=range(2, 21, 2)), found, states=4)


def margins() -> Figure:
    """Nyquist plot of the gimbal's loop with its gain and phase margins and the disk margin."""
    plant = md.delay_plant(md.build_plant(hung(), count=12, **GIMBAL, **GROUPS), 0.010)
    weights = md.LQGWeights(
        output=[1.0], input=[1.0], disturbed=("pri_rel_z",), process=[[1e-4]], sensor=[4e-10]
    )
    law = md.design_lqg(md.approximate_delays(plant, 3), weights, 1e2)
    return draw_nyquist(md.control.trace_return_ratio(plant, law), md.measure_margins(plant, law))


def gimbals() -> Figure:
    """Frequencies of the modes and torque of the motors against the angle of a gimbal."""
    angles = np.radians(np.arange(0.0, 106.0, 7.5))
    return draw_gimbal_family(md.sweep_gimbals(*case("mace-dm"), {"pri_z": angles}, **GIMBAL, count=16))


def friction() -> Figure:
    """Stiffness of a bearing with friction, and frequency and damping of the modes, against amplitude."""
    bearing = md.Friction(slip_torque=0.02, stiffness=20.0)
    return draw_amplitude(md.structure.sweep_amplitude(
        hung(), joint="pri_z", elements=[bearing], amplitudes=np.geomspace(1e-4, 0.3, 60)
    ))  # fmt: skip


def promise() -> Figure:
    """Promised 95 % intervals of frequencies and decibels in orbit, and the simulated outcome."""
    folder = ROOT / "data" / "virtual-survey"
    promised = read_promise(folder / "promise.json")
    compared = comparison_document(promised, load_outcomes(folder / "outcome.toml"), date=promised["date"])
    came = {(v["kind"], v["name"]): v for v in compared["verdicts"]}
    return promise_figure(promised["environments"][0], promised["shares"], came, "Promise and outcome")


@styled
def benchmarks() -> Figure:
    """Ratio of middeck to the best peer in twelve comparisons of error and time; below one is better."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    from headlines import headlines

    shown = headlines()
    figure = new_figure(4.2)
    axes = figure.subplots()
    for row, one in enumerate(shown):
        colour = COLOUR["orbit"] if one.ratio < 1.0 else COLOUR["lab"]
        axes.plot([1.0, one.ratio], [row, row], color=colour, linewidth=2.0)
        axes.plot([one.ratio], [row], "o", color=colour)
        side, ha = (6, "left") if one.ratio > 1.0 else (-6, "right")
        axes.annotate(f"{one.ratio:.2g}", (one.ratio, row), (side, 0), textcoords="offset points",
                      va="center", ha=ha, fontsize=7.5)  # fmt: skip
    axes.axvline(1.0, color=COLOUR["ink"], linewidth=0.8)
    axes.set_xscale("log")
    axes.set_xlim(0.005, 40.0)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_yticks(range(len(shown)), [fill(one.what, 46) for one in shown], fontsize=7.0)
    axes.set_ylim(len(shown) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("middeck / best peer: left of 1 middeck is better")
    return figure


BOXES = {
    "Structure, Environment": (0.0, 4.0),
    "Equilibrium": (0.0, 3.0),
    "Modes": (0.0, 2.0),
    "Record": (2.0, 4.0),
    "FrequencyResponse": (2.0, 3.0),
    "MeasurementModel": (2.0, 2.0),
    "Plant": (1.0, 1.0),
    "Compensator": (1.0, 0.0),
    "ClosedLoop": (0.0, -1.0),
    "Simulated rig": (2.0, -1.0),
}
ARROWS = (
    ("Structure, Environment", "Equilibrium", "solve_equilibrium"),
    ("Equilibrium", "Modes", "solve_modes"),
    ("Modes", "Plant", "build_plant"),
    ("Record", "FrequencyResponse", "estimate_response"),
    ("FrequencyResponse", "MeasurementModel", "fit_response"),
    ("MeasurementModel", "Plant", "measured_plant"),
    ("Plant", "Compensator", "design_lqg"),
    ("Compensator", "ClosedLoop", "close_loop"),
    ("Compensator", "Simulated rig", "sample and run"),
)
LINE = {"arrowstyle": "-|>", "color": COLOUR["ink"], "shrinkA": 1.0, "shrinkB": 2.0}
WORDS = {"fontsize": 7.5, "va": "center", "color": COLOUR["ink"],
         "bbox": {"facecolor": "white", "edgecolor": "none", "pad": 1.0}}  # fmt: skip


@styled
def chain() -> Figure:
    """From a structure or a record to a plant, a compensator, a closed loop and a simulated rig."""
    figure = new_figure(4.4)
    axes = figure.subplots()
    axes.set_axis_off()
    axes.set_xlim(-0.5, 3.0)
    axes.set_ylim(-1.3, 4.3)
    box = {}
    for name, at in BOXES.items():
        waist = name == "Plant"
        box[name] = axes.annotate(
            name, at, ha="center", va="center", color="white" if waist else "black", zorder=2,
            bbox={"boxstyle": "round,pad=0.45", "edgecolor": COLOUR["orbit"],
                  "facecolor": COLOUR["orbit"] if waist else COLOUR["shade"]},
        ).get_bbox_patch()  # fmt: skip
    for start, end, verb in ARROWS:
        (x0, y0), (x1, y1) = BOXES[start], BOXES[end]
        line = {**LINE, "patchA": box[start], "patchB": box[end]}
        axes.annotate("", (x1, y1), (x0, y0), arrowprops=line, zorder=3)
        upright = x0 == x1
        axes.text(0.5 * (x0 + x1) + (0.05 if upright else 0.0), 0.5 * (y0 + y1), verb,
                  ha="left" if upright else "center", zorder=4, **WORDS)  # fmt: skip
    # From the rig back to a record, outside of all that lies between.
    side = 2.7
    axes.plot([BOXES["Simulated rig"][0], side, side], [-1.0, -1.0, 4.0], color=COLOUR["ink"],
              linewidth=1.0, zorder=1)  # fmt: skip
    line = {**LINE, "shrinkA": 0.0, "patchB": box["Record"]}
    axes.annotate("", BOXES["Record"], (side, 4.0), arrowprops=line, zorder=3)
    axes.text(side, 1.0, "measure", ha="center", zorder=4, **WORDS)
    return figure


PICTURES: dict[str, Callable[[], Figure]] = {
    "mace-1993": mace_1993,
    "chain": chain,
    "shape": shape,
    "shapes": shapes,
    "modes": modes,
    "response": response,
    "budget": budget,
    "gravity-path": path,
    "gimbals": gimbals,
    "friction": friction,
    "promise": promise,
    "authority": authority,
    "margins": margins,
    "fit": fit,
    "orders": orders,
    "benchmarks": benchmarks,
}


def text_of(name: str) -> str:
    """The SVG of one picture."""
    draw = PICTURES[name]
    return svg_text(draw(), key=name, title=name.replace("-", " "), description=draw.__doc__ or "")


def main(names: list[str]) -> None:
    for name in names or PICTURES:
        write_text(IMAGES / f"{name}.svg", text_of(name))


if __name__ == "__main__":
    main(sys.argv[1:])
