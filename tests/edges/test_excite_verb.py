"""``middeck excite``: what it prints, what it writes, what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from middeck.cli.verbs.excite import verb
from middeck.errors import ConfigError
from middeck.files.measured.models import write_model
from middeck.identification.model.plant_model import model_of_plant
from middeck.identification.uncertainty.accuracy import expected_accuracy
from middeck.signals.excitation.limits import Limits
from middeck.signals.excitation.multisine import design_multisine
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.modal_system import ModalSystem

MULTISINE = ("multisine", "--band", "0.5,30", "--period", "8", "--rate", "128")


def run(*arguments: object) -> str:
    ended = CliRunner().invoke(
        verb, [str(a) for a in arguments], catch_exceptions=False, standalone_mode=False
    )
    assert ended.exit_code == 0
    return ended.stdout


def document(*arguments: object) -> dict[str, Any]:
    found = json.loads(run(*arguments, "--json"), parse_constant=lambda text: pytest.fail(f"{text}: no JSON"))
    assert found["schema"] == "middeck.excite/1"
    return found


def test_the_document_says_what_was_designed():
    made = design_multisine(
        (0.5, 30.0), 8.0, 128.0, Limits(peak=2.0), np.random.default_rng(3), inputs=2, phases="compact"
    )
    found = document(
        *MULTISINE, "--peak", 2, "--inputs", 2, "--seed", 3, "--phases", "compact", "--periods", 3
    )
    assert found["crest_factor"] == made.crest_factor.tolist()
    assert (found["experiments"], found["samples"], found["lines"]) == (2, 1024, len(made.lines))
    assert found["duration_s"] == 48.0
    assert found["what"] == made.what
    assert document(*MULTISINE, "--rms", 1, "--set", "period_s=16")["samples"] == 2048


@pytest.mark.parametrize(
    ("kind", "more"),
    [
        ("sweep", ["--law", "logarithmic"]), ("noise", []), ("burst", []), ("binary", []),
        ("mls", ["--order", "8"]),
    ],
)  # fmt: skip
def test_every_kind_is_designed(kind, more):
    where = [] if kind == "mls" else ["--band", "1,30", "--period", "8"]
    found = document(kind, *where, "--rate", 128, "--peak", 0.5, *more)
    assert found["peak"] == pytest.approx([0.5])
    assert found["what"] in run(kind, *where, "--rate", 128, "--peak", 0.5, *more)


def test_commands_are_written_and_read_back_exactly(tmp_path: Path):
    made = design_multisine((0.5, 30.0), 8.0, 128.0, Limits(rms=0.1), np.random.default_rng(0), inputs=2)
    common = [*MULTISINE, "--rms", 0.1, "--inputs", 2, "--periods", 2, "--name", "gimbal,wheel"]
    found = document(*common, "-o", tmp_path / "torque.csv")
    names = [tmp_path / "torque-1.csv", tmp_path / "torque-2.csv"]
    assert found["files"] == [str(n) for n in names]
    for e, name in enumerate(names):
        assert name.read_text().splitlines()[0] == "time [s],u:gimbal [N m],u:wheel [N m]"
        table = np.loadtxt(name, delimiter=",", skiprows=1)
        np.testing.assert_array_equal(table[:, 1:], np.tile(made.u[e], (2, 1)))
        np.testing.assert_array_equal(table[:, 0], np.arange(2048) / 128.0)
    document(*common, "-o", tmp_path / "torque.npz")
    with np.load(tmp_path / "torque.npz") as archive:
        np.testing.assert_array_equal(archive["u"], np.repeat(made.u[:, None], 2, axis=1))
        assert archive["input_names"].tolist() == ["gimbal", "wheel"]


def test_the_accuracy_of_a_test_is_printed(tmp_path: Path):
    mode = ModalSystem(
        omega=[2.0 * np.pi * 5.0], zeta=[0.01], psi=[[1.0]], phi=[[1.0]], phi_rate=[[0.0]], names=("bounce",)
    )
    model = model_of_plant(
        Plant(dynamics=mode, inputs=(Port("torque", "N m"),), outputs=(Port("payload", "rad"),)), delay_s=0.01
    )
    write_model(tmp_path / "model.json", model)
    wanted = ["--rms", 1, "--model", tmp_path / "model.json", "--noise", "1e-3", "--periods", 4]
    found = document(*MULTISINE, *wanted)["expected"]
    made = design_multisine((0.5, 30.0), 8.0, 128.0, Limits(rms=1.0), np.random.default_rng(0))
    expected = expected_accuracy(model, made, 1e-3, periods=4)
    # The model passes through decimals of full precision.
    assert found["damping_std"] == pytest.approx(expected.uncertainty.damping.tolist(), rel=1e-9)
    assert found["error"] == pytest.approx({"payload": expected.error[0]}, rel=1e-9)
    assert "expected of a fit" in run(*MULTISINE, *wanted)


def test_units_and_files_are_reported(tmp_path: Path):
    message = run(*MULTISINE, "--rms", 1, "--unit", "V", "--name", "a", "-o", tmp_path / "a.csv")
    assert all(word in message for word in ("rms [V]", "slew [V/s]", f"wrote {tmp_path / 'a.csv'}"))
    names = ["--inputs", 2, "--name", "a", "--name", "b", "-o", tmp_path / "b.npz"]
    assert "wrote" in run(*MULTISINE, "--rms", 1, *names)
    with np.load(tmp_path / "b.npz") as archive:
        assert archive["input_names"].tolist() == ["a", "b"]
    with pytest.raises(ConfigError, match=r"1 names for 2 inputs(.|\n)*--name a,b"):
        run(*MULTISINE, "--rms", 1, "--inputs", 2, "--name", "a", "-o", tmp_path / "c.npz")


def test_an_article_is_no_measurement_model(tmp_path: Path):
    article = tmp_path / "article.toml"
    article.write_text("[article]\n")
    with pytest.raises(ConfigError, match=r"no measurement model(.|\n)*identify -o"):
        run(*MULTISINE, "--rms", 1, "--model", article, "--noise", 1)


@pytest.mark.parametrize(
    "arguments",
    [
        (*MULTISINE,),  # no limit
        ("multisine", "--rate", 128, "--rms", 1),  # no band
        ("mls", "--rate", 128, "--rms", 1),  # no order
        (*MULTISINE, "--rms", 1, "--noise", "1"),  # noise of no model
        (*MULTISINE, "--rms", 1, "--periods", 0),
        (*MULTISINE, "--rms", -1),
        (*MULTISINE, "--rms", 1, "--set", "rate=5"),
        (*MULTISINE, "--rms", 1, "--name", "a,b", "-o", "x.npz"),
        (*MULTISINE, "--rms", 1, "-o", "x.txt"),
    ],
)
def test_what_makes_no_signal_is_refused(arguments, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError):
        run(*arguments)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("kind", "given", "message"),
    [
        ("mls", ("--order", 7, "--band", "1,9"), "mls: --band is for multisine, sweep, noise, burst, binary"),
        ("mls", ("--order", 7, "--period", 4), "--period is for multisine"),
        ("sweep", ("--band", "1,9", "--period", 4, "--grid", "odd"), "sweep: --grid is for multisine"),
        ("sweep", ("--band", "1,9", "--period", 4, "--realisations", 3), "--realisations is for multisine"),
        ("multisine", ("--band", "1,9", "--period", 4, "--law", "logarithmic"), "--law is for sweep"),
        ("noise", ("--band", "1,9", "--period", 4, "--set", "order=4"), "noise: --order is for mls"),
    ],
)
def test_what_another_kind_of_signal_has_is_not_ignored(
    kind: str, given: tuple[str | int, ...], message: str
):
    with pytest.raises(ConfigError, match=message):
        run(kind, "--rate", 100, "--peak", 1, *given)


def test_help_of_a_verb_that_is_called_by_itself():
    """The same as by way of `middeck`: click keeps what it made first, and the page of verbs hung on it."""
    assert "-h, --help" in CliRunner().invoke(verb, ["-h"]).output


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("--period", -3, "--rms", 1), r"--period = -3\.0"),
        (("--period", 8, "--rms", -1), r"--rms = -1\.0"),
        (("--period", 8, "--rms", 1, "--set", "rms=-1"), r"^--set rms: rms = -1"),
    ],
)
def test_a_number_out_of_range_is_named_as_it_was_typed(given: tuple[str | int, ...], message: str):
    with pytest.raises(ConfigError, match=message + ": must be > 0"):
        run("multisine", "--band", "1,30", "--rate", 128, *given)
