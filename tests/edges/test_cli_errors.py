"""Bad input through the command line: exit code, place and advice on stderr, stdout empty, no traceback."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli_runner import ROOT, as_process, middeck
from middeck.cli.main import INTERNAL, execute
from middeck.files.records import write_record
from middeck.signals.ports import Port
from middeck.signals.record import Record

ARTICLE = ROOT / "articles/mace-dm.toml"
LAB = ROOT / "environments/lab.toml"
STUDY = ROOT / "studies/mace-1993.toml"

Capture = pytest.CaptureFixture[str]


def refused(capfd: Capture, code: int, *arguments: object, says: tuple[object, ...]) -> str:
    ended = middeck(capfd, *arguments)
    assert ended.code == code, ended
    assert ended.out == ""
    assert ended.err.startswith("error: ")
    assert "Traceback" not in ended.err
    for part in says:
        assert str(part) in ended.err
    return ended.err


def edited(tmp_path: Path, source: Path, old: str, new: str) -> Path:
    text = source.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / source.name
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


def line_of(path: Path, text: str) -> int:
    lines = path.read_text(encoding="utf-8").splitlines()
    return next(n for n, line in enumerate(lines, 1) if text in line)


# old text, new text, what stands on the line that is named, parts of the message
ARTICLE_FAULTS: dict[str, tuple[str, str, str, tuple[str, ...]]] = {
    "misspelt key": ("mass_kg = 3.0", "mas_kg = 3.0", "mas_kg", ("node.0.mas_kg = 3.0", "'mass_kg'?")),
    "wrong unit": ("x_m = 0.375", "x_mm = 375.0", "x_mm", ("'x_m' is expected, in m", "convert to m")),
    "zero length": ("x_m = 0.375", "x_m = 0.0", 'to = "n2"', ("strut.0.to", "move the nodes apart")),
    "unconnected": (
        "[[gimbal]]",
        '[[node]]\nname = "lost"\nx_m = 3.0\n\n[[gimbal]]',
        '"lost"',
        ("unconnected node", "[[strut]]"),
    ),
    "negative mass": ("mass_kg = 3.0", "mass_kg = -3.0", "-3.0", ("node.0.mass_kg", "must be >= 0 kg")),
    "negative inertia": ("[0.06, 0.045, 0.07]", "[0.06, -0.045, 0.07]", "-0.045", ("each > 0",)),
    "not a number": ("cg_m = [0.0, -0.03, 0.0]", "cg_m = [0.0, nan, 0.0]", "nan", ("finite",)),
    "truncated": (
        "inertia_kg_m2 = [0.06, 0.045, 0.08]",
        "inertia_kg_m2 = [0.06, 0.0",
        "[0.06, 0.0",
        ("TOML",),
    ),
}


@pytest.mark.parametrize("case", ARTICLE_FAULTS)
def test_a_fault_of_an_article(tmp_path: Path, capfd: Capture, case: str) -> None:
    old, new, marker, says = ARTICLE_FAULTS[case]
    path = edited(tmp_path, ARTICLE, old, new)
    if case == "truncated":
        path.write_text(path.read_text(encoding="utf-8").partition(new)[0] + new, encoding="utf-8")
    place = f"{path}:{line_of(path, marker)}"
    refused(capfd, 2, "modes", path, "--environment", LAB, says=(place, *says))


def test_all_faults_at_once_of_article_environment_and_override(tmp_path: Path, capfd: Capture) -> None:
    article = edited(tmp_path, ARTICLE, "mass_kg = 3.0", "mas_kg = 3.0")
    lab = edited(tmp_path, LAB, "bounce_hz = 0.25", "bounce_hz = -0.25")
    says = ("3 errors", "node.0.mas_kg", "suspension.bounce_hz = -0.25", "--set mesh.elements_per_strut")
    arguments = (article, "--environment", lab, "--set", "mesh.elements_per_strut=0")
    for verb in ("modes", "compare"):
        refused(capfd, 2, verb, *arguments, says=says)


@pytest.mark.parametrize("key", ["offsets", "nodes"])
def test_attach_points_without_one_offset_each(capfd: Capture, key: str) -> None:
    refused(
        capfd, 2, "modes", ARTICLE, "--set", f"suspension.{key}=[]", says=("suspension.offsets_m", "one each")
    )


def test_an_empty_and_a_missing_file(tmp_path: Path, capfd: Capture) -> None:
    empty = tmp_path / "empty.toml"
    empty.write_text("")
    refused(capfd, 2, "modes", empty, "--environment", LAB, says=(f"{empty}:1", "empty"))
    refused(capfd, 2, "modes", ARTICLE, "--environment", "labb", says=("no environment 'labb'", "'lab'?"))
    refused(capfd, 2, "modes", tmp_path / "none.toml", says=("none.toml",))


def test_gravity_without_a_suspension(tmp_path: Path, capfd: Capture) -> None:
    text = LAB.read_text(encoding="utf-8")
    lab = tmp_path / "lab.toml"
    lab.write_text(text[: text.index("[suspension]")], encoding="utf-8")
    place = f"{lab}:{line_of(lab, 'gravity_m_s2')}"
    for verb in ("modes", "compare"):
        refused(
            capfd, 2, verb, ARTICLE, "--environment", lab, says=(place, "constants.gravity_m_s2", "orbit")
        )


def test_a_slack_cable_names_files_and_cable(capfd: Capture) -> None:
    # The cable of n1 beyond the centre of mass would have to push.
    says = (ARTICLE, LAB, "cable at 'n1'", "slack", "move the attach points")
    slack = ("--environment", LAB, "--set", "suspension.offsets.0.0=1.2")
    refused(capfd, 5, "compare", ARTICLE, *slack, says=says)


@pytest.mark.parametrize("verb", ["modes", "compare", "response", "study"])
def test_unknown_overrides(tmp_path: Path, capfd: Capture, verb: str) -> None:
    source = STUDY if verb == "study" else ARTICLE
    more = {
        "response": ("--input", "pri_rel_z", "--output", "bus_z", "--at", "1"),
        "study": ("-o", tmp_path / "out"),
    }.get(verb, ())
    says = ("--set: suspension.bounce_h=0.2", "unknown key", "'suspension.bounce_hz'?")
    refused(capfd, 2, verb, source, *more, "--set", "suspension.bounce_h=0.2", says=says)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("typed", ["--env", "--evnironment"])
def test_an_option_that_is_shortened_or_misspelt(capfd: Capture, typed: str) -> None:
    refused(capfd, 2, "modes", ARTICLE, typed, LAB, says=(f"'{typed}'", "Did you mean '--environment'?"))


def test_ports_that_are_not_there(capfd: Capture) -> None:
    ask = ("response", ARTICLE, "--environment", "orbit", "--at", "1")
    says = ("'pri_z'", "one of", "pri_rel_z", ARTICLE)
    refused(capfd, 2, *ask, "--input", "pri_z", "--output", "bus_z", says=says)
    refused(capfd, 2, *ask, "--input", "bus_z", "--output", "bus_w_rate", says=("'bus_w", "bus_z"))


@pytest.mark.parametrize("at", ["0", "-1,2", "nan", "1,,2", "one"])
def test_bad_frequencies(capfd: Capture, at: str) -> None:
    ports = ("--input", "bus_z", "--output", "bus_z", "--at", at)
    refused(capfd, 2, "response", ARTICLE, *ports, says=("--at", "middeck response --help"))


# ---- records -----------------------------------------------------------------------------------------------


def record(samples: int = 64, hz: float = 64.0) -> Record:
    u = np.tile(np.random.default_rng(5).standard_normal((1, 1, samples, 1)), (1, 2, 1, 1))
    y = np.fft.irfft(np.fft.rfft(u, axis=2) / (1.0 + 0.2j * np.arange(samples // 2 + 1)[:, None]), axis=2)
    y = y + 1e-3 * np.random.default_rng(6).standard_normal(y.shape)
    return Record(
        sample_hz=hz,
        u=u,
        y=y,
        inputs=(Port("torque", "N m"),),
        outputs=(Port("angle", "rad"),),
        periodic=True,
    )


def saved(path: Path, **changes: Any) -> Path:
    """The record above with arrays of the file changed."""
    write_record(path, record())
    with np.load(path) as archive:
        contents = {k: archive[k] for k in archive.files} | changes
    np.savez(path, **contents)
    return path


def with_nan() -> np.ndarray:
    y = np.array(record().y)
    y[0, 1, 7, 0] = np.nan
    return y


RECORD_FAULTS: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "not a number": ({"y": with_nan()}, ("channel angle", "period 1, sample 7")),
    "constant output": ({"y": np.full((1, 2, 64, 1), 0.3)}, ("output angle", "constant at 0.3 rad", "cable")),
    "constant input": ({"u": np.zeros((1, 2, 64, 1))}, ("input torque", "constant at 0 N m")),
    "too few samples": ({"u": record().u[:, :, :8], "y": record().y[:, :, :8]}, ("8 samples", "too few")),
    "mismatched lengths": ({"y": record().y[:, :, :60]}, ("mismatched lengths", "cut inputs and outputs")),
    "mismatched rates": ({"sample_hz": np.array([64.0, 32.0])}, ("several rates", "resample")),
}


@pytest.mark.parametrize("case", RECORD_FAULTS)
@pytest.mark.parametrize("verb", ["identify", "design"])
def test_a_fault_of_a_record(tmp_path: Path, capfd: Capture, case: str, verb: str) -> None:
    changes, says = RECORD_FAULTS[case]
    path = saved(tmp_path / "record.npz", **changes)
    refused(capfd, 4, verb, path, "--states", 2, says=(path, *says))


def test_records_cut_empty_missing_and_of_another_kind(tmp_path: Path, capfd: Capture) -> None:
    whole, cut, empty = (tmp_path / f"{n}.npz" for n in ("whole", "cut", "empty"))
    write_record(whole, record())
    cut.write_bytes(whole.read_bytes()[:-200])
    empty.touch()
    other = tmp_path / "notes.txt"
    other.write_text("hello")
    for path, what in (
        (cut, "truncated"),
        (empty, "empty"),
        (other, "no reader"),
        (tmp_path / "no.npz", "no such"),
    ):
        refused(capfd, 4, "identify", path, "--states", 2, says=(path, what, "try:"))


def test_records_that_do_not_fit_each_other(tmp_path: Path, capfd: Capture) -> None:
    a, rate, length = (tmp_path / f"{n}.npz" for n in "abc")
    write_record(a, record())
    write_record(rate, record(hz=32.0))
    write_record(length, record(samples=128))
    refused(
        capfd, 4, "identify", a, rate, "--states", 2, says=(rate, a, "sampling rate [Hz]", "32.0", "64.0")
    )
    refused(capfd, 4, "identify", a, length, "--states", 2, says=(length, "periods and samples"))
    other = saved(tmp_path / "other.npz", input_names=np.array(["force"]))
    refused(capfd, 4, "identify", a, "--states", 2, "--validate", other, says=(other, "force", "torque"))


def test_settings_of_a_fit(tmp_path: Path, capfd: Capture) -> None:
    path = tmp_path / "a.npz"
    write_record(path, record())
    fit = ("identify", path)
    refused(capfd, 2, *fit, "--set", "statse=2", says=("statse", "'states'?"))
    refused(
        capfd, 2, *fit, "--set", "states=-2", "--set", "sampled=3", says=("2 errors", "1 to 1000", "sampled")
    )
    refused(capfd, 2, *fit, "--states", 3, "--continuous", says=("3 states", "even"))
    refused(capfd, 2, *fit, "--states", 2, "--band", "9,3", says=("--band", "rise"))
    refused(capfd, 5, *fit, "--states", 100, "--sampled", says=(path, "fewer states"))
    refused(capfd, 4, *fit, "--states", 2, "--band", "40,50", says=(path, "no excited line"))


# ---- models and designs ------------------------------------------------------------------------------------


def model_document(**changes: Any) -> dict[str, Any]:
    """A pole at 1 rad/s that grows and that the input does not move, beside one that it does."""
    return {
        "schema": "middeck.model/1",
        "sample_hz": None,
        "inputs": [{"name": "motor", "unit": "N m"}],
        "outputs": [{"name": "angle", "unit": "rad"}],
        "poles": {"re": [0.1, -1.0], "im": [1.0, 50.0]},
        "shapes": {"re": [[1.0, 1.0]], "im": [[0.0, 0.0]]},
        "participation": {"re": [[0.0], [0.0]], "im": [[0.0], [-1.0]]},
        "direct": [[0.0]],
        "lower": [[0.0]],
        "delay_s": [0.0],
    } | changes


def saved_model(tmp_path: Path, **changes: Any) -> Path:
    path = tmp_path / "model.json"
    path.write_text(json.dumps(model_document(**changes)), encoding="utf-8")
    return path


def test_a_plant_that_nothing_can_stabilise_names_the_mode(tmp_path: Path, capfd: Capture) -> None:
    path = saved_model(tmp_path)
    # |0.1 + 1j| / 2 pi = 0.159949 Hz
    says = (path, "pole at 0.1599 Hz", "no control input in u reaches it")
    refused(capfd, 5, "design", path, "-o", tmp_path / "law.json", says=says)
    assert not (tmp_path / "law.json").exists()
    free = ("design", ARTICLE, "--environment", "orbit", "--control", "pri_rel_z", "--measure", "pri_in_z")
    refused(capfd, 5, *free, says=("rotation z", "does not decay"))


MODEL_FAULTS: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "another schema": ({"schema": "middeck.modes/1"}, ("middeck.modes/1", "identify -o")),
    "not a number": ({"delay_s": [float("nan")]}, ("delay_s", "not finite")),
    "ragged": ({"direct": [[0.0], [1.0, 2.0]]}, ("direct", "not an array")),
    "shapes that differ": ({"delay_s": [0.0, 0.0]}, ("delay_s", "shape")),
    "no ports": ({"inputs": []}, ("inputs", "no ports")),
    "half a complex number": ({"poles": {"re": [-1.0, -1.0]}}, ("poles", "im")),
    "a port too many": ({"inputs": model_document()["inputs"] * 2}, ("2 inputs",)),
    "a rate of zero": ({"sample_hz": 0.0}, ("sample_hz", "> 0 Hz")),
}


@pytest.mark.parametrize("case", MODEL_FAULTS)
def test_a_fault_of_a_model_file(tmp_path: Path, capfd: Capture, case: str) -> None:
    changes, says = MODEL_FAULTS[case]
    path = saved_model(tmp_path, **changes)
    refused(capfd, 4, "design", path, says=(path, *says))


def test_a_model_file_cut_or_empty(tmp_path: Path, capfd: Capture) -> None:
    path = saved_model(tmp_path)
    path.write_text(path.read_text()[:80])
    refused(capfd, 4, "design", path, says=(f"{path}:1", "truncated"))
    path.write_text("")
    refused(capfd, 4, "design", path, says=(path, "empty"))
    path.write_text(json.dumps({"schema": "middeck.model/1"}))
    refused(capfd, 4, "design", path, says=(path, "keys missing", "poles"))
    refused(capfd, 4, "design", tmp_path / "none.json", says=("none.json", "cannot be read"))


def test_options_of_a_design(tmp_path: Path, capfd: Capture) -> None:
    path = saved_model(tmp_path)
    refused(capfd, 2, "design", path, "--authority", 1, "--log10-authority", 1, says=("the same",))
    refused(capfd, 2, "design", path, "--set", "pade_ordr=2", says=("pade_ordr", "'pade_order'?"))
    refused(
        capfd, 2, "design", path, "--angle-noise", 0, "--pade-order", 0, says=("2 errors", "> 0", "1 to 12")
    )
    refused(capfd, 2, "design", path, "--control", "moto", says=("'moto'", "motor"))
    refused(capfd, 2, "design", ARTICLE, says=("--control is missing", "pri_rel_z"))


# ---- the command itself ------------------------------------------------------------------------------------


def test_unknown_verbs_and_options_name_the_nearest(capfd: Capture) -> None:
    refused(capfd, 2, "mods", says=("'mods'", "'modes'"))
    refused(capfd, 2, "modes", ARTICLE, "--cout", "3", says=("'--cout'", "'--count'", "middeck modes --help"))
    refused(capfd, 2, "modes", says=("ARTICLE",))


def test_an_output_that_cannot_be_written(tmp_path: Path, capfd: Capture) -> None:
    blocked = tmp_path / "file"
    blocked.touch()
    law = blocked / "law.json"
    for verb in ("identify", "design"):
        nowhere = tmp_path / "new" / "m.json"
        refused(capfd, 2, verb, "a.npz", "-o", nowhere, says=(f"-o {nowhere}: no such folder", "mkdir -p"))
        assert not nowhere.parent.exists()
    stable = {"poles": {"re": [-0.1, -1.0], "im": [1.0, 50.0]}}
    refused(capfd, 2, "design", saved_model(tmp_path, **stable), "-o", law, says=(blocked,))


def test_debug_shows_the_traceback_and_keeps_the_code(capfd: Capture) -> None:
    ended = middeck(capfd, "modes", ARTICLE, "--environment", "nowhere", "--debug")
    assert ended.code == 2
    assert ended.out == ""
    assert "Traceback" in ended.err
    assert ended.err.rstrip().splitlines()[-2].startswith("error: no environment 'nowhere'")


def test_a_fault_of_the_program_is_one_line_and_no_verdict(
    capfd: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*arguments: object, **options: object) -> None:
        raise KeyError("two\nlines")

    monkeypatch.setattr("middeck.cli.given.typed_article.solve_in", broken)
    code = execute(["compare", str(ARTICLE)], lambda: False)
    out, err = capfd.readouterr()
    assert (code, out) == (INTERNAL, "")
    assert err.count("\n") == 1
    assert "KeyError" in err
    assert "report" in err


def test_an_error_as_the_shell_sees_it(tmp_path: Path) -> None:
    ended = as_process("modes", ARTICLE, "--set", "node.0.mass=nan")
    assert ended.code == 2
    assert ended.out == ""
    assert "node.0.mass_kg" in ended.err
    assert "finite" in ended.err
    assert "Traceback" not in ended.err


def test_an_environment_as_an_argument_is_advised_to_be_an_option(capfd: Capture) -> None:
    refused(capfd, 2, "modes", ARTICLE, "orbit", says=("(orbit)", "an option, as --environment lab"))
