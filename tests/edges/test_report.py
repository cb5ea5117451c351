"""Figures and report: real results of reduced stages, read back from the files that were written."""

from __future__ import annotations

import copy
import dataclasses
import html
import itertools
import json
import os
import pickle
import re
import shutil
import subprocess
import sys
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.colors import to_hex, to_rgb

from middeck.files.studies.documents import load_study
from middeck.files.studies.form import RigForm
from middeck.plot.curves import keep_extremes, wrapped_phase_deg
from middeck.plot.port_words import port_words
from middeck.plot.svg import svg_text
from middeck.report.page import came_out, claim_rows, does_not_hold, warned
from middeck.report.results_folder import StudyWriter
from middeck.study.chapters.gravity_modes.figure_3 import figure_3
from middeck.study.chapters.two_sensor_control.text import half_plane
from middeck.study.chapters.zero_g_control.figure_7 import figure_7a, figure_7b
from middeck.study.measured_loop.text import held
from middeck.study.mission import CHAPTERS, run_chapters
from middeck.study.picture import headline
from middeck.study.words import fixed
from repeats import LONG, repeats

ROOT = Path(__file__).parents[2]
REDUCED = ("mirror.states=6",)  # every chapter is run for real, none for long
OURS = ("mirror", "promise", "promise-routes")  # drawings that the paper does not have
WORDS = ("steering mirror", "Promise and outcome", "Three ways")
FIGURES = ("3", "4", "5", "6a", "6b", "7a", "7b", "9a", "9b", "10a", "10b", "11", "12a", "12b")
PRINT_WIDTH_MM, PRINT_HEIGHT_MM = 178.0, 265.0  # A4 less the margins of the print style
BROWSER_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
)
SVG_LIMIT, PAGE_LIMIT = 400_000, 3_000_000  # bytes: what mail and a phone take without thinking


@pytest.fixture(scope="session")
def study():
    return load_study(ROOT / "studies/mace-1993.toml", REDUCED)


@pytest.fixture(scope="session")
def outcomes(study, paper_outcomes):
    """Chapters that the reduction does not touch are those of the whole study: each has its own stream."""
    return {**paper_outcomes, "mirror": dict(run_chapters(study))["mirror"]()}


@pytest.fixture(scope="session")
def written(tmp_path_factory, study, outcomes):
    out = tmp_path_factory.mktemp("report")
    write(out, study, outcomes)
    return out


def write(out: Path, study: Any, outcomes: dict[str, Any]) -> None:
    writer = StudyWriter(out, study)
    for name, outcome in outcomes.items():
        writer.add(name, outcome)
    writer.finish()


@pytest.fixture(scope="session")
def page(written):
    return Page((written / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def numbers(written):
    return json.loads((written / "numbers.json").read_text(encoding="utf-8"))["figures"]


class Page(HTMLParser):
    """What a reader of the page meets: tags with their attributes, tables by caption, texts of elements."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.tables: dict[str, list[list[str]]] = {}
        self.texts: dict[str, str] = {}
        self.section = ""
        self._rows: list[list[str]] = []
        self._caption, self._into, self._id = "", "", ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = {k: v or "" for k, v in attrs}
        self.tags.append((tag, named))
        self._id = named.get("id", self._id if tag in ("title", "desc") else "")
        match tag:
            case "table":
                self._rows, self._caption = [], "Claims"
            case "caption":
                self._caption = ""
            case "tr":
                self._rows.append([])
            case "th" | "td":
                self._rows[-1].append("")
            case _:
                pass
        self._into = tag if tag in ("caption", "th", "td") else self._into

    def handle_endtag(self, tag: str) -> None:
        if tag == "table":
            self.tables[self._caption] = self._rows
        if tag in ("caption", "th", "td"):
            self._into = ""
        self._id = ""

    def handle_data(self, data: str) -> None:
        if self._into == "caption":
            self._caption += data
        elif self._into and self._rows:
            self._rows[-1][-1] += data
        if self._id:
            self.texts[self._id] = self.texts.get(self._id, "") + data

    def all(self, *names: str) -> list[dict[str, str]]:
        return [attributes for tag, attributes in self.tags if tag in names]


def number(text: str) -> float:
    return float(text.replace("−", "-").removesuffix(" %"))


def test_every_figure_is_written_and_stands_on_the_page(written, page):
    keys = [*(f"figure-{name}" for name in FIGURES), *OURS]
    files = {p.stem for p in (written / "figures").iterdir()}
    assert files == {*keys, "mace-1993"}
    assert [a["id"] for a in page.all("section")] == ["claims", *keys, "assumptions", "provenance"]
    assert not [p for p in written.rglob("*") if p.name.startswith(".")]


def test_files_stay_small(written):
    assert all(p.stat().st_size < SVG_LIMIT for p in (written / "figures").iterdir())
    assert (written / "report.html").stat().st_size < PAGE_LIMIT


def test_another_process_writes_the_same_bytes(tmp_path, study, outcomes):
    """Neither the order of sets, nor what was drawn before, nor a clock reaches the files."""
    part = {name: outcomes[name] for name in outcomes if LONG or name == "figure 6"}
    write(tmp_path / "here", study, part)
    with (tmp_path / "results.pickle").open("wb") as file:
        pickle.dump((study, part), file)
    program = (
        "import pickle, sys; from pathlib import Path; sys.path[:0] = sys.argv[1:];"
        "from test_report import write; write(Path('there'), *pickle.load(open('results.pickle', 'rb')))"
    )
    folders = [str(Path(__file__).parent), str(ROOT / "tests")]
    environment = {**os.environ, "PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo"}
    subprocess.run([sys.executable, "-c", program, *folders], cwd=tmp_path, env=environment, check=True)
    here, there = (
        {p.relative_to(tmp_path / at): p.read_bytes() for p in (tmp_path / at).rglob("*.*")}
        for at in ("here", "there")
    )
    assert here == there


def test_a_run_cut_short_leaves_nothing_of_an_earlier_one(tmp_path, study, outcomes, written):
    out = tmp_path / "out"
    shutil.copytree(written, out)
    (out / "figures/mine.svg").write_text("<svg/>")
    writer = StudyWriter(out, study)
    left = sorted(p.relative_to(out).as_posix() for p in out.rglob("*.*"))
    assert left == ["figures/mine.svg"]
    writer.add("figure 6", outcomes["figure 6"])
    assert not (out / "report.html").exists()
    assert {p.stem for p in (out / "figures").iterdir()} == {"mine", "figure-6a", "figure-6b"}


def test_the_picture_says_what_its_curves_show(outcomes):
    control = outcomes["figure 7"]
    assert headline(control) == "controllers designed in 0-g: better and better in 0-g, unstable in 1-g"
    name, whole = control.sweeps[0]
    assert name == "all"
    calm = dataclasses.replace(whole.sweep, stable=np.ones_like(whole.sweep.stable))
    sweeps = ((name, dataclasses.replace(whole, sweep=calm)), *control.sweeps[1:])
    assert headline(dataclasses.replace(control, sweeps=sweeps)).endswith("stable in 1-g")
    assert "unstable" not in headline(dataclasses.replace(control, sweeps=sweeps))


def test_the_page_says_which_values_of_the_rig_count(written):
    """Every key of [rig] goes into the rig; the page tells the two rigs apart."""
    text = (written / "report.html").read_text(encoding="utf-8")
    assumptions = text[text.index('id="assumptions"') :]
    assert "<code>identification_noise</code>" in assumptions
    assert re.search(r"Coulomb and\s+viscous friction", assumptions)
    assert re.search(r"there is no\s+play", assumptions)
    used = (ROOT / "src/middeck/files/studies/rig_table.py").read_text()
    for key in RigForm.model_fields:
        assert re.search(rf"\bform\.{key}\b", used), key


def test_the_users_own_matplotlib_settings_neither_matter_nor_change(outcomes, written):
    with mpl.rc_context({"lines.linewidth": 9.0, "font.size": 30.0, "svg.fonttype": "path"}):
        figure = figure_3(outcomes["figures 4 and 5"])
        svg = svg_text(figure, key="figure-3", title="t", description="d")
        assert mpl.rcParams["lines.linewidth"] == 9.0
        assert mpl.rcParams["font.size"] == 30.0
    drawn = (written / "figures/figure-3.svg").read_text(encoding="utf-8")
    assert svg.split("</desc>")[1] == drawn.split("</desc>")[1]


def test_the_page_loads_nothing(written, page):
    assert not page.all("script", "link", "img", "iframe", "object", "embed", "base", "form")
    for tag, attributes in page.tags:
        for name in ("src", "srcset", "href", "xlink:href", "data", "poster", "action"):
            value = attributes.get(name, "#")
            follows = tag == "a" and value.startswith("https://")
            assert value.startswith(("#", "data:")) or follows, (tag, name, value)
        assert not [name for name in attributes if name.startswith("on")]
    text = (written / "report.html").read_text(encoding="utf-8")
    assert "@import" not in text
    assert set(re.findall(r"url\((.)", text)) <= {"#"}
    policy = next(a["content"] for a in page.all("meta") if a.get("http-equiv") == "Content-Security-Policy")
    assert "default-src 'none'" in policy


def test_ids_are_unique_and_every_reference_resolves(written, page):
    ids = Counter(a["id"] for _, a in page.tags if "id" in a)
    assert [i for i, n in ids.items() if n > 1] == []
    text = (written / "report.html").read_text(encoding="utf-8")
    wanted = {*re.findall(r'href="#([^"]+)"', text), *re.findall(r"url\(#([^)]+)\)", text)}
    for _, attributes in page.tags:
        wanted.update(attributes.get("aria-labelledby", "").split())
    assert wanted - set(ids) == set()


def test_every_drawing_has_words(page):
    drawings = [a for a in page.all("svg") if a.get("role") == "img"]
    assert len(drawings) == len(FIGURES) + len(OURS)
    for attributes in drawings:
        title, description = (page.texts[i] for i in attributes["aria-labelledby"].split())
        key = attributes["aria-labelledby"].split("-title")[0]
        assert len(title) > 10
        # One sentence: the same under the heading and for who cannot see the drawing.
        assert description == page.texts[f"{key}-caption"]
        assert description.endswith(".")


def test_table_heads_have_scope(page):
    heads = page.all("th")
    assert heads
    assert {a["scope"] for a in heads} == {"row", "col"}


def test_no_drawing_is_taller_than_a_printed_page(written):
    for file in (written / "figures").iterdir():
        _, _, width, height = map(float, re.search(r'viewBox="([^"]+)"', file.read_text())[1].split())
        assert height / width * PRINT_WIDTH_MM < PRINT_HEIGHT_MM - 40.0, file  # 40 mm: heading and sentence
    text = (written / "report.html").read_text(encoding="utf-8").partition("</style>")[0]
    assert re.search(r"@media print \{.*figure[^}]*\{ break-inside: avoid; \}", text, re.DOTALL)


def test_frequencies_on_the_page_are_those_of_the_numbers(page, numbers):
    four = numbers["figure_4"]
    rows = page.tables["Frequencies; rigid-body and suspension modes are not paired"][1:]
    assert [row[1] for row in rows] == four["lab"]["name"]
    assert [row[2] for row in rows] == [fixed(f, 4) for f in four["lab"]["frequency_hz"]]
    assert sorted(int(row[3]) for row in rows) == list(range(len(four["orbit"]["name"])))
    for row in rows:
        assert row[4] == four["orbit"]["name"][int(row[3])]
        assert row[5] == fixed(four["orbit"]["frequency_hz"][int(row[3])], 4)
    shown = {(int(row[3]), int(row[0])): row[6] for row in rows if row[6] != "–"}
    expected = zip(four["pairs"], four["ratio"], strict=True)
    assert shown == {tuple(pair): fixed(ratio, 4) for pair, ratio in expected}


def test_decibels_on_the_page_are_those_of_the_numbers(page, numbers):
    seven = numbers["figure_7"]
    head, *rows = page.tables["Performance against authority"]
    sides = [(which, env) for which in ("all", "rigid", "flexible") for env in ("orbit", "lab")]
    assert len(head) == 1 + len(sides)
    assert len(rows) == len(seven["log10_authority"]) == 25
    for k, row in enumerate(rows):
        for cell, (which, env) in zip(row[1:], sides, strict=True):
            value = seven[which][env]["db"][k]
            assert cell == ("unstable" if value is None else fixed(value, 2))
    assert "unstable" in {cell for row in rows for cell in row}


def test_other_tables_are_those_of_the_numbers(page, numbers):
    lab = numbers["figure_4"]["lab"]
    reactions = page.tables["Pinned reactions (1-g)"][1:]
    assert dict(reactions) == {n: fixed(v, 2) for n, v in lab["reactions_n"].items()}
    torques = page.tables["Holding torques (1-g)"][1:]
    assert dict(torques) == {n: fixed(v, 4) for n, v in lab["holding_torque_nm"].items()}
    loops = page.tables["Payload rms angle in the band, relative to open loop"][1:]
    assert [row[0] for row in loops] == ["CL1", "CL2", "CL3"]
    for row, name in zip(loops, ("low", "high", "robust"), strict=True):
        loop = numbers["figure_9b"][name]
        assert row[2:4] == [fixed(loop["predicted_db"], 3), fixed(loop["measured_db"], 3)]
    mirror = page.tables[f"{numbers['mirror']['states']} states on the 300 mV record"][1:]
    assert [number(row[1]) for row in mirror] == [
        pytest.approx(100.0 * e, abs=0.005)  # two decimals are shown
        for e in numbers["mirror"]["held_out_nrmse"]
    ]
    assert [row[3] for row in mirror] == [
        "yes" if ours <= theirs else "no"
        for ours, theirs in zip(
            numbers["mirror"]["held_out_nrmse"], numbers["mirror"]["published_nrmse"], strict=True
        )
    ]


def test_loops_on_the_page_are_those_of_the_numbers(page, numbers):
    reach = page.tables[
        "Highest stable authority of each design, with the pair near 9 Hz unshifted and shifted"
    ][1:]
    assert [row[0] for row in reach] == [r["what"] for r in numbers["figure_11"]["reach"]]
    assert [row[2] for row in reach] == [fixed(r["predicted_db"], 2) for r in numbers["figure_11"]["reach"]]
    for row, key in zip(
        page.tables["Measured rms in parts of the band, relative to open loop"][1:],
        ("payload", "both"),
        strict=True,
    ):
        assert row[1] == fixed(numbers["figure_12"]["bus_db_7_to_9_hz"][key], 2)
    modes = page.tables["Measured peaks relative to open loop, CL1, CL2, CL3"][1:]
    for k, name in enumerate(("low", "high", "robust")):
        loop = numbers["figure_9b"][name]
        wanted = [fixed(db, 1) for db in (loop["static_db"], *(mode["db"] for mode in loop["modes"]))]
        assert [row[1 + k] for row in modes] == wanted
    (rig,) = [rows for caption, rows in page.tables.items() if caption.endswith("CL3's authority")]
    judged = [on for n in ("low", "high", "robust") for on in numbers["figure_9b"][n]["rig"]]
    judged += numbers["figure_9b"]["one_model"]
    assert [row[2].split(" ")[0] for row in rig[1:]] == [
        "stable" if j["stable"] else "unstable" for j in judged
    ]
    assert [row[4] for row in rig[1:]] == [fixed(j["gain_margin_db"], 1) for j in judged]


def test_every_claim_is_in_the_summary(page, numbers):
    rows = {row[0]: row[1] for row in page.tables["Claims"][1:]}
    claims = [c for figure in numbers.values() for c in figure.get("claims", ())]
    assert len({c["claim"] for c in claims}) == len(claims) > 40
    for claim in claims:
        # The unit stands with the number.
        message = claim["claim"].removesuffix(f" [{claim['unit']}]")
        assert rows[message] == ("yes" if claim["holds"] else "no")
    # So few states are too few for the mirror, and the page says so.
    assert "no" in {holds for claim, holds in rows.items() if claim.startswith("mirror")}


def test_the_page_says_where_it_comes_from(written, study):
    text = (written / "report.html").read_text(encoding="utf-8")
    assert all(digest in text and name in text for name, digest in study.inputs)
    assert all(override in text for override in REDUCED)
    assert "CC BY 4.0" in text
    assert "15 of 313" in text
    assert "no dimension, mass, stiffness, gain or noise level" in text


@pytest.mark.parametrize("draw", [figure_7a, figure_7b])
def test_unstable_levels_are_not_drawn_as_decibels(outcomes, draw):
    control = outcomes["figure 7"]
    names = {"full": "all", "without": "rigid", "flexible": "flexible"}
    lines = {line.get_label(): line for line in draw(control).axes[0].lines if ", " in str(line.get_label())}
    assert lines
    for label, line in lines.items():
        gravity, which = re.match(r"(.-g), (\w+)", label).groups()
        sweep = dict(control.sweeps)[names[which]].sweep
        stable = sweep.stable[sweep.plants.index({"0-g": "orbit", "1-g": "lab"}[gravity])]
        np.testing.assert_array_equal(np.isfinite(line.get_ydata()), stable)


def test_part_of_a_study_gives_part_of_a_page(tmp_path, study, outcomes):
    """Also: a title is text, never markup."""
    name = "figures 4 and 5"
    write(
        tmp_path,
        dataclasses.replace(study, form=study.form.model_copy(update={"title": "<b>g & g</b>"})),
        {name: outcomes[name]},
    )
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    keys = ["figure-3", "figure-4", "figure-5"]
    assert [a["id"] for a in page.all("section")] == ["claims", *keys, "assumptions", "provenance"]
    assert "<h1>&lt;b&gt;g &amp; g&lt;/b&gt;</h1>" in text


def test_a_browser_opens_it_from_disk(chromium, written, tmp_path):
    flags = (*BROWSER_FLAGS, f"--user-data-dir={tmp_path}")
    address = (written / "report.html").resolve().as_uri()
    run = subprocess.run(
        [chromium, *flags, "--dump-dom", address], capture_output=True, text=True, timeout=120, check=True
    )
    dom = Page(run.stdout)
    assert len(dom.all("section")) == len(FIGURES) + len(OURS) + 3
    # The browser's own parser must agree with ours that nothing is nested wrongly: all tables survive whole.
    assert dom.tables == Page((written / "report.html").read_text(encoding="utf-8")).tables


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=40, max_size=400),
    st.integers(2, 12),
)
def test_thinned_curves_keep_their_envelope(values, bins):
    value = np.array(values)
    f = np.geomspace(0.1, 60.0, len(value))
    kept = keep_extremes(f, value, bins)
    assert np.all(np.diff(kept) > 0)
    assert {0, len(value) - 1} <= set(kept)
    assert value[kept].max() == value.max()
    assert value[kept].min() == value.min()
    assert len(kept) <= max(2 * bins + 2, 3 * bins)


def test_wrapped_phase_breaks_exactly_where_it_wraps():
    f = np.linspace(0.0, 30.0, 1000)
    phase = wrapped_phase_deg(np.exp(-2j * np.pi * f * 0.5))
    turns = 15 - 0.5  # half a turn at 1 Hz: the first wrap, then one a turn
    assert np.sum(np.isnan(phase)) == np.floor(turns + 0.5)


# ---- the first screen, and what the page may not contradict ------------------------------------------------

WIDTHS = """<script>addEventListener("load", () => {
const wide = [...document.querySelectorAll("body *")].filter(e => !e.closest("svg") && e.clientWidth > 0
  && getComputedStyle(e).display !== "inline" && e.scrollWidth > e.clientWidth + 1)
  .map(e => `${e.tagName} ${e.getAttribute("aria-label") || ""}`);
const end = document.querySelector("#summary").getBoundingClientRect().bottom;
const across = document.documentElement.scrollWidth - document.documentElement.clientWidth;
document.title = JSON.stringify({wide, end, across}); });</script>"""


def measured_in(chromium: str, written: Path, tmp_path: Path, width: int) -> dict[str, Any]:
    """What a real browser makes of the page in a window of that width and 900 pixels."""
    text = (written / "report.html").read_text(encoding="utf-8")
    text = text.replace("default-src 'none';", "default-src 'none'; script-src 'unsafe-inline';")
    (tmp_path / "page.html").write_text(text.replace("</body>", f"{WIDTHS}</body>"), encoding="utf-8")
    flags = (*BROWSER_FLAGS, f"--user-data-dir={tmp_path}", f"--window-size={width},900", "--hide-scrollbars")
    run = subprocess.run(
        [chromium, *flags, "--virtual-time-budget=3000", "--dump-dom", (tmp_path / "page.html").as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return json.loads(html.unescape(re.search(r"<title>(.*?)</title>", run.stdout, re.DOTALL)[1]))


@pytest.mark.parametrize("width", repeats([500, 1400, 1000]))
def test_nothing_is_cut_off(chromium, written, tmp_path, width):
    """500 pixels are the least that this browser opens; drawings alone may be scrolled there."""
    found = measured_in(chromium, written, tmp_path, width)
    assert found["across"] <= 0
    drawings = [name for name in found["wide"] if name.startswith("DIV") and "igure" in name]
    drawings += [name for name in found["wide"] if any(words in name for words in WORDS)]
    assert sorted(set(found["wide"])) == (sorted(set(drawings)) if width < 640 else [])
    if width >= 1000:
        assert found["end"] < 900.0  # the summary is on the first screen


def test_long_words_in_a_table_break(written):
    """Numbers stay on one line; a sentence was cut off at the edge of a wide page."""
    text = (written / "report.html").read_text(encoding="utf-8")
    assert ".tables td.text { white-space: normal; }" in text
    cells = [(kind, html.unescape(cell)) for kind, cell in re.findall(r"<td([^>]*)>([^<]*)</td>", text)]
    assert any(len(cell) > 60 for _, cell in cells)
    assert all(('class="text"' in kind) == (len(cell) > 60) for kind, cell in cells)


def test_a_limit_has_its_unit_once(numbers):
    for row in claim_rows(numbers):
        assert not re.search(r" \[[^\]]*\]$", row.claim), row
        assert "never decades" not in row.asked
        assert row.asked != "any %"


def test_the_first_lines_say_that_the_rig_is_simulated(written):
    text = (written / "report.html").read_text(encoding="utf-8")
    first = text[text.index("<h1>") :][:1200]
    assert "simulated rig" in first
    assert "What was asked" in first


def test_the_summary_lists_all_that_does_not_hold(numbers):
    claims = claim_rows(numbers)
    lines = [line.text for line in does_not_hold(numbers, claims)]
    for row in claims:
        warnings = [x for x in lines if x.startswith(row.claim.partition(" [")[0] + ": ")]
        assert len(warnings) == (not row.holds)
        assert all(row.number in x and row.asked in x for x in warnings)
    loops = {"CL1": "low", "CL2": "high", "CL3": "robust"}
    for who, key in loops.items():
        unstable = not all(on["stable"] for on in numbers["figure_9b"][key]["rig"])
        assert any(x.startswith(f"The loop {who} ") and "unstable" in x for x in lines) is unstable
    both = not all(on["stable"] for on in numbers["figure_12"]["both"]["rig"])
    assert any(x.startswith("The loop of Figure 12") for x in lines) is both
    assert came_out(numbers, claims)[0].text.startswith(
        f"{sum(row.holds for row in claims)} of {len(claims)}"
    )


def every_warning(numbers: Any) -> set[str]:
    if isinstance(numbers, dict):
        own = set(numbers.get("warnings", ()))
        return own.union(*(every_warning(v) for v in numbers.values()))
    return set().union(*map(every_warning, numbers)) if isinstance(numbers, list) else set()


def test_every_warning_reaches_the_page(written, numbers):
    text = html.unescape((written / "report.html").read_text(encoding="utf-8"))
    warnings = every_warning(numbers)
    assert warnings
    assert all(w in text for w in warnings)
    reported = copy.deepcopy(numbers)
    reported["figure_4"]["lab"]["warnings"] = ["the cable is short"]
    reported["figure_9b"]["drifted"]["warnings"] = ["the fit is poor"]
    assert {"the cable is short", "the fit is poor"} <= {w.text for w in warned(reported)}


def test_each_row_of_claims_is_in_one_unit(numbers):
    """The unit of its words, its number and its limit; decibels are changes, negative is less."""
    for claim in (c for figure in numbers.values() for c in figure.get("claims", ())):
        assert set(claim) == {"claim", "holds", "number", "asked", "unit"}
        tail = re.search(r"\[([^\]]*)\]$", claim["claim"])
        assert claim["unit"] == tail[1] if tail else claim["unit"] not in ("dB", "Hz", "s", "ms", "%", "deg")
        limit = re.fullmatch(r"([<>≤≥=]) (-?[\d.]+)", claim["asked"])
        if limit is not None and isinstance(claim["number"], float | int):
            verdict = {"<": "__lt__", ">": "__gt__", "≤": "__le__", "≥": "__ge__", "=": "__eq__"}[limit[1]]
            meets = getattr(float(claim["number"]), verdict)(float(limit[2]))
            assert meets or not claim["holds"], claim


def test_a_sentence_names_every_zero_that_its_table_puts_right(page, numbers):
    for key in ("figure_10a", "figure_10b"):
        zeros = numbers[key]["zeros"]
        sentence = page.texts[f"{key.replace('_', '-')}-caption"]
        (rows,) = [
            r[1:] for c, r in page.tables.items() if c == f"Zeros of the {port_words(numbers[key]['output'])}"
        ]
        assert [row[3] for row in rows] == [half_plane(z) for z in zeros]
        for row in rows:
            if row[3] != "left":
                assert f"{number(row[0]):.2f} Hz" in sentence
        inside = [r for r in rows if r[3] != "left" and number(r[0]) <= numbers[key]["fit_band_hz"][1]]
        assert ("no zero in the right half-plane" in sentence) is (not inside)


def test_a_zero_whose_side_is_not_known_is_reported_to_lie_on_either():
    zero = {"damping": -0.006, "damping_deviation": 0.014, "nonminimum_phase": True}
    assert (
        half_plane(zero)
        == half_plane(zero | {"damping": 0.006, "nonminimum_phase": False})
        == "left or right"
    )
    assert half_plane(zero | {"damping_deviation": 0.001}) == "right"


def test_a_sentence_says_which_shifts_a_loop_survives(page, numbers):
    loops = {"figure-9b": [numbers["figure_9b"][k] for k in ("low", "high", "robust")]}
    loops |= {"figure-11": [numbers["figure_11"]["payload"]], "figure-12a": [numbers["figure_12"]["both"]]}
    for section, of in loops.items():
        for loop in of:
            assert held(loop) in page.texts[f"{section}-caption"]
    rig = [{"percent": p, "stable": p != -1.0} for p in (0.0, -1.0, 1.0)]
    assert (
        held({"rig": rig})
        == "stable with the mode pair shifted by +1 % but unstable with the mode pair shifted by −1 %"
    )


def lightness(colour: Any) -> float:
    """L* of CIE 1976, 0 to 100: what is left of a colour in grey."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
    y = float(np.dot([0.2126, 0.7152, 0.0722], linear))
    return 116.0 * np.cbrt(y) - 16.0 if y > 0.008856 else 903.3 * y


def looks(line: Any) -> tuple[Any, ...]:
    filled = to_hex(line.get_markerfacecolor()) != "#ffffff"
    return line._unscaled_dash_pattern, line.get_marker(), filled, round(line.get_linewidth() / 0.8)


DRAWN = {d.key: (chapter.name, d.draw) for chapter in CHAPTERS for d in chapter.drawings}


@pytest.mark.parametrize("key", DRAWN)
def test_curves_are_distinguished_without_colour(outcomes, key):
    """By dashes, markers, width, or in grey by 20 of 100."""
    name, draw = DRAWN[key]
    for axes in draw(outcomes[name]).axes:
        named = [line for line in axes.lines if not str(line.get_label()).startswith("_")]
        for a, b in itertools.combinations(named, 2):
            apart = abs(lightness(a.get_color()) - lightness(b.get_color()))
            assert looks(a) != looks(b) or apart > 20.0, (a.get_label(), b.get_label(), apart)
