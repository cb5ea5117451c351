"""Advice on files is followed to the letter, and the fault is gone."""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from middeck.cli.main import execute
from middeck.errors import ConfigError, DataError
from middeck.files.measured.survey_csv import load_csv
from middeck.files.records import name_columns, read_record
from middeck.files.setups import load_environment, load_structure
from middeck.files.studies.documents import load_study
from middeck.identification.record_fit.fit_record import fit_record
from middeck.signals.ports import Port
from middeck.signals.record import Record

ARTICLE = """\
schema = 1
name = "bar"

[section.tube]
EA_n = 1.0e6
GJ_nm2 = 80.0
EI_y_nm2 = 100.0
EI_z_nm2 = 100.0
rho_A_kg_per_m = 0.5
rho_I_y_kg_m = 1.0e-5
rho_I_z_kg_m = 1.0e-5

[[node]]
name = "a"
x_m = 0.0

[[node]]
name = "b"
x_m = 2.0
mass_kg = 1.5

[[strut]]
section = "tube"
from = "a"
to = "b"
"""
HALL = """\
schema = 1
name = "hall"

[constants]
gravity_m_s2 = 9.81

[[clamp]]
node = "a"
"""


def article(tmp_path: Path, text: str) -> str:
    """What is said of it; empty if it is read."""
    return told_by(load_structure, tmp_path / "bar.toml", text)


def environment(tmp_path: Path, text: str) -> str:
    return told_by(load_environment, tmp_path / "hall.toml", text)


def told_by(load: Callable[[Path], object], path: Path, text: str) -> str:
    path.write_text(text, encoding="utf-8")
    try:
        load(path)
    except ConfigError as error:
        return str(error)
    return ""


def test_a_comma_before_three_digits_is_either(tmp_path: Path) -> None:
    """``70,000`` was advised to become 70.000, a thousandth of what may be meant."""
    message = article(tmp_path, ARTICLE.replace("1.0e6", "70,000"))
    assert "EA_n = 70.000 if it is a decimal comma, EA_n = 70000 if it parts thousands" in message
    assert "a decimal point: x_m = 0.200" in article(tmp_path, ARTICLE.replace("x_m = 2.0", "x_m = 0,200"))


@pytest.mark.parametrize(
    ("head", "key", "meant"),
    [
        ("[constants]\n", "gravity_m_s2 = 9.81", "'gravity_m_s2' is a key of [constants]"),
        ("[constants]\n", "gravity = 9.81", "'gravity_m_s2' is a key of [constants]"),
        ("", "held = {a = 'xyz'}", "'held' is a key of [suspension] and [[device]]"),
    ],
)
def test_a_key_in_the_wrong_table_gets_its_own_as_hint(
    tmp_path: Path, head: str, key: str, meant: str
) -> None:
    text = HALL.replace("[constants]\ngravity_m_s2 = 9.81\n", "")
    message = environment(tmp_path, text.replace('name = "hall"\n', f'name = "hall"\n{key}\n'))
    assert meant in message
    if head:
        assert not environment(tmp_path, f"{text}{head}gravity_m_s2 = 9.81\n")


def test_a_key_for_the_one_that_is_missing_gets_the_hint_of_it(tmp_path: Path) -> None:
    """``node`` is a table of the file too, above which it was advised to be written."""
    case = '[[load_case]]\nname = "pull"\nload = [{node = "b", force_n = [0.0, 1.0, 0.0]}]\n'
    assert "load.0.node = \"b\": unknown key\n  try: did you mean 'frame'?" in article(
        tmp_path, ARTICLE + case
    )
    assert not article(tmp_path, ARTICLE + case.replace("node = ", "frame = "))


def test_a_number_for_a_direction_is_advised_to_be_three(tmp_path: Path) -> None:
    """``cg_m = 0.1`` was advised to become ``[0.1]``, which lacks two."""
    message = article(tmp_path, ARTICLE.replace("mass_kg = 1.5", "mass_kg = 1.5\ncg_m = 0.1"))
    assert "must be an array\n  try: cg_m = [x, y, z], 3 values" in message


def test_a_torque_on_a_node_is_advised_to_need_an_axis(tmp_path: Path) -> None:
    torque = '[[actuator]]\nname = "t"\nframe = "b"\n'
    message = article(tmp_path, ARTICLE + torque)
    assert "is no joint, so that the actuator needs an axis\n  try: axis = [x, y, z]" in message
    assert not article(tmp_path, ARTICLE + torque + "axis = [0.0, 0.0, 1.0]\n")


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("frame", '["b"]', "must be a text in quotes"),
        ("frame", "{ a = 1 }", "must be a text in quotes"),
        ("kind", '["force"]', 'must be "torque" or "force"'),
        ("frame", '"bb"', "no frame of this name\n  try: did you mean 'b'?"),
    ],
)
def test_a_port_of_another_kind_or_misspelt_is_reported(
    tmp_path: Path, key: str, value: str, message: str
) -> None:
    """An array ended in ``unhashable type``, a misspelt node in the advice to define a joint."""
    keys = {"name": '"t"', "frame": '"b"'} | {key: value}
    text = "\n".join(f"{name} = {given}" for name, given in keys.items())
    output = article(tmp_path, f"{ARTICLE}[[actuator]]\n{text}\n")
    assert f"actuator.0.{key} = " in output
    assert message in output


def test_a_table_that_needs_a_name_is_reported_once(tmp_path: Path) -> None:
    message = article(tmp_path, ARTICLE.replace("[section.tube]", "[section]"))
    assert message.count("must have a name\n  try: [section.NAME] above its keys") == 1
    assert "must be a table" not in message


def test_a_file_without_schema_gets_the_hint_of_the_line(tmp_path: Path) -> None:
    message = article(tmp_path, ARTICLE.replace("schema = 1\n", ""))
    assert "schema: missing\n  try: schema = 1, above the first [table]" in message


def test_a_name_that_is_not_there_is_no_advice(tmp_path: Path) -> None:
    """An attach point that stands on a frame of its own unknown name advised just that name."""
    joint = '[[revolute]]\nname = "r"\nparent = "c"\naxis = [0.0, 0.0, 1.0]\nmass_kg = 1.0\n'
    point = '[[attach]]\nname = "c"\nframe = "c"\n'
    message = article(tmp_path, ARTICLE + joint + point)
    assert message.count('= "c": no frame of this name') == 2
    assert "attach point on" not in message


@pytest.mark.parametrize("typed", ["bra.toml", "bar.tom"])
def test_an_article_of_nearly_this_name_is_named(
    tmp_path: Path, typed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    article(tmp_path, ARTICLE)
    assert execute(["check", str(tmp_path / typed)], lambda: False) == 2
    assert "did you mean 'bar.toml'?" in capsys.readouterr().err


def test_an_override_of_two_words_is_advised_to_be_one(capsys: pytest.CaptureFixture[str]) -> None:
    code = execute(["modes", "bar.toml", "--set", "node.1.mass_kg", "5"], lambda: False)
    assert code == 2
    assert "an override is one word, as --set key=value" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore:.*use more elements")
@pytest.mark.parametrize(
    ("ports", "message"),
    [
        ("--control push --measure spot_rte", "no sensor 'spot_rte'\n  try: did you mean 'spot_rate'?"),
        ("--control psh --measure spot", "no actuator 'psh'\n  try: did you mean 'push'?"),
        (
            "--control push --measure spot_x",
            "no sensor 'spot_x'\n  try: did you mean 'spot'? one of spot, spot_rate",
        ),
        ("--control push,push --measure spot", "--control names 'push' twice\n  try: each port once"),
    ],
)
def test_a_port_of_nearly_this_name_is_named(
    tmp_path: Path, ports: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    at = 'frame = "b"\naxis = [0.0, 1.0, 0.0]\n'
    push, spot = f'[[actuator]]\nname = "push"\nkind = "force"\n{at}', f'[[sensor]]\nname = "spot"\n{at}'
    article(tmp_path, ARTICLE + push + spot)
    environment(tmp_path, HALL)
    files = [str(tmp_path / "bar.toml"), "--environment", str(tmp_path / "hall.toml")]
    assert execute(["design", *files, "--log10-authority", "1", *ports.split()], lambda: False) == 2
    assert message in capsys.readouterr().err


# ---- records -----------------------------------------------------------------------------------------------


def record_file(tmp_path: Path, *, fmt: str = "%.6f", back_s: float = 0.0, end: str = "\n") -> Path:
    t = np.arange(400) / 100.0
    t[200:] -= back_s
    x = np.random.default_rng(5).standard_normal((2, 400))
    lines = [f"{at:.2f},{fmt % u},{fmt % y}" for at, u, y in zip(t, *x, strict=True)]
    path = tmp_path / "run.csv"
    path.write_text("time [s],torque [N m],angle [rad]\n" + "\n".join(lines) + end, encoding="utf-8")
    return path


def test_a_number_that_contradicts_the_heading_is_refused(tmp_path: Path) -> None:
    """Whoever counts the column of time had 'angle' taken for the torque in silence."""
    path = record_file(tmp_path)
    with pytest.raises(DataError, match=r"column 2 is 'angle', 'torque' is column 1\n.*without that of time"):
        read_record(path, name_columns(["2=torque"], ["1=angle"]))
    with pytest.raises(DataError, match=r"the file has 2\n.*without that of time"):
        read_record(path, name_columns(["1=torque"], ["3=angle"]))
    kept = read_record(path, name_columns(["torque"], ["angle"])).record
    named = read_record(path, name_columns(["1=u"], ["2=y"])).record
    assert np.array_equal(kept.u, named.u)


def test_without_headings_a_column_of_times_counts_and_no_advice_says_otherwise(tmp_path: Path) -> None:
    path = record_file(tmp_path)
    path.write_text(path.read_text(encoding="utf-8").partition("\n")[2], encoding="utf-8")
    torque = read_record(path, name_columns(["2=torque"], ["3=angle"], sample_hz=100.0)).record.u
    assert torque.std() == pytest.approx(1.0, abs=0.1)  # not the ramp of times
    with pytest.raises(DataError, match=r"the file has 3\n.*counted from 1$"):
        read_record(path, name_columns(["2=torque"], ["4=angle"], sample_hz=100.0))


def test_two_recordings_in_one_file_are_advised_to_be_parted(tmp_path: Path) -> None:
    """Stamps printed coarsely were blamed, and to leave the column of time out would have hidden the seam."""
    with pytest.raises(
        DataError, match=r"time goes back by 0\.99 s behind sample 199\n.*part the file there"
    ):
        read_record(record_file(tmp_path, back_s=1.0), name_columns(["torque"], ["angle"]))


@pytest.mark.parametrize(("kept", "severity"), [(0, "note"), (3, "serious"), (4, "serious")])
def test_a_number_cut_in_a_column_of_any_width(tmp_path: Path, kept: int, severity: str) -> None:
    """With %.6g a hundredth of the numbers lack a digit, a thousandth two."""
    path = record_file(tmp_path, fmt="%.6g", end="")
    whole = path.read_text(encoding="utf-8")
    if kept:
        path.write_text(whole[: whole.rindex(",") + 1] + "-0.123456"[: kept + 1], encoding="utf-8")
    (fault,) = read_record(path, name_columns(["torque"], ["angle"])).faults
    assert (fault.kind, fault.severity) == ("truncated", severity)


def test_a_band_beyond_half_the_rate_is_reported() -> None:
    u = np.random.default_rng(5).standard_normal((1, 1, 400, 1))
    y = lfilter([0.0, 1.0], [1.0, -1.6, 0.9], u, axis=2)
    ports = ((Port("torque", "N m"),), (Port("angle", "rad"),))
    record = Record(sample_hz=100.0, u=u, y=y, inputs=ports[0], outputs=ports[1], periodic=False)
    with pytest.warns(UserWarning, match="tells nothing above 50 Hz: the band, up to 80 Hz, is fitted up to"):
        beyond = fit_record(record, states=2, sampled=True, band_hz=(1.0, 80.0))
    within = fit_record(record, states=2, sampled=True, band_hz=(1.0, 50.0))
    assert np.array_equal(beyond.model.poles, within.model.poles)
    endless = fit_record(record, states=2, sampled=True, band_hz=(1.0, np.inf))
    assert np.array_equal(endless.model.poles, within.model.poles)


# ---- studies -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('article = "own"', 'article = "mine"', 'control.article = "mine": no article of this name'),
        ('angles = ["bus_x",', 'angles = ["bus_x", "bus_x",', 'control.angles.1 = "bus_x": is there twice'),
    ],
)
def test_a_slip_in_a_study_is_one_fault(tmp_path: Path, old: str, new: str, message: str) -> None:
    """With a wrong article each port was a fault; a port named twice came after the first figure."""
    for source in files("middeck.files").joinpath("start").iterdir():
        text = source.read_text(encoding="utf-8").replace("$name", "own")
        (tmp_path / source.name).write_text(text, encoding="utf-8")
    study = tmp_path / "study.toml"
    load_study(study)
    study.write_text(study.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_study(study)
    assert message in str(caught.value)
    assert len(caught.value.data["faults"]) == 1


# ---- surveys -----------------------------------------------------------------------------------------------

SURVEY = "frequency [Hz],damping,n1.x,n1.y,n1.z,n3.y,n3.z\n1.75,0.01,0,1,0,-0.6,0\n2.45,0.01,0,0,1,0,-0.5\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            SURVEY.replace("1.75", "1,75"),
            ":2: 8 cells for 7 columns\n  try: .*decimals have commas, semicolons",
        ),
        (f"{SURVEY}1.75,0.01,0,1,0,-0.6,0\n", ":4: the mode of line 2 again\n  try: leave one out"),
    ],
)
def test_a_slip_in_a_survey_is_reported_with_its_cure(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "survey.csv"
    path.write_text(SURVEY.replace(",", ";").replace(".", ",").replace("n1,", "n1.").replace("n3,", "n3."))
    assert load_csv(path).frequency_hz.tolist() == [1.75, 2.45]
    path.write_text(text)
    with pytest.raises(DataError, match=message):
        load_csv(path)
