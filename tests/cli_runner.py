"""Run the command line, in this process or as its own."""

from __future__ import annotations

import functools
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from coarse_articles import coarse, scratch
from middeck.cli.main import execute
from middeck.cli.work.fit_records import identify
from middeck.control.analysis.margins.margins import measure_margins
from middeck.identification.faults.detect import detect_faults
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.updating.candidates.refinement_after_one_test import foresee
from middeck.updating.orbit.predicted_frequencies import predict_at, solve_there
from middeck.updating.promise.promise import promise
from middeck.updating.refinement.refine import refine
from repeats import LONG
from shared_results import once

ROOT = Path(__file__).parents[1]
FITTED: dict[str, Any] = {}
# The hammer test of a page at half of its rate, with blows as soft.
HALF_RATE = [("250.0, 10000", "125.0, 5000"), ("f / 90.0", "f / 45.0"), ("f / 60.0", "f / 22.5")]
# Fewer draws, and no bound, which tests of promises compute.
QUICK_PROMISE = [("draws = 24 ", "draws = 4 "), ("bounded = 1", "bounded = 0")]


class Ended(NamedTuple):
    code: int
    out: str
    err: str


def middeck(capfd: pytest.CaptureFixture[str], *arguments: object) -> Ended:
    """``middeck ARGUMENTS`` in this process."""
    code = execute([str(a) for a in arguments], lambda: False)
    return Ended(code, *capfd.readouterr())


def identify_once(*asked: Any) -> Any:
    """For `middeck.cli.work.fit_records.identify`: what examples of many verbs ask alike is fitted once."""
    if not all(Path(file).is_file() for file in asked[0]):
        return identify(*asked)
    given = [hashlib.sha256(Path(file).read_bytes()).hexdigest() for file in asked[0]]
    known = str((given, *asked[:3]))
    if known not in FITTED:
        FITTED[known] = identify(*asked)
    return FITTED[known]


refine_once, promise_once, detect_faults_once = once(refine), once(promise), once(detect_faults)
foresee_once, solve_there_once, predict_at_once = once(foresee), once(solve_there), once(predict_at)
at_rest_once, modes_once = once(solve_equilibrium), once(solve_modes)
margins_once = once(measure_margins)


def share_results(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let verbs compute once what several examples ask alike: modes, faults, fits, margins, promises ..."""
    for place in ("middeck", "middeck.cli.given.typed_article"):
        monkeypatch.setattr(f"{place}.solve_equilibrium", at_rest_once)
        monkeypatch.setattr(f"{place}.solve_modes", modes_once)
    for module in ("realtime.gate.steps_without_rig", "control.qualification"):
        monkeypatch.setattr(f"middeck.{module}.measure_margins", margins_once)
    monkeypatch.setattr("middeck.cli.work.fit_records.identify", identify_once)
    monkeypatch.setattr("middeck.cli.work.fit_records.detect_faults", detect_faults_once)
    monkeypatch.setattr("middeck.identification.faults.detect.detect_faults", detect_faults_once)
    monkeypatch.setattr("middeck.updating.refinement.refine.refine", refine_once)
    monkeypatch.setattr("middeck.updating.promise.promise.promise", promise_once)
    monkeypatch.setattr("middeck.updating.candidates.rank_tests.foresee", foresee_once)
    monkeypatch.setattr("middeck.updating.candidates.rank_tests.solve_there", solve_there_once)
    monkeypatch.setattr("middeck.updating.candidates.rank_tests.predict_at", predict_at_once)


@functools.cache
def mirror_records() -> Path:
    """A folder with the records of the steering mirror, of three experiments each."""
    made = Path(tempfile.mkdtemp(dir=scratch()))
    for path in (ROOT / "data/cubespec-fsm").glob("*.npz"):
        with np.load(path, allow_pickle=False) as whole:
            np.savez(made / path.name, **{k: whole[k][:3] if k in ("u", "y") else whole[k] for k in whole})
    return made


def link_documents(folder: Path) -> None:
    """Let ``folder`` hold the project's documents and data; `make test` promises by fewer draws.

    And takes a coarse mesh and half of the mirror's record.
    """
    for name in ("environments", "studies"):
        (folder / name).symlink_to(ROOT / name)
    (folder / "articles").mkdir()
    for path in (ROOT / "articles").iterdir():
        quick = not LONG and path.stem in ("mace-dm", "mace-simple")
        (folder / "articles" / path.name).symlink_to(coarse(path.stem) if quick else path)
    (folder / "data").mkdir()
    for path in (ROOT / "data").iterdir():
        if path.name == "cubespec-fsm" and not LONG:
            (folder / "data" / path.name).symlink_to(mirror_records())
        elif path.name != "virtual-survey":
            (folder / "data" / path.name).symlink_to(path)
    survey = shutil.copytree(ROOT / "data/virtual-survey", folder / "data/virtual-survey")
    text = (survey / "promise.toml").read_text(encoding="utf-8")
    for whole, quick in () if LONG else QUICK_PROMISE:
        assert whole in text
        text = text.replace(whole, quick)
    (survey / "promise.toml").write_text(text)


def script(*arguments: object) -> list[str]:
    """The command that the installed script runs."""
    return [sys.executable, "-c", "from middeck.cli.main import run; run()", *map(str, arguments)]


def as_process(*arguments: object, cwd: Path = ROOT, **variables: str) -> Ended:
    """``middeck ARGUMENTS`` as a process of its own, not on a terminal."""
    done = subprocess.run(
        script(*arguments),
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, **variables},
        timeout=120,
    )
    return Ended(done.returncode, done.stdout, done.stderr)
