"""Figures of the verbs: each ending is what it says, and the page of shapes works in a real browser."""

from __future__ import annotations

import dataclasses
import html
import json
import re
import subprocess
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

import middeck as md
from cli_runner import ROOT, middeck
from middeck.files.exchange.vtu import vtu_text
from middeck.plot.fit import fit_figure
from middeck.plot.gravity_path import gravity_path_figure
from middeck.plot.response import response_lines
from middeck.plot.shapes import Shown, factor_of, first_panels, label_of, shapes_figure, upright
from middeck.report.shape_page import MOTION_STEPS, PLACE_STEPS, ShapePage, render_shapes
from middeck.structure.gravity.path import GravityPath
from middeck.structure.gravity.path_events import EventKind, GravityEvent
from middeck.structure.model.article import AttachPoint
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import GroundBushing
from middeck.structure.modes.results.article_drawing import build_mode_drawing
from structure_builders import TUBE, body, on_cables, straight_beam, tube_bus
from trusses import truss

Capture = pytest.CaptureFixture[str]
DM = ("articles/mace-dm.toml", "--set", "mesh.elements_per_strut=1")
SIMPLE = ("articles/mace-simple.toml", "--set", "mesh.elements_per_strut=1")
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--hide-scrollbars",
         "--disable-background-networking", "--disable-component-update", "--disable-sync")  # fmt: skip
BEGINS = {".svg": b"<svg", ".png": b"\x89PNG", ".pdf": b"%PDF"}
VERBS = {
    "modes": (("modes", *DM, "--count", 9), ".png"),
    "compare": (("compare", *DM, "--count", 12), ".svg"),
    "correlate": (
        ("correlate", *SIMPLE, "data/virtual-survey/mace-simple-lab.json", "--runs", 2), ".svg"),
    "response": (("response", *DM, "--input", "pri_rel_z", "--output", "pri_in_z", "--at", "1,9"), ".pdf"),
    "design": (("design", DM[0], "--count", 12, "--control", "pri_rel_z", "--measure", "pri_in_z"), ".svg"),
    "level": (
        ("level", *SIMPLE, "--set", "suspension.offsets.0.2=0", "--free", "n1.z", "--about", "x"), ".png"),
}  # fmt: skip


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_draws_its_result(verb: str, tmp_path: Path, capfd: Capture, monkeypatch: Any) -> None:
    monkeypatch.chdir(ROOT)
    asked, ending = VERBS[verb]
    drawn = tmp_path / f"drawn{ending}"
    ended = middeck(capfd, *asked, "--figure", drawn)
    assert ended.code == 0, ended.err
    written = drawn.read_bytes()
    assert written.startswith(BEGINS[ending])
    assert len(written) > 5000
    assert not re.search(rb"CreationDate|matplotlib", written[:2000])


def test_qualify_draws_rows_that_are_not_stable_too(tmp_path: Path, capfd: Capture, monkeypatch: Any) -> None:
    monkeypatch.chdir(ROOT)
    law, drawn = tmp_path / "law.json", tmp_path / "rows.svg"
    middeck(capfd, *VERBS["design"][0], "-o", law)
    plants = ("--count", 12, "--environment", "lab", "--environment", "orbit")
    ended = middeck(capfd, "qualify", law, DM[0], *plants, "--figure", drawn)
    assert ended.code == 0, ended.err
    text = drawn.read_text()
    assert text.count(">not stable<") == 5  # one in each panel: in orbit nothing holds the roll
    assert "mace-dm in lab, continuous" in text


def test_a_response_is_drawn_with_every_peak() -> None:
    """Between dense lines no peak of one mode falls short by more than a per cent."""
    rng = np.random.default_rng(8)
    for _ in range(20):
        hz, zeta = rng.uniform(1.0, 90.0, 1), 10.0 ** rng.uniform(-6.0, -1.5, 1)
        lines = response_lines(np.array([0.5, 100.0]), hz, zeta)
        magnitude = 1.0 / np.abs(1.0 - (lines / hz) ** 2 + 2j * zeta * lines / hz)
        assert magnitude.max() > 0.99 / (2.0 * zeta[0])
    alone = response_lines(np.array([3.0]), np.zeros(0), np.zeros(0))
    assert alone[[0, -1]] == pytest.approx([0.3, 30.0])


# ---- the page of shapes -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def page() -> ShapePage:
    """A beam in orbit beside the same one clamped; its bending has pairs of equal frequency."""
    beam = straight_beam(TUBE, 2.0, 3)
    free, held = (
        build_mode_drawing(md.solve_modes(md.solve_equilibrium(beam, where), 12), range(first, 12))
        for where, first in ((md.Environment.orbit(), 5), (md.Environment.clamped("a"), 0))
    )
    return ShapePage(
        title="A beam & its <shapes>",
        drawings=(free, held),
        sides=("0-g", "clamped"),
        rows=((Shown(0, 0), Shown(1, 2, -1.0)), (Shown(0, 1), Shown(1, 1)), (None, Shown(1, 0))),
        headers=("mode", "name"),
        table=(("0", "a </script> b"),),
        warnings=("something",),
    )


@pytest.fixture(scope="module")
def text(page: ShapePage) -> str:
    return render_shapes(page)


def data_of(text: str) -> dict[str, Any]:
    return json.loads(
        re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)[1]
    )


def test_the_page_needs_nothing_else_and_is_the_same_each_time(page: ShapePage, text: str) -> None:
    assert render_shapes(page) == text
    addresses = set(re.findall(r'https?://[^"\s<)]+', text))
    assert addresses <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    assert not re.search(r'<(link|img|iframe)\b|@import|url\((?!#)|\b(src|href)="(?!#)', text)
    assert "A beam &amp; its &lt;shapes&gt;" in text
    assert "a &lt;/script&gt; b" in text


def test_the_page_moves_the_arrays_that_are_written_for_paraview(page: ShapePage, text: str) -> None:
    """To half a step of the rounding: the same points and motions as `Drawing` and its VTU have."""
    data = data_of(text)
    for side, drawing in zip(data["sides"], page.drawings, strict=True):
        points = np.array(side["points"]).reshape(-1, 3) / PLACE_STEPS * data["size"]
        apart = points - points[0] - (drawing.rest - drawing.rest[0])
        assert np.abs(apart).max() <= 1.1 * data["size"] / PLACE_STEPS
        assert f'NumberOfPoints="{len(points)}"' in vtu_text(drawing)
    shown = page.rows[0][1]
    assert shown is not None
    drawing, cell = page.drawings[1], data["rows"][0][1]
    motion = np.array(cell["motion"]).reshape(-1, 3) / MOTION_STEPS
    exact = -drawing.motion[2] * factor_of(drawing, 2)
    assert np.abs(motion * np.linalg.norm(exact, axis=1).max() - exact).max() <= 2e-3 * np.abs(exact).max()
    assert cell["text"] == label_of(drawing, 2).replace("\n", ", ")
    assert data["rows"][0][0]["text"].endswith("x-y (one of 2 of equal frequency)")
    assert data["rows"][2][0] is None


PROBE = """<script>addEventListener("load", () => {
const canvas = [...document.querySelectorAll("canvas")], mode = document.getElementById("mode");
const picture = () => canvas.map(c => c.toDataURL()), label = c => c.getAttribute("aria-label");
const press = key =>
  canvas[0].dispatchEvent(new KeyboardEvent("keydown", {key, bubbles: true, cancelable: true}));
const found = {sides: canvas.length, options: mode.options.length, labels: canvas.map(label)};
const first = picture(); press("ArrowLeft"); found.turned = picture().every((p, i) => p !== first[i]);
press("ArrowRight"); found.back = picture().every((p, i) => p === first[i]);
press("n"); found.next = mode.value; found.other = picture().every((p, i) => p !== first[i]);
const before = picture()[0], scale = document.getElementById("scale");
scale.value = 2.5; scale.dispatchEvent(new Event("input")); found.scaled = picture()[0] !== before;
const pressed = () => document.getElementById("play").getAttribute("aria-pressed");
press(" "); found.playing = pressed(); press(" "); found.stopped = pressed();
press("n"); found.alone = label(canvas[0]);
const shown = s => getComputedStyle(document.querySelector(s)).display;
found.display = [shown(".viewer"), shown(".stills")];
found.legend = document.getElementById("legend").textContent;
document.title = JSON.stringify(found); });</script>"""
SEEN = """<script>addEventListener("load", () => {
const shown = s => getComputedStyle(document.querySelector(s)).display;
document.title = JSON.stringify([shown(".viewer"), shown(".stills")]); });</script>"""


def probed(chromium: str, text: str, probe: str, folder: Path) -> Any:
    file = folder / "page.html"
    file.write_text(text.replace("</body>", f"{probe}</body>"), encoding="utf-8")
    flags = (*FLAGS, f"--user-data-dir={folder}", "--window-size=1200,900", "--virtual-time-budget=1000")
    run = subprocess.run([chromium, *flags, "--dump-dom", f"{file.as_uri()}#still"], capture_output=True,
                         text=True, timeout=120, check=True)  # fmt: skip
    return json.loads(html.unescape(re.search(r"<title>(.*?)</title>", run.stdout, re.DOTALL)[1]))


def test_the_page_turns_moves_and_tells_in_a_browser(chromium: str, text: str, tmp_path: Path) -> None:
    found = probed(chromium, text, PROBE, tmp_path)
    assert (found["sides"], found["options"]) == (2, 3)
    assert found["labels"][0].startswith("0-g, mode 5: ")
    assert all(found[key] for key in ("turned", "back", "other", "scaled"))
    assert (found["next"], found["playing"], found["stopped"]) == ("1", "true", "false")
    assert found["alone"] == "0-g, no partner among the modes shown"
    assert found["display"] == ["block", "none"]
    assert "drawn as 0.60 m (30 % of the article" in found["legend"]


def test_the_page_says_what_its_marks_are() -> None:
    """Those that are drawn, in the words of the pictures in files."""
    held = md.Environment(
        title="held", gravity=np.zeros(3), clamps=(Clamp(node="a"),),
        bushings=(GroundBushing(name="leg", attach="tip", stiffness=np.eye(6)),),
    )  # fmt: skip
    beam = straight_beam(TUBE, 2.0, 4)
    end = AttachPoint("tip", beam.nodes[-1].name, np.zeros(3))
    modes = md.solve_modes(md.solve_equilibrium(dataclasses.replace(beam, attach_points=(end,)), held), 2)
    drawing = build_mode_drawing(modes)
    page = ShapePage(title="t", drawings=(drawing,), sides=("",), rows=((Shown(0, 0),), (Shown(0, 1),)))
    found = re.findall(r'aria-hidden="true">(.)</span> ([^<]+)</span>', render_shapes(page))
    assert found == [("\u25a0", "clamp"), ("\u25c7", "bushing to the ground")]


def test_without_scripts_and_in_print_there_are_stills(chromium: str, text: str, tmp_path: Path) -> None:
    bare = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert probed(chromium, bare, SEEN, tmp_path) == ["none", "block"]
    file, target = tmp_path / "whole.html", tmp_path / "whole.pdf"
    file.write_text(text, encoding="utf-8")
    flags = (*FLAGS, f"--user-data-dir={tmp_path}", f"--print-to-pdf={target}")
    subprocess.run([chromium, *flags, file.as_uri()], capture_output=True, timeout=120, check=True)
    assert len(re.findall(rb" l$", printed(target.read_bytes()), re.MULTILINE)) > 200


def printed(pdf: bytes) -> bytes:
    """What its streams say: the canvas would be an image, stills are lines (operator l)."""
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.DOTALL)
    packed = [stream for stream in streams if stream[:1] == b"\x78"]
    return b"\n".join(zlib.decompressobj().decompress(stream) for stream in packed)


def test_forty_modes_of_three_hundred_members_stay_small() -> None:
    """Below 4 MB; each member with the S that its cubic can make. A quarter of the modes stands for all."""
    article = truss(24, 0.5, 0.5, 0.5, np.random.default_rng(1))
    assert len(article.members) >= 290
    modes = md.solve_modes(md.solve_equilibrium(article, md.Environment.orbit()), 16)
    drawing = build_mode_drawing(modes, range(6, 16))
    page = ShapePage(
        title="truss", drawings=(drawing,), sides=("",), rows=tuple((Shown(0, i),) for i in range(10))
    )
    assert len(render_shapes(page).encode()) < 1_000_000


# ---- layout and view --------------------------------------------------------------------------------------


@pytest.mark.parametrize("shapes", [1, 3, 7])
def test_no_words_of_a_picture_meet_or_leave_it(page: ShapePage, shapes: int) -> None:
    """Long names, three kinds of marks and long sides: titles, scale and legend each have their own place."""
    held = page.drawings[1]
    marks = tuple(held.marks[0]._replace(what=what) for what in ("mass", "clamp", "ground"))
    names = ("third bending x-z and bending y-z",) * len(held.name)
    long = dataclasses.replace(held, marks=marks, name=names)
    rows = [[Shown(0, i)] for i in range(shapes)]
    figure = shapes_figure([long], rows, ["a long side"])
    FigureCanvasAgg(figure).draw()
    renderer = FigureCanvasAgg(figure).get_renderer()
    drawn = [a._left_title.get_window_extent(renderer) for a in figure.axes if a.get_title(loc="left")]
    bar = next(a for a in figure.axes if a.get_xlabel()).get_tightbbox(renderer)
    others = (figure.legends[0], figure.texts[0])
    boxes = [*drawn, bar, *(other.get_window_extent(renderer) for other in others)]
    assert len(drawn) == shapes
    assert all(figure.bbox.x0 <= b.x0 and b.x1 <= figure.bbox.x1 for b in boxes)
    assert all(figure.bbox.y0 <= b.y0 and b.y1 <= figure.bbox.y1 for b in boxes)
    assert not [1 for i, a in enumerate(boxes) for b in boxes[i + 1 :] if a.overlaps(b)]


def test_a_picture_of_many_shapes_says_how_many_it_leaves_out(page: ShapePage) -> None:
    rows = [(Shown(0, 0), Shown(1, 1))] * 15 + [(None, Shown(1, 0))] * 15
    kept, left = first_panels(rows)
    assert (len(kept), left) == (25, 5)
    assert first_panels(rows[:20]) == (rows[:20], 0)
    figure = shapes_figure(page.drawings, kept, page.sides, left)
    assert "5 more shapes are not drawn here" in figure.texts[0].get_text()
    titled = [bool(a.get_title(loc="left")) for a in figure.axes if not a.get_xlabel()]
    assert titled == [True] * 30 + [False] * 2 + [True] * 10 + [False] * 2
    assert figure.get_figheight() < 25.0


@pytest.mark.parametrize(("held", "what"), [
    ([("xyz", "xyz")], "clamp"), ([("xyz", ""), ("", "xyz")], "clamp"), ([("xyz", "xy")], "support"),
    ([("xyz", "")], "support"), ([("y", "xyz"), ("xz", "")], "clamp"),
])  # fmt: skip
def test_what_holds_some_directions_is_no_clamp(held: list[tuple[str, str]], what: str) -> None:
    clamps = (
        md.Clamp(node="b"),
        *(md.Clamp(node="a", along=along, about=about) for along, about in held),
    )
    around = dataclasses.replace(md.Environment.clamped("a", gravity=0.0), clamps=clamps)
    modes = md.solve_modes(md.solve_equilibrium(straight_beam(TUBE, 2.0, 4), around), 4)
    marks = {mark.name: mark.what for mark in build_mode_drawing(modes, range(2)).marks}
    assert marks == {"a": what, "b": "clamp"}


def test_the_scale_of_an_upright_article_has_its_length_and_words() -> None:
    """A narrow panel cuts off neither the bar of length nor the words over it, nor those of gravity."""
    bench = md.Environment.clamped("a")
    mast = dataclasses.replace(bench, gravity=np.array([-9.81, 0.0, 0.0]))
    modes = md.solve_modes(md.solve_equilibrium(straight_beam(TUBE, 2.0, 8), mast), 4)
    drawing = build_mode_drawing(modes, range(4))
    figure = shapes_figure([drawing], [[Shown(0, i)] for i in range(4)])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    axes = figure.axes[0]
    words = {text.get_text(): text for text in axes.texts}
    bar = next(line for line in axes.lines if line.get_linewidth() == 1.6)
    length = float(np.ptp(bar.get_xdata()))
    ends = axes.transData.transform([(0.0, 0.0), (length, 0.0)])
    drawn = bar.get_tightbbox(canvas.get_renderer())
    assert drawn.width == pytest.approx(ends[1, 0] - ends[0, 0], abs=3.0)
    for warning in (f"{length:g} m", "g 9.81 m/s²"):
        assert words[warning].get_tightbbox(canvas.get_renderer()).width > 5.0


@pytest.mark.parametrize(("constants", "up"), [
    ("", None), ("gravity_m_s2 = 0.0\ngravity_direction = [0.0, 0.0, -2.0]", [0.0, 0.0, 1.0]),
    ("gravity_m_s2 = 1.62\ngravity_direction = [-3.0, 0.0, 0.0]", [1.0, 0.0, 0.0]),
])  # fmt: skip
def test_up_is_against_gravity(constants: str, up: list[float] | None, tmp_path: Path) -> None:
    """Against its direction too, where there is none of it."""
    file = tmp_path / "where.toml"
    head = f'schema = 1\nname = "w"\n{"[constants]" if constants else ""}'
    file.write_text(f'{head}\n{constants}\n[[clamp]]\nnode = "a"\n')
    beam = straight_beam(TUBE, 2.0, 1)
    drawing = build_mode_drawing(md.solve_modes(md.solve_equilibrium(beam, md.load_environment(file)), 1))
    assert (None if drawing.up is None else drawing.up.tolist()) == up
    assert upright([drawing.up])[1].tolist() == (up or [0.0, 1.0, 0.0])


def test_up_is_as_the_article_tells_where_no_environment_does() -> None:
    beam = dataclasses.replace(straight_beam(TUBE, 2.0, 1), up=np.array([0.0, 0.0, 1.0]))
    for gravity, up in ((0.0, [0.0, 0.0, 1.0]), (9.81, [1.0, 0.0, 0.0])):
        held = md.Environment(
            title="held", gravity=gravity * np.array([-1.0, 0.0, 0.0]), clamps=(Clamp(node="a"),)
        )
        modes = md.solve_modes(md.solve_equilibrium(beam, held), 1)
        assert build_mode_drawing(modes).up.tolist() == up


def test_up_without_anything_to_turn(capfd, tmp_path):
    """It says what it is for, and where down is told; beside a picture, in either order, it turns that."""
    ask = ("modes", ROOT / "articles/mace-simple.toml", "--environment", "orbit", "--count", 8, "--up", "z")
    bare = middeck(capfd, *ask)
    assert bare.code == 2
    assert "--up z turns what --figure draws" in bare.err
    assert "gravity_direction in the [constants]" in bare.err
    own = middeck(capfd, *ask, "--figure", tmp_path / "a.vtu")
    assert (own.code, (tmp_path / "a.vtu").exists()) == (2, False)
    assert "the axes of the world" in own.err
    assert middeck(capfd, *ask, "--figure", tmp_path / "a.svg").code == 0
    compared = middeck(capfd, "compare", *ask[1:2], "--up", "x")
    assert (compared.code, "--figure" in compared.err) == (2, True)


@pytest.fixture(scope="module")
def path() -> GravityPath:
    bus = tube_bus([2.0, 4.0, 2.0], (0.0, -0.03, 0.0), (0.01,) * 3, body(1.0, (0.0, -0.1, 0.0), (0.01,) * 3))
    return md.follow_gravity(bus, on_cables(3.0, 0.4), count=8)


@pytest.mark.parametrize("share", [0.999, 0.001])  # of the way from the full weight to none
def test_the_end_of_a_path_is_written_towards_the_middle_of_the_axes(path: GravityPath, share: float) -> None:
    s = float(share * path.s[-1])
    slack = GravityEvent(
        kind=EventKind.SLACK, s=s, gravity=np.zeros(3), branch=(), name=("a",), frequency_hz=0.0, gap_hz=0.0
    )
    figure = gravity_path_figure(dataclasses.replace(path, events=(slack,)))
    figure.draw_without_rendering()
    drawn = FigureCanvasAgg(figure).get_renderer()
    for axes in figure.axes:
        (text,) = (t for t in axes.texts if "slack" in t.get_text())
        box, (low, high) = text.get_window_extent(drawn), axes.get_window_extent(drawn).intervalx
        at = axes.transData.transform((path.size[0] * (1.0 - share), 0.0))[0]
        assert (box.x0 > at) is (at < 0.5 * (low + high))
        assert low < box.x0 < box.x1 < high


def test_inputs_of_unlike_units_stand_over_their_own_columns() -> None:
    rng = np.random.default_rng(0)
    f = np.fft.rfftfreq(400, 0.01)
    H = 900.0 / (900.0 - (2.0 * np.pi * f) ** 2 + 60.0j * f) * np.array([[1.0], [0.5]])
    lines = (f > 0.0) & (f <= 20.0)
    U = np.where(lines, np.exp(2j * np.pi * rng.random((2, 2, len(f)))), 0.0)
    u, y = np.fft.irfft(U).transpose(0, 2, 1), np.fft.irfft(np.sum(U * H, axis=1))[..., None]
    u, y = (np.repeat(x[:, None], 3, axis=1) for x in (u, y))
    y += 1e-3 * np.std(y) * rng.standard_normal(y.shape)
    ports = (md.Port("motor", "N m"), md.Port("push", "N"))
    record = md.Record(
        sample_hz=100.0, u=u, y=y, inputs=ports, outputs=(md.Port("turn", "rad"),), periodic=True
    )
    measured = md.estimate_response(record, band_hz=(1.0, 20.0))
    figure = fit_figure(measured, md.fit_response(measured, states=2))
    titles = [axes.get_title(loc) for axes in figure.axes for loc in ("left", "center")]
    assert {"from motor [N m]", "from push [N]"} <= set(titles)
    assert figure.axes[0].get_ylabel() == "turn\n[dB re rad per unit of the input]"
