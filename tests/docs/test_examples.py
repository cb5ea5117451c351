"""Every Python block and every command on a page that teaches runs, in the order of the page.

A page is one session: its blocks share their names and a folder with the repository's articles, environments,
studies and data. TOML blocks, and C blocks that begin with a file name, are written there. A command that is
shown to fail says so: ``# exit code 2``. What a page promises in words is held here, not on the page.
"""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from doc_pages import ROOT, Block, blocks

from cli_runner import HALF_RATE, link_documents, share_results
from middeck.cli.main import execute
from repeats import LONG

PAGES = [
    "README.md",
    *(
        str(p.relative_to(ROOT))
        for f in ("tutorials", "how-to")
        for p in sorted((ROOT / "docs" / f).glob("*.md"))
    ),
    # Of the pages that explain, those whose code begins with all that it needs.
    *(
        f"docs/explanation/{name}.md"
        for name in ("margins", "pointing-budgets", "reduction", "sampled-control", "shaped-weights")
    ),
]
# Tested elsewhere: the main job, and the verbs of make.
ELSEWHERE = ("make ", "middeck study ")
# What `make test` reads instead: the states of a record that are searched elsewhere, fewer modes, levels and
# random draws, shorter runs.
SURVEY = "data/virtual-survey/mace-simple-lab.json"
BOTH = "articles/mace-dm.toml articles/mace-simple.toml"
COARSE = "--set mesh.elements_per_strut=1"
QUICKER = {
    "README.md": [
        ("--states 28 --band 1,3000", "--sampled --band 100,1000 --states 8"),
        ("--through earth,mars,moon", f"--through earth,mars,moon --count 12 {COARSE}"),
    ],
    "docs/tutorials/first-steps.md": [("boom/record.npz", "boom/record.npz --states 10 --sampled")],
    "docs/how-to/correlate-with-a-test.md": [
        (SURVEY, f"{SURVEY} --runs 50"),
        ("--noise 0.001,0.02", "--noise 0.001,0.02 --runs 50"),
        ("runs=300", "runs=60"),
        ("default_rng(2)", "default_rng(2), runs=100"),
    ],
    "docs/how-to/design-a-controller.md": [("(1e1, 1e3, 1e5)", "(1e5,)"), ("drift, 40", "drift, 10")],
    "docs/how-to/gimbals-and-friction.md": [("0.3, 40", "0.3, 20")],
    "docs/how-to/impact-test.md": [
        *HALF_RATE,
        ("--band 2,60\n", "--band 2,60 --states 4\n"),
        ("fit_impact(test)", "fit_impact(test, states=4)"),
    ],
    "docs/how-to/promise-what-will-happen.md": [("draws=20", "draws=6")],
    "docs/how-to/put-a-law-on-a-computer.md": [("_s=2.0", "_s=1.0")],
    "docs/how-to/qualify-a-compensator.md": [(f"{BOTH} --rate", f"{BOTH} --count 12 --rate")],
    "docs/how-to/test-on-the-simulated-rig.md": [
        ("uncertainty=drift)", "uncertainty=drift, tolerance=1e-3)")
    ],
    "docs/how-to/refine-on-ground-tests.md": [
        (f"{SURVEY} --environment lab", f"{SURVEY} --environment lab --runs 50")
    ],
}
Names = dict[str, Any]


def first_steps(names: Names) -> None:
    """What the tutorial says one sees."""
    orbit, hung = names["orbit"], names["hung"]
    assert orbit.kind.count("rigid") == 10
    assert hung.kind.count("suspension") == 10
    assert names["rest"].holding_torque[0] == pytest.approx(2.77, abs=0.005)
    np.testing.assert_allclose(names["comparison"].ratio[:2], [1.05, 1.07], atol=0.005)
    assert names["md"].leave_open(names["plants"]["0-g"]).inert == tuple(f"translation {a}" for a in "xyz")
    assert names["md"].leave_open(names["plants"]["1-g"]).inert == ()
    pd = {n: names["three_sigma_deg"](p) for n, p in names["held"].items()}
    assert pd["0-g"] == pytest.approx(1.0, abs=0.01)
    assert pd["1-g"] == pytest.approx(pd["0-g"] / 3.0, rel=0.2)
    law = names["design"](10.0)
    lqg = {n: names["three_sigma_deg"](p, law) for n, p in names["held"].items()}
    assert pd["0-g"] / lqg["0-g"] == pytest.approx(7.0, abs=0.5)
    assert lqg["1-g"] > pd["1-g"]
    in_orbit, in_lab = names["sweep"].db
    assert np.all(np.diff(in_orbit) < 0.0)
    assert np.all(in_lab > 20.0 * np.log10(pd["1-g"] / pd["0-g"]))  # no better than the PD loops
    assert np.all(np.isinf(in_lab[-6:]))
    assert hung.kind[hung.name.index(names["first"].mode_name)] == "suspension"
    (delay,), (deviation,) = names["fit"].model.delay_s, names["fit"].uncertainty.delay_s
    assert abs(delay - 0.008) < 3.0 * deviation  # 10 ms less half a hold of 4 ms
    assert names["fit"].model.delay_s[0] == pytest.approx(0.008, rel=0.05)
    assert len(names["fitted"].system.A) == 13
    assert names["measured_rms"] == pytest.approx(names["predicted"]["closed"], rel=0.1)


def put_a_law_on_a_computer(names: Names) -> None:
    """The files are those of the package, whose single form is as near as it says."""
    package, single = names["package"], names["md"].load_package("small.mdk")
    assert names["md"].load_package("again.json") == package
    assert package.core.drives
    assert single.error_bound[0] < 1e-3
    assert abs(float(names["u"][0])) <= 0.25
    assert all(answer.done for answer in names["answers"])
    assert 0.0 < np.abs(names["records"]["y"]).max() < 0.05
    assert names["tried"].passed
    assert names["tried"].left_out == ()
    assert (names["trial"].computer, names["trial"].trip) == ("reference law in Python", "")
    assert names["on_paper"].passed
    first, last = names["shaft_records"]["y"][[0, -1], 0]
    assert abs(last) < 0.01 * first == 0.0001


def your_own_article(names: Names) -> None:
    """A swinging, stable article with one more rigid-body mode than six."""
    assert names["modes"].kind.count("suspension") == 7
    assert "payload pendulum paddle" in names["modes"].name


def promise_what_will_happen(names: Names) -> None:
    comparison = json.loads(Path("comparison.json").read_text())
    assert comparison["promise"] == json.loads(Path("promise.json").read_text())["sha256"]
    assert comparison["score"]["coverage"] > 0.8
    assert [o.name for o in names["promised"].outlooks] == ["LQG 0", "LQG 3"]
    assert all(-60.0 < o.level_db(0.5) < -20.0 for o in names["promised"].outlooks)


def refine_on_ground_tests(names: Names) -> None:
    """The modulus that was changed is found, and the file holds what the page shows."""
    found = dict(zip([u.name for u in names["unknowns"]], names["refined"].estimate.x, strict=True))
    assert found["modulus"] == pytest.approx(np.log(2.5 / 2.35), abs=3e-3)
    factors = {k: round(v, 4) for k, v in load_factors("refined.toml").items()}
    assert factors["members.E"] == 1.0376
    assert factors["node.n3.mass"] == 1.0258
    ranked = names["ranking"].tests
    assert (ranked[0].name, ranked[-1].name) == ("better", "push")
    assert ranked[-1].ratio == pytest.approx(1.0, abs=1e-3)


def load_factors(path: str) -> dict[str, float]:
    return tomllib.loads(Path(path).read_text(encoding="utf-8"))["factors"]


def your_own_record(names: Names) -> None:
    """Both files give back what was put in."""
    assert names["fit"].model.delay_s[0] == pytest.approx(0.020, abs=1e-4)
    assert np.abs(names["fit"].model.poles[0]) == pytest.approx(30.0, rel=1e-4)


def from_a_record_to_a_plant(names: Names) -> None:
    """What was simulated comes back within its intervals, and only the mode that moved is said to have."""
    assert names["faults"] == ()
    assert not names["fit"].warnings
    truth = [3.2, 9.35, 0.01, 0.01]
    # Five deviations: the seeds are fixed, other machines round otherwise.
    np.testing.assert_array_less(
        np.abs(names["known"].values[:4] - truth), 5.0 * names["known"].deviation[:4]
    )
    assert [m.moved for m in names["drift"].modes] == [False, True]
    assert not any(d.changed for d in names["drift"].delays)
    np.testing.assert_allclose(names["diagram"].cluster_hz, truth[:2], rtol=1e-3)
    assert names["modes"].modal_mass[0] == pytest.approx(1.0, rel=1e-2)  # the constant is one
    assert names["rational"].system.A.shape == (10, 10)
    assert names["tracked"].natural_hz[-1, 1] == pytest.approx(9.35 * 1.002, rel=5e-4)
    assert len(names["members"]) == 20


def impact_test(names: Names) -> None:
    w = 2.0 * np.pi * np.array([12.0, 31.0])
    expected = w * (-np.array([0.01, 0.006]) + 1j)
    for fit in (names["fit"], names["averaged"]):
        found = fit.model.poles[np.argsort(fit.model.poles.imag)]
        assert np.abs(np.real(found - expected) / np.real(expected)).max() < 1e-3
        assert np.abs(np.abs(found) / w - 1.0).max() < 1e-5
        assert fit.model.delay_s[0] == pytest.approx(0.008, abs=1e-6)
    assert ["double" in b.rejected for b in names["test"].blows] == [False, True, False, False]


def clamp_it_load_it(names: Names) -> None:
    """The wall carries weight and load, and holds no suspension mode."""
    np.testing.assert_allclose(names["root"].force, [0.0, 5.0 + 1.2 * 9.80665, 0.0], atol=1e-6)
    assert set(names["modes"].kind) == {"flexible"}


def spinning_wheels(names: Names) -> None:
    """The first bending parts into a backward and a forward whirl, and the plant rings at both."""
    modes = names["modes"]
    assert modes.sense[:2] == ("backward", "forward")
    assert modes.frequency_hz[0] < names["still"].frequency_hz[0] < modes.frequency_hz[1]
    poles = np.sort(np.abs(np.linalg.eigvals(names["plant"].system.A))) / (2.0 * np.pi)
    assert poles[:4:2] == pytest.approx(modes.frequency_hz[:2], rel=1e-9)


def correlate_with_a_test(names: Names) -> None:
    """Frequencies fail and shapes agree; the table of chances; a file that comes back."""
    verdicts = {f.criterion.quantity.value: f.passed for f in names["found"].findings}
    assert verdicts == {
        "frequency error": False,
        "cross-orthogonality diagonal": True,
        "cross-orthogonality off-diagonal": True,
    }
    assert names["chance"]["without", "guyan"] == names["chance"]["with roll", "guyan"] == 0.0
    assert names["chance"]["with roll", "serep"] > 0.9 > names["chance"]["with roll", "irs"]
    assert names["other"].passed
    assert names["again"].passed


def design_a_controller(names: Names) -> None:
    """LQG is broken by the drift that the other design holds; fewer states hold too; a pole at zero."""
    assert names["margins"].stable
    share = {(row.name, row.setting): row.stable_share for row in names["compared"].rows}
    assert share["multi-model", "continuous"] == share["multi-model", "250 Hz"] == 1.0
    assert share["LQG", "continuous"] < 0.9
    assert names["small"].order == 12
    assert np.all(names["small"].stable)
    assert names["held"].state_names[-1] == "integral of pri_in_z"
    assert not names["held"].system.A[-1].any()
    assert names["outcome"].stable
    assert names["again"].sampled == names["translated"].sampled


def experiments_on_the_simulated_rig(names: Names) -> None:
    """Predicted is measured; LQG, of good margins, falls to the drift that the other design does not feel."""
    assert len(names["fit"].warnings) == 2
    np.testing.assert_allclose(names["fit"].model.delay_s, 0.010, rtol=0.01)
    (loop,) = names["md"].measure_margins(names["plant"], names["lqg"]).loops
    assert loop.gain_db > 9.0
    assert np.degrees(loop.phase_limit_rad) > 40.0
    tight = [s.mode[:9] for s in names["shifts"] if s.down > -0.015]
    assert tight == ["pole at 7", "pole at 9"]
    for name, run in names["today"].items():
        assert names["decibels"](run) == pytest.approx(names["predicted"][name], abs=0.1)
        assert not run.events.saturated.any()
    assert "mostly at 9." in names["a_day_later"]["LQG"].cause
    lost = names["decibels"](names["a_day_later"]["multi-model"]) - names["decibels"](
        names["today"]["multi-model"]
    )
    assert abs(lost) < 0.2


def override_a_value(names: Names) -> None:
    """Both overrides arrived, the first in its article alone."""
    study = names["study"]
    assert study.control.actuator_noise_ratio == 0.0
    assert study.case("simple", "lab")[0].attach_points[0].offset[2] == 0.0


def readme(names: Names) -> None:
    """The first flexible modes stiffen."""
    assert np.all(names["comparison"].ratio[:4] > 1.0)


def level_an_article(names: Names) -> None:
    """The tilts and offsets that the page names, to its digits."""
    assert np.degrees(names["hangs"].tilt[0]) == pytest.approx(-6.8, abs=0.05)
    assert names["hangs"].lies_off[1:] == pytest.approx([-0.081, -0.0097], abs=5e-4)
    assert names["found"].change == pytest.approx([-0.0291], abs=5e-5)
    assert len(names["found"].history) == 4
    assert names["shared"].change == pytest.approx([-0.0097] * 3, abs=2e-4)
    assert names["refused"]["n1 z"] == pytest.approx(-0.01)


def find_what_matters(names: Names) -> None:
    """Shares of the first bending, a torque of m g times a millimetre, a line that is nearly straight."""
    share = dict(
        zip((p.name for p in names["parameters"]), names["found"].relative[:, names["bending"]], strict=True)
    )
    assert share["members.E"] == pytest.approx(0.41, abs=0.005)
    assert share["environment.gravity.y"] == pytest.approx(0.08, abs=0.005)
    assert min(share, key=lambda n: share[n]) == "node.n3.mass"
    assert names["torque"][1] == pytest.approx(5.0 * 9.80665 * 1e-3, rel=0.05)
    moved = names["again"].frequency_hz[names["bending"]] - names["modes"].frequency_hz[names["bending"]]
    assert names["predicted"] - names["modes"].frequency_hz[names["bending"]] == pytest.approx(
        moved, rel=0.02
    )


def gimbals_and_friction(names: Names) -> None:
    """A pendulum that becomes a gimbal mode, gains that are right, a band by hand, a bounce that stiffens."""
    assert names["family"].stable == (True,) * 3
    assert all(plant is not None for plant in names["plants"])
    curves, at = names["curves"], names["pendulum"]
    assert curves.frequency_hz[0, at] == pytest.approx(3.2, abs=0.05)
    assert curves.zeta[:, at].max() == pytest.approx(0.25, abs=0.03)
    np.testing.assert_allclose(names["gain"].truncated_error[0], [5.6e-3, 3e-8], rtol=0.2)
    assert np.all(names["gain"].completed_error < 1e-9)  # rounding
    band = names["band"]
    assert band.device == ("n1", "n3", "n5")
    # Of the whole article: three times 0.2 N over its bounce stiffness, m (2 pi 0.25 Hz)^2, to its tilt.
    mass = names["article"].mass
    assert band.shift[1] == pytest.approx(3 * 0.2 / (mass * (2 * np.pi * 0.25) ** 2), rel=0.1)
    bounce = names["bounce"].frequency_hz
    assert bounce[0] > 5.0 * bounce[-1]
    assert Path("family.svg").exists()
    assert Path("amplitude.svg").exists()


def qualify_a_compensator(names: Names) -> None:
    """A margin of 2.1 dB; the plants of the last block in order, later is worse; the file is the same law."""
    rows = names["rows"]
    assert [(r.plant, r.setting) for r in rows[:3]] == [
        ("no delay", "continuous"), ("no delay", "250 Hz"), ("8 ms of delay", "continuous"),
    ]  # fmt: skip
    assert all(r.stable for r in rows)
    assert rows[2].loops[0].delay_limit_s == pytest.approx(rows[0].loops[0].delay_limit_s - 0.008, rel=1e-9)
    strong = names["md"].qualify_compensator(
        names["md"].load_compensator("strong.json"),
        {"late": names["md"].delay_plant(names["plant"], 0.002)},
        names["weights"],
        rates_hz=[250.0],
    )
    assert strong[1].loops[0].gain_db == pytest.approx(2.1, abs=0.05)
    assert names["again"] == names["law"]


def margins(names: Names) -> None:
    """Every crossing is listed, not only the nearest."""
    assert names["margins"].stable
    assert len(names["margins"].loops[0].gain) > 1


def pointing_budgets(names: Names) -> None:
    """The parts add up."""
    budget = names["budget"]
    np.testing.assert_allclose(np.hypot(budget.mean, budget.relative), budget.absolute, rtol=1e-9)


def reduction(names: Names) -> None:
    """Five modes, and twelve states that hold."""
    assert len(names["small"].kept) == 5
    assert names["less"].order == 12
    assert names["less"].stable.tolist() == [True]


def sampled_control(names: Names) -> None:
    """A stable law whose delay margin is known."""
    md, law = names["md"], names["direct"]
    assert 0.0 < md.measure_margins(names["plant"], law).loops[0].delay_limit_s < 0.1


def shaped_weights(names: Names) -> None:
    """It holds, with a pole at exactly zero."""
    assert names["md"].decide_stability(names["plant"], names["law"]).stable
    assert not names["law"].system.A[-1].any()


def deck(names: Names) -> None:
    """What NX Nastran printed, but for another mass of the members."""
    printed = [1.698800, 1.767487, 1.857720, 3.419612, 7.024210, 7.025409]
    np.testing.assert_allclose(names["modes"].frequency_hz[6:], printed, rtol=2.5e-4)
    # A cantilever (Blevins 1979): 1.8751^2 sqrt(EI / rho A) / (2 pi), about both axes.
    first = 1.875104**2 * np.sqrt(7e10 * np.array([1.3e-8, 1.9e-8]) / (2700.0 * 4e-4)) / (2 * np.pi)
    np.testing.assert_allclose(names["held"].frequency_hz[:2], first, rtol=1e-3)
    assert [port.name for port in names["plant"].outputs] == ["tip", "tip_rate"]


def free_decay(names: Names) -> None:
    """Three releases, and one exponential leaves far more than the noise."""
    found = names["found"]
    assert len(found.decays) == 3
    assert found.one_exponential_rms > 10.0 * found.residual_rms.max()
    assert np.all(np.diff(found.frequency_hz[4:]) > 0.0)


def see_the_shapes(names: Names) -> None:
    """The page works from the file alone, the modes are what the page says, and every figure is there."""
    assert names["drawing"].name[2] == "first torsion"
    text = Path("shapes.html").read_text(encoding="utf-8")
    assert "<script src" not in text
    assert "first bending x-y" in text
    drawn = ("modes.png", "modes.vtu", "four-modes.vtu", "four-modes.png", "correlation.svg", "response.svg",
             "loop.svg", "plants.svg", "level.svg")  # fmt: skip
    assert all(Path(name).stat().st_size > 5000 for name in drawn)


def component(names: Names) -> None:
    """From above, and small; `test_superelements` compares the assembly with NX Nastran."""
    assert np.all(names["error"] > -1e-9)
    assert np.max(names["error"]) < 1e-5
    np.testing.assert_allclose(names["floating"].frequency_hz[6], 12.0 / np.sqrt(1.0 - 6.0 / 50.0), rtol=1e-9)
    assert names["md"].structure.recover_outputs(names["modes"], "bus").modes.shape == (
        6,
        len(names["modes"].omega),
    )


def your_python_control_plant(names: Names) -> None:
    """The delay is exact on the way in, and an approximation on the way back."""
    np.testing.assert_allclose(names["ours"], names["theirs"], rtol=1e-12)
    same = names["md"].evaluate_plant(names["same"], names["hz"]).H[:, 0, 0]
    np.testing.assert_allclose(same, names["theirs"], rtol=1e-4)
    np.testing.assert_allclose(names["back"](2j * np.pi * names["hz"]), names["theirs"], rtol=1e-6)


def a_campaign_of_many_cases(names: Names) -> None:
    case = names["cases"][3]
    assert abs(case["stiffness"] / 1000.0 - 1.0) < 0.25
    loops, omega = names["loops"], names["omega"]
    damping = np.array([c["damping"] for c in names["cases"]])
    # Of q' = w r, r' = -w q - 2 z w r + noise: E q^2 = 1 / (4 z w).
    np.testing.assert_allclose(loops.rms[:, 0], (4.0 * damping * omega) ** -0.5, rtol=1e-10)
    assert not loops.alone.any()


PROMISES: dict[str, Callable[[Names], None]] = {
    "README.md": readme,
    "docs/tutorials/first-steps.md": first_steps,
    "docs/how-to/your-nastran-deck.md": deck,
    "docs/how-to/your-reduced-component.md": component,
    "docs/how-to/your-own-article.md": your_own_article,
    "docs/how-to/put-a-law-on-a-computer.md": put_a_law_on_a_computer,
    "docs/how-to/refine-on-ground-tests.md": refine_on_ground_tests,
    "docs/how-to/promise-what-will-happen.md": promise_what_will_happen,
    "docs/how-to/your-own-record.md": your_own_record,
    "docs/how-to/from-a-record-to-a-plant.md": from_a_record_to_a_plant,
    "docs/how-to/impact-test.md": impact_test,
    "docs/how-to/free-decay.md": free_decay,
    "docs/how-to/override-a-value.md": override_a_value,
    "docs/how-to/level-an-article.md": level_an_article,
    "docs/how-to/see-the-shapes.md": see_the_shapes,
    "docs/how-to/clamp-it-load-it.md": clamp_it_load_it,
    "docs/how-to/spinning-wheels.md": spinning_wheels,
    "docs/how-to/correlate-with-a-test.md": correlate_with_a_test,
    "docs/how-to/a-campaign-of-many-cases.md": a_campaign_of_many_cases,
    "docs/how-to/find-what-matters.md": find_what_matters,
    "docs/how-to/gimbals-and-friction.md": gimbals_and_friction,
    "docs/how-to/design-a-controller.md": design_a_controller,
    "docs/how-to/test-on-the-simulated-rig.md": experiments_on_the_simulated_rig,
    "docs/how-to/qualify-a-compensator.md": qualify_a_compensator,
    "docs/how-to/your-python-control-plant.md": your_python_control_plant,
    "docs/explanation/margins.md": margins,
    "docs/explanation/pointing-budgets.md": pointing_budgets,
    "docs/explanation/reduction.md": reduction,
    "docs/explanation/sampled-control.md": sampled_control,
    "docs/explanation/shaped-weights.md": shaped_weights,
}


@pytest.fixture
def session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that looks like the repository to what a page reads."""
    link_documents(tmp_path)
    share_results(monkeypatch)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", PAGES)
def test_a_page_runs_and_keeps_its_promises(page: str, session: Path) -> None:
    names: Names = {"__name__": "page"}
    ran = 0
    for block in _quicker(page):
        ran += _run(page, block, names)
    assert ran > 0
    PROMISES[page](names)


def _quicker(page: str) -> list[Block]:
    """The page's blocks; `make test` asks less of them."""
    found = blocks(ROOT / page)
    for old, new in () if LONG else QUICKER.get(page, ()):
        assert any(old in block.text for block in found), f"{page}: {old}"
        found = [block._replace(text=block.text.replace(old, new)) for block in found]
    return found


def _run(page: str, block: Block, names: Names) -> int:
    match block.language:
        case "python":
            # As many empty lines as are above the block: a traceback then names the line of the page.
            exec(compile("\n" * block.line + block.text, str(ROOT / page), "exec"), names)
        case "toml":
            name = re.match(r"# (\S+\.toml)\n", block.text)
            assert name is not None, f"{page}:{block.line}: the first line of a TOML block names its file"
            Path(name[1]).write_text(block.text, encoding="utf-8")
        case "c":
            named = re.match(r"/\* (\S+\.c) \*/\n", block.text)
            if named is None:
                return 0
            Path(named[1]).write_text(block.text, encoding="utf-8")
        case "sh":
            return sum(_command(page, block.line + k, text) for k, text in _lines(block.text))
        case _:
            return 0
    return 1


def _lines(text: str) -> list[tuple[int, str]]:
    """Number and text of each command, continued lines joined."""
    joined = re.sub(r"\\\n\s*", " ", text)
    return [(k, line) for k, line in enumerate(joined.splitlines(), 1) if line.strip()]


def _command(page: str, line: int, text: str) -> int:
    if text.startswith(ELSEWHERE):
        return 0
    program, *arguments = shlex.split(text, comments=True)
    if program == "cc" or program.startswith("./"):
        assert subprocess.run([program, *arguments], check=False).returncode == 0, f"{page}:{line}: {text}"
        return 1
    assert program == "middeck", f"{page}:{line}: {text}"
    expected = re.search(r"# exit code (\d+)$", text)
    code = execute(arguments, lambda: False)
    assert code == (int(expected[1]) if expected else 0), f"{page}:{line}: {text}"
    return 1
