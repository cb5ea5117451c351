"""Modal surveys that pyuff wrote (tests/cross/survey/make_survey.py), and surveys of ours, read by ours.

pyuff reads what we write: tests/cross/survey/read_survey.py, which is run by hand where pyuff is installed.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import middeck as md
from cli_runner import ROOT, middeck
from middeck.errors import ConfigError, DataError, MiddeckError
from middeck.structure.correlation.frequencies import compare_frequencies
from middeck.structure.correlation.measured_modes import AXES, MeasuredModes, MeasurementNoise
from middeck.structure.correlation.placing import place_channels
from middeck.structure.correlation.review_criteria import Quantity, find_profile
from middeck.structure.correlation.unit_slips import warnings_on_frequency_units
from middeck.structure.modes.solve import Modes
from repeats import LONG

FOLDER = Path(__file__).parent / "survey"
ARTICLE, LAB = "articles/mace-simple.toml", "environments/lab.toml"
FREE = [(f"n{k}", d) for k in range(1, 6) for d in ("x", "y", "z", "rx")]
HZ, ZETA = [4.25, 11.5, 30.0625], [0.01, 0.015, 0.002]
SIX_DIGITS = 5.1e-6  # E13.5


def truth(count: int) -> tuple[np.ndarray, np.ndarray]:
    """As in make_survey.py."""
    rng = np.random.default_rng(55)
    motion = rng.standard_normal((3, 5, count)) + 1j * rng.standard_normal((3, 5, count))
    return motion, np.random.default_rng(15).uniform(-1.0, 1.0, (5, 3))


@cache
def hung() -> Modes:
    return md.solve_modes(md.solve_equilibrium(*md.load_setup(ROOT / ARTICLE, ROOT / LAB)))


def virtual() -> MeasuredModes:
    return md.structure.measure_modes(hung(), FREE, chosen=range(10, 16))


@pytest.mark.parametrize(("name", "count"), [("normal-m", 3), ("normal-mm", 6), ("complex-m", 3)])
def test_what_pyuff_wrote_comes_back_in_si(name: str, count: int) -> None:
    found = md.load_measured_modes(FOLDER / f"{name}.unv")
    motion, places = truth(count)
    motion = motion if name.startswith("complex") else motion.real
    np.testing.assert_allclose(found.frequency_hz, HZ, rtol=SIX_DIGITS)
    np.testing.assert_allclose(found.damping, ZETA, rtol=1e-5)
    assert found.node == tuple(str(k) for k in range(1, 6) for _ in range(count))
    assert found.direction == AXES[:count] * 5
    expected = motion.reshape(3, -1).T
    for part in (np.real, np.imag):
        np.testing.assert_allclose(part(found.shape), part(expected), rtol=SIX_DIGITS, atol=1e-12)
    assert found.is_real != np.iscomplexobj(motion)
    assert found.position_m is not None
    digits = SIX_DIGITS if name == "normal-mm" else 1e-15
    np.testing.assert_allclose(found.position_m, places.repeat(count, axis=0), rtol=digits)
    assert found.warnings == ()


@pytest.mark.parametrize("sets", [(2411, 55), (15, 2414)])
@pytest.mark.parametrize("is_complex", [False, True])
def test_what_we_write_comes_back(is_complex: bool, sets: tuple[int, int], tmp_path: Path) -> None:
    article = virtual()
    turned = article.shape * np.exp(0.3j * np.arange(6)) if is_complex else article.shape
    written = replace(article, shape=turned)
    md.files.write_measured_modes(tmp_path / "m.unv", written, hung().equilibrium.model.structure, sets)
    assert all(f"-1\n{number:6d}\n" in (tmp_path / "m.unv").read_text() for number in (151, 164, 82, *sets))
    read = md.load_measured_modes(tmp_path / "m.unv")
    placed = place_channels(hung().equilibrium.model, read)
    assert placed.warnings == ()
    order = [placed.channels.index(c) for c in article.channels if c in placed.channels]
    kept = [article.channels.index(c) for c in placed.channels]
    size = np.abs(turned).max(axis=0)
    left = np.delete(np.abs(turned), kept, axis=0)
    assert not left.any()  # all that is lost is what does not move
    assert len(order) == len(placed.node)
    np.testing.assert_allclose(placed.shape / size, turned[kept] / size, atol=SIX_DIGITS)
    np.testing.assert_allclose(placed.frequency_hz, article.frequency_hz, rtol=1e-5)
    np.testing.assert_allclose(placed.damping, article.damping, rtol=1e-4)


def test_a_survey_in_a_universal_file_is_correlated(tmp_path: Path) -> None:
    md.files.write_measured_modes(tmp_path / "m.unv", virtual())
    noise = MeasurementNoise(1e-3, 0.02)
    profile = md.structure.find_profile("orion-well")
    found = [
        md.correlate_modes(
            hung(),
            test,
            profile,
            rng=np.random.default_rng(1),
            noise=noise,
            runs=3,
        )
        for test in (virtual(), md.load_measured_modes(tmp_path / "m.unv"))
    ]
    assert np.array_equal(found[0].pairs, found[1].pairs)
    np.testing.assert_allclose(found[1].evaluation.mac, found[0].evaluation.mac, atol=1e-5)


def test_a_file_of_ours_that_is_cut_between_data_sets_is_reported(tmp_path: Path) -> None:
    """Cut there, any universal file looks whole; ours states its number of modes, which can be corrected."""
    md.files.write_measured_modes(tmp_path / "m.unv", virtual())
    text = (tmp_path / "m.unv").read_text()
    starts = [m.start() for m in re.finditer(r"^    -1\n    55\n", text, re.M)]
    (tmp_path / "m.unv").write_text(text[: starts[-2]])
    with pytest.raises(DataError, match=f"cut: {len(starts) - 2} of the {len(starts)} modes") as refused:
        md.load_measured_modes(tmp_path / "m.unv")
    assert "correct the number in data set 151" in str(refused.value.hint)
    (tmp_path / "m.unv").write_text(
        text[: starts[-2]].replace(f"{len(starts)} modes", f"{len(starts) - 2} modes", 1)
    )
    assert len(md.load_measured_modes(tmp_path / "m.unv").frequency_hz) == len(starts) - 2


def test_a_2414_is_read_as_a_55(tmp_path: Path) -> None:
    text = (FOLDER / "normal-m.unv").read_text()

    def as_2414(found: re.Match[str]) -> str:
        hz, mass, zeta, eta = found["told"].split()
        head = "    -1\n  2414\n         1\nmodes\n         1\n" + "NONE\n" * 5
        ints = f"{found['kinds']}\n" + f"{0:10d}" * 8 + "\n" + f"{0:10d}" * 2 + "\n"
        first = "".join(f"{float(x):13.5e}" for x in (0.0, hz, 0.0, mass, zeta, eta))
        return head + ints + first + "\n" + f"{0.0:13.5e}" * 6 + "\n" + found["rest"]

    form = re.compile(
        r" {4}-1\n {4}55 *\n(?:NONE *\n){5}(?P<kinds>.*)\n.*\n(?P<told>.*)\n(?P<rest>(?:.*\n)*?)(?= {4}-1\n)"
    )
    changed, count = form.subn(as_2414, text)
    assert count == 3
    (tmp_path / "m.unv").write_text(changed)
    assert md.load_measured_modes(tmp_path / "m.unv") == md.load_measured_modes(FOLDER / "normal-m.unv")
    (tmp_path / "both.unv").write_text(text + changed)  # each mode stands there twice, and counts once
    assert md.load_measured_modes(tmp_path / "both.unv") == md.load_measured_modes(FOLDER / "normal-m.unv")
    fewer = re.sub(r"(\.\d{4})\d(e[+-]\d\d)", r" \1\2", changed, flags=re.IGNORECASE)
    fewer = re.sub(r"(-?\d) (\.)", r" \1\2", fewer)  # a digit fewer, in the same columns
    assert fewer != changed
    (tmp_path / "digits.unv").write_text(text + fewer)
    assert len(md.load_measured_modes(tmp_path / "digits.unv").frequency_hz) == count


def change(tmp_path: Path, old: str, new: str, name: str = "normal-m.unv") -> Path:
    text = (FOLDER / name).read_text()
    assert re.search(old, text)
    (tmp_path / "changed.unv").write_text(re.sub(old, new, text, count=1))
    return tmp_path / "changed.unv"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (r"( +)1( +1)\n( +1\.0+D\+00)", r"\g<1>5\g<2>\n\g<3>", "units code 5"),
        (
            r"(?<=  2411).*\n         1         1         1",
            "\n         1         1         7",
            "displacement axes",
        ),
        (r"         8         2         3\n", "         3         2         3\n", "specific type 3"),
        (r"         2         4         1         1\n", "         2\n", "whole numbers"),
        (r"(?s)    55.*?\n    -1\n", "    55\nNONE\n    -1\n", "truncated"),
    ],
)
def test_what_cannot_be_trusted_is_refused(old: str, new: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=says):
        md.load_measured_modes(change(tmp_path, old, new))


def test_damping_by_hysteresis_is_half_of_it(tmp_path: Path) -> None:
    path = change(tmp_path, r"1\.00000e-02  0\.00000e\+00", "0.00000e+00  3.00000e-02")
    assert md.load_measured_modes(path).damping[0] == pytest.approx(0.015)


def test_accelerations_become_displacements(tmp_path: Path) -> None:
    path = tmp_path / "a.unv"
    text = (FOLDER / "complex-m.unv").read_text()
    path.write_text(text.replace("         8         5         3\n", "        12         5         3\n"))
    found, plain = (md.load_measured_modes(p) for p in (path, FOLDER / "complex-m.unv"))
    root = 2.0 * np.pi * np.array(HZ) * (-np.array(ZETA) + 1j * np.sqrt(1.0 - np.array(ZETA) ** 2))
    np.testing.assert_allclose(found.shape * root**2, plain.shape, rtol=2e-5)


def test_places_decide_over_numbers_and_say_so() -> None:
    test, model = virtual(), hung().equilibrium.model
    swap = {"n1": "2", "n2": "1", "n3": "3", "n4": "4", "n5": "5"}
    mixed = place_channels(model, replace(test, node=tuple(swap[n] for n in test.node)))
    assert mixed.node == test.node
    assert sum("taken as" in w for w in mixed.warnings) == 2
    by_number = place_channels(model, replace(mixed, node=tuple(swap[n] for n in test.node), position_m=None))
    assert by_number.node == tuple({"1": "n1", "2": "n2"}.get(swap[n], n) for n in test.node)


def test_nodes_that_are_not_in_the_model_are_listed_or_refused() -> None:
    test, model = virtual(), hung().equilibrium.model
    strange = replace(test, node=tuple("77" if n == "n5" else n for n in test.node), position_m=None)
    placed = place_channels(model, strange)
    assert placed.node == test.node[:16]
    assert any("4 channels" in w and "77" in w for w in placed.warnings)
    with pytest.raises(ConfigError, match="no node of the test"):
        place_channels(model, replace(test, node=tuple(f"7{n[1]}" for n in test.node), position_m=None))


def test_another_frame_is_noticed() -> None:
    test = virtual()
    assert test.position_m is not None
    moved = replace(
        test, node=tuple(n[1:] for n in test.node), position_m=test.position_m + np.array([0, 3, 0])
    )
    placed = place_channels(hung().equilibrium.model, moved)
    assert placed.node == test.node
    assert sum("is its frame" in w for w in placed.warnings) == 5


CSV = {
    "comma.csv": "frequency [Hz],damping,n1.x,n2.y [mm]\n4.25,0.01,0.5,250\n11.5,0.02,-1e-1,40.5\n",
    "decimals.csv": "frequency [Hz];damping [%];n1.x;n2.y [mm]\n4,25;1;0,5;250\n11,5;2;-1e-1;40,5\n",
    "radians.csv": "Frequency [rad/s]\tdamping\tn1.x [cm]\tn2.y\n"
    + f"{8.5 * np.pi!r}\t0.01\t50\t0.25\n{23.0 * np.pi!r}\t0.02\t-10\t0.0405\n",
    "counted.csv": "Mode;Mode name;Freq. (Hz);Damping Ratio (%);n1.x;n2.y (mm)\n"
    + "1;1,5 of 2nd;4,25;1;0,5;250\n2;2.;11,5;2;-1e-1;40,5\n",
}


@pytest.mark.parametrize("name", CSV)
def test_a_survey_in_csv(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(CSV[name])
    found = md.load_measured_modes(tmp_path / name)
    np.testing.assert_allclose(found.frequency_hz, [4.25, 11.5], rtol=1e-12)
    np.testing.assert_allclose(found.damping, [0.01, 0.02], rtol=1e-12)
    assert found.channels == ("n1 x", "n2 y")
    np.testing.assert_allclose(found.shape, [[0.5, -0.1], [0.25, 0.0405]], rtol=1e-12)
    assert found.warnings == ("decimal commas are read as points",) * (
        name in ("decimals.csv", "counted.csv")
    )


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no lines"),
        ("frequency [Hz],n1.q\n1,2\n", "'n1.q'"),
        ("frequency [furlong]\n1\n", "furlong"),
        ("damping\n1\n", "no column of frequencies"),
        ("frequency,frequency\n1,2\n", "two columns"),
        ("frequency,damping\n1\n", "1 cells for 2"),
        ("mode,frequency,damping\n1,1\n", "2 cells for 3"),
        ("mode,frequency,quality\n1,1,1\n", "'quality'"),
        ("frequency;damping\n1.234,5;0,1\n", "no number"),
        ("frequency;damping\n1,234;0.01\n2,345;0.02\n", "1000 times as much"),
        ("frequency\nx\n", "could not convert"),
        ("frequency\n-1\n", "-1.0 Hz"),
        ("frequency,n1.x\n1,nan\n", "not finite"),
    ],
)
def test_a_wrong_csv_is_refused(text: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "s.csv").write_text(text)
    with pytest.raises(DataError, match=re.escape(says)):
        md.load_measured_modes(tmp_path / "s.csv")


def test_frequencies_alone_tell_what_they_can(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    modes = hung()
    chosen = [10, 11, 14]
    hz = modes.frequency_hz[chosen] * 1.001
    (tmp_path / "f.csv").write_text("frequency [Hz]\n" + "\n".join(f"{f!r}" for f in hz.tolist()))
    test = md.load_measured_modes(tmp_path / "f.csv")
    assert np.isnan(test.damping).all()
    found = compare_frequencies(modes, test, find_profile("ecss-e-st-32-11c"))
    limit = max(f.criterion.limit for f in found.findings)
    for i, j in found.pairs:  # brute force: what else fits within the limit or nearly as well
        away = np.abs(np.log(modes.frequency_hz[modes.frequency_hz > 0.0] / hz[j]))
        own = abs(np.log(modes.frequency_hz[i] / hz[j]))
        assert (j in found.undecided) == (np.sum(away <= max(limit, 2.0 * own)) > 1)
        other = modes.frequency_hz[modes.frequency_hz > 0.0][np.argsort(away)[1]]
        shown = [w for w in found.warnings if w.startswith(f"measured mode {j + 1} ")]
        assert (f"{other:.4g} Hz fits too" in " ".join(shown)) == (j in found.undecided)
    assert found.pairs[:, 0].tolist() == chosen
    np.testing.assert_allclose(found.frequency_error, 1.0 / 1.001 - 1.0, rtol=1e-9)
    assert not found.passed
    assert all(c.quantity is not Quantity.FREQUENCY_ERROR for c in found.unjudged)
    with pytest.raises(ConfigError, match="frequencies alone"):
        md.correlate_modes(modes, test, find_profile("orion-well"), rng=np.random.default_rng(0))
    asked = "correlate", str(ROOT / ARTICLE), str(tmp_path / "f.csv")
    assert middeck(capfd, *asked, "--require").code == 1
    assert middeck(capfd, *asked, "--figure", str(tmp_path / "f.svg")).code == 0
    drawn = (tmp_path / "f.svg").read_text()
    assert drawn.count(">-0.10<") == len(chosen)  # of 1 / 1.001
    assert drawn.count(" Hz ?: ") == len(found.undecided)


@pytest.mark.parametrize(
    ("factor", "unit"), [(2.0 * np.pi, "rad/s"), (60.0, "a minute"), (1e-3, "kHz"), (1.0, "")]
)
def test_frequencies_alone_in_another_unit_are_reported(factor: float, unit: str) -> None:
    """Of a model that may be 3 % off; in hertz nothing is said, whichever of its modes were measured."""
    hz = hung().frequency_hz
    off = 1.0 + 0.03 * np.random.default_rng(3).standard_normal(len(hz))
    modes = hz[hz > 0.0]
    warnings = warnings_on_frequency_units(modes, factor * (hz * off)[hz > 0.0][:8])
    assert (unit in " ".join(warnings)) if unit else not warnings
    assert not warnings_on_frequency_units(modes, modes[[3, 7, 8, 12, 15]])


def test_what_a_universal_file_cannot_hold_is_refused(tmp_path: Path) -> None:
    for sets, reported in (
        ((2411, 58), "2411 and 58"),
        ((15,), "15"),
        ((15, 55, 82), "15 and 55"),
        ((), "of none"),
    ):
        with pytest.raises(ConfigError, match=f"data sets {reported}.* are not written") as error:
            md.files.write_measured_modes(tmp_path / "m.unv", virtual(), sets=sets)  # ty: ignore[invalid-argument-type]
        assert "nodes as 2411 or 15, shapes as 55 or 2414" in str(error.value.hint)
    with pytest.raises(ConfigError, match="JSON, which has no data sets"):
        md.files.write_measured_modes(tmp_path / "m.json", virtual(), sets=(2411, 55))
    assert not (tmp_path / "m.json").exists()
    joints = md.structure.measure_modes(hung(), [("pri_x", "angle"), ("n1", "x")], chosen=[10])
    for what, says in (
        (joints, "angle"),
        (replace(virtual(), damping=np.full(6, np.nan)), "damping"),
        (replace(virtual(), node=tuple(f"{n}a" for n in virtual().node), position_m=None), "neither numbers"),
    ):
        with pytest.raises(DataError, match=says):
            md.files.write_measured_modes(tmp_path / "m.unv", what)
    with pytest.raises(DataError, match="data set 2414 has no place for the angle of a joint"):
        md.files.write_measured_modes(tmp_path / "m.unv", joints, sets=(15, 2414))
    assert not (tmp_path / "m.unv").exists()


def mutated(text: bytes, rng: np.random.Generator) -> bytes:
    """One to four bytes changed, a line lost or doubled, or the end cut off."""
    way, at = rng.integers(4), int(rng.integers(len(text)))
    if way == 0:
        return text[:at]
    if way == 1:
        many = bytearray(text)
        for k in rng.integers(len(text), size=rng.integers(1, 5)):
            many[k] = rng.choice(list(b"0123456789-+.eD \n\xff"))
        return bytes(many)
    lines = text.splitlines(keepends=True)
    k = int(rng.integers(len(lines)))
    return b"".join(lines[:k] + [lines[k]] * (0 if way == 2 else 2) + lines[k + 1 :])


@pytest.mark.parametrize("name", ["normal-m.unv", "normal-mm.unv", "complex-m.unv", "s.csv"])
def test_mutated_surveys_are_read_or_refused(name: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    whole = CSV["decimals.csv"].encode() if name == "s.csv" else (FOLDER / name).read_bytes()
    path, refusals = tmp_path / name, list[str]()
    for _ in range(2500 if LONG else 60):
        path.write_bytes(mutated(whole, rng))
        try:
            assert isinstance(md.load_measured_modes(path), MeasuredModes)
        except MiddeckError as error:
            refusals.append(error.where)
    assert refusals
    assert all(where.startswith(str(path)) for where in refusals)
