"""Options given twice, and files to write by their endings: of every verb, whatever options it has."""

from __future__ import annotations

import json
from pathlib import Path

import click
import numpy as np
import pytest
import scipy.io

from cli_runner import ROOT, middeck
from middeck.cli import figures, options
from middeck.cli.app import VERBS, app
from middeck.files.exchange.matlab_systems import load_mat
from middeck.files.measured.models import load_model
from middeck.files.records import load_record, write_record
from middeck.files.records.formats import SUFFIXES
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.systems.plants.plant import Plant
from middeck.systems.sampling.delayed_sampling import split_delays

ARTICLE = ROOT / "articles/mace-simple.toml"
Capture = pytest.CaptureFixture[str]

# What an option takes, where its type does not tell.
VALUES = {
    "numbers": "1,2,3",
    "frequencies": "1,2",
    "text": "a",
    "float": "1.5",
    "float range": "0.5",
    "integer": "2",
    "integer range": "2",
    "path": "out",
}


def command(verb: str) -> click.Command:
    found = app.get_command(click.Context(app), verb)
    assert found is not None
    return found


def single_options() -> list[tuple[str, str]]:
    return [
        (verb, option.opts[-1])
        for verb in VERBS
        for option in command(verb).params
        if isinstance(option, click.Option) and not option.multiple and not option.is_flag
    ]


def value_of(verb: str, name: str) -> str:
    """What an option takes; several words of an option that takes several."""
    option = next(p for p in command(verb).params if name in p.opts)
    kind = option.type
    if isinstance(kind, click.Choice):
        return str(kind.choices[0])
    if name in ("--output", "--figure", "--stabilisation"):
        return "x.svg" if name != "--output" else "out" if verb == "study" else "x.json"
    if isinstance(kind, options.Numbers):
        return ",".join(str(k + 1) for k in range(kind.count or 2))
    if isinstance(kind, click.Tuple):
        return " ".join(VALUES[part.name] for part in kind.types)
    return VALUES[kind.name]


def test_a_single_option_twice_is_refused(capfd: Capture) -> None:
    """Before anything is read: there is no such file."""
    for verb, name in single_options():
        given = name, *value_of(verb, name).split()
        ended = middeck(capfd, verb, "nothing.toml", *given, *given)
        assert ended.code == 2, (verb, name)
        assert f"{name} takes one value and is given twice" in ended.err, verb
        assert ended.out == "", (verb, name)


def test_both_of_a_pair_of_flags_are_refused(capfd: Capture) -> None:
    ended = middeck(capfd, "identify", "a.npz", "--sampled", "--continuous")
    assert ended.code == 2
    assert "given twice" in ended.err


REPEATED = {
    ("record", "inputs"): (["a", "b,c"], ("a", "b,c")),
    ("record", "outputs"): (["a [m]", "b"], ("a [m]", "b")),
    ("identify", "inputs"): (["a", "b"], ("a", "b")),
    ("identify", "outputs"): (["a", "b"], ("a", "b")),
    ("identify", "reference"): (["r", "s"], ("r", "s")),
    ("path", "through"): (["earth", "moon"], ("earth", "moon")),
    ("level", "about"): (["x", "z"], ("x", "z")),
    ("response", "at"): (["1,2", "3"], (1.0, 2.0, 3.0)),
    ("excite", "noise"): (["1", "2"], (1.0, 2.0)),
}
NEEDED = {
    "level": ["a", "--free", "n1.z"],
    "response": ["a", "--input", "u", "--output", "y", "--at", "9"],
    "excite": ["multisine", "--rate", "9"],
}


@pytest.mark.parametrize(("verb", "name"), REPEATED)
def test_a_list_option_adds_up(verb: str, name: str) -> None:
    given, wanted = REPEATED[verb, name]
    needed = [a for a in NEEDED.get(verb, ["a"]) if a not in ("--at", "9") or verb != "response"]
    arguments = [*needed, *(a for value in given for a in (f"--{name}", value))]
    params = command(verb).make_context(verb, arguments).params
    assert wanted in params.values()


# ---- endings -----------------------------------------------------------------------------------------------

WRITES = {
    ("budget", "--figure"): options.FIGURES,
    ("path", "--figure"): options.FIGURES,
    ("correlate", "--figure"): figures.SHAPES,
    ("response", "--figure"): options.FIGURES,
    ("design", "--figure"): options.FIGURES,
    ("qualify", "--figure"): options.FIGURES,
    ("level", "--figure"): options.FIGURES,
    ("compare", "--figure"): figures.SHAPES,
    ("modes", "--figure"): figures.MODES,
    ("modes", "--output"): options.SURVEYS,
    ("identify", "--figure"): options.FIGURES,
    ("identify", "--stabilisation"): options.FIGURES,
    ("identify", "--output"): options.SYSTEMS,
    ("impact", "--response"): options.RESPONSES,
    ("impact", "--output"): options.SYSTEMS,
    ("design", "--output"): options.SYSTEMS,
    ("excite", "--output"): options.COMMANDS,
    ("record", "--output"): options.RECORDS,
    ("convert", "--output"): options.ARTICLES,
    ("convert", "--environment"): options.ARTICLES,
    ("reduce", "--output"): options.COMPONENTS,
    ("refine", "--output"): (".toml",),
    ("promise", "--output"): (".json",),
    ("promise", "--plants"): (".json",),
    ("promise", "--figure"): options.FIGURES,
    ("outcome", "--output"): (".json",),
    ("outcome", "--figure"): options.FIGURES,
    ("generate", "--output"): (".mdk", ".json", ".c", ".h"),
    ("gate", "--output"): (".json",),
    ("gate", "--blacklist"): (".json",),
    ("gate", "--log"): (".jsonl",),
}
ENDINGS = (
    ".json",
    ".jsonl",
    ".mat",
    ".c",
    ".svg",
    ".png",
    ".pdf",
    ".html",
    ".vtu",
    ".csv",
    ".npz",
    ".h5",
    ".uff",
    ".txt",
    ".toml",
    "",
)


def test_every_option_that_writes_is_in_the_table() -> None:
    writers = {
        (verb, option.opts[-1])
        for verb in VERBS
        for option in command(verb).params
        if isinstance(option, click.Option) and option.name and option.name.endswith(("_file", "target"))
        if option.name != "model_file" or verb != "excite"  # that one is read
    }
    assert writers == set(WRITES)
    assert set(options.RECORDS) == set(SUFFIXES) - {".npy", ".mdr"}  # those are only read


@pytest.mark.parametrize(("verb", "name"), WRITES)
def test_an_ending_is_written_or_refused_at_once(
    tmp_path: Path, capfd: Capture, verb: str, name: str
) -> None:
    """Whatever is refused is refused before the missing article or record is noticed."""
    first = {"excite": ("multisine", "--rate", 64), "outcome": (tmp_path / "missing.json", "missing.toml")}
    first = first.get(verb, (tmp_path / "missing.npz",))
    for ending in ENDINGS:
        target, known = tmp_path / f"result{ending}", WRITES[verb, name]
        ended = middeck(capfd, verb, *first, name, target)
        assert ended.code in (2, 4), ending
        refused = "no writer for" in ended.err or "no ending says what to write" in ended.err
        assert refused is (ending not in known), ending
        if refused:
            assert all(k in ended.err for k in known), ending
        assert not target.exists(), ending


def test_a_folder_and_capitals_as_targets(tmp_path: Path, capfd: Capture) -> None:
    ended = middeck(capfd, "design", "a.npz", "-o", tmp_path)
    assert "is a folder, not a file" in ended.err
    ended = middeck(capfd, "design", "a.npz", "-o", tmp_path / "LAW.JSON")
    assert "no such file" in ended.err
    ended = middeck(capfd, "study", "mace-1993", "-o", tmp_path / "page.html")
    assert ended.code == 2
    assert "fills a folder" in ended.err
    ended = middeck(capfd, "record", "a.npz", "--stream", "-o", tmp_path / "b.uff")
    assert ".h5, .hdf5, .csv" in ended.err


def test_a_law_is_written_as_its_ending_says_and_read_back(tmp_path: Path, capfd: Capture) -> None:
    design = ("design", ARTICLE, "--count", 12, "--control", "pri_rel_z", "--measure", "pri_in_z")
    for name in ("law.json", "law.mat"):
        ended = middeck(capfd, *design, "-o", tmp_path / name)
        assert ended.code == 0, ended
    as_json = json.loads((tmp_path / "law.json").read_text())
    as_mat = scipy.io.loadmat(tmp_path / "law.mat")
    # Designed anew for each file: equal to rounding, not to the bit.
    np.testing.assert_allclose(as_mat["A"], as_json["A"], rtol=1e-9, atol=1e-12)
    assert str(as_mat["Kind"][0]) == "compensator"
    rows = [
        json.loads(middeck(capfd, "qualify", tmp_path / name, ARTICLE, "--count", 12, "--json").out)["rows"]
        for name in ("law.json", "law.mat")
    ]
    assert rows[0][0]["gain_db"] == pytest.approx(rows[1][0]["gain_db"], rel=1e-6)
    scipy.io.savemat(tmp_path / "bare.mat", {k: np.ones((1, 1)) for k in "ABCD"} | {"Ts": 0.0})
    ended = middeck(capfd, "qualify", tmp_path / "bare.mat", ARTICLE)
    assert ended.code == 4
    assert "nothing says that it is a compensator" in ended.err


def shaken() -> Record:
    """An oscillator behind a delay of two samples."""
    u = np.random.default_rng(5).standard_normal((1, 1, 256, 1))
    f = np.fft.rfftfreq(256, 1.0 / 64.0)[:, None]
    H = np.exp(-2j * np.pi * f / 32.0) / (1.0 - (f / 6.0) ** 2 + 0.1j * f / 6.0)
    y = np.fft.irfft(np.fft.rfft(u, axis=2) * H, axis=2)
    return Record(
        sample_hz=64.0,
        u=u,
        y=y,
        inputs=(Port("torque", "N m"),),
        outputs=(Port("angle", "rad"),),
        periodic=True,
    )


def test_a_fit_is_written_as_its_ending_says(tmp_path: Path, capfd: Capture) -> None:
    write_record(tmp_path / "r.npz", shaken())
    fit = ("identify", tmp_path / "r.npz", "--states", 2, "--continuous", "--delay", "output")
    for name in ("model.json", "model.mat"):
        assert middeck(capfd, *fit, "-o", tmp_path / name).code == 0
    model = load_model(tmp_path / "model.json")
    found = scipy.io.loadmat(tmp_path / "model.mat")
    poles = np.linalg.eigvals(found["A"])
    assert np.max(poles.imag) == pytest.approx(model.poles[0].imag, rel=1e-6)
    delays = split_delays(model.delay_s[:, None]).output_s
    assert found["OutputDelay"].ravel() == pytest.approx(delays, rel=1e-6)
    back = load_mat(tmp_path / "model.mat")
    assert isinstance(back, Plant)
    assert back.delay_s.ravel() == pytest.approx(model.delay_s, rel=1e-6)


@pytest.mark.parametrize("ending", [e for e in options.RECORDS if e not in (".unv", ".uf", ".58", ".hdf5")])
def test_a_record_is_written_as_its_ending_says(tmp_path: Path, capfd: Capture, ending: str) -> None:
    write_record(tmp_path / "r.npz", shaken())
    ended = middeck(capfd, "record", tmp_path / "r.npz", "-o", tmp_path / f"again{ending}")
    assert ended.code == 0, ended
    np.testing.assert_allclose(load_record(tmp_path / f"again{ending}").y, shaken().y, rtol=1e-12)
