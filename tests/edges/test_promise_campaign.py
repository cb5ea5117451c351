"""A promise whose draws are kept in a ledger: killed, gone on with on two processes, another plan's."""

from __future__ import annotations

import re
import shutil
import signal
import sqlite3
import subprocess
import time
from pathlib import Path

import pytest

from cli_runner import middeck, refine_once, script

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "data/virtual-survey"
BLOCKS = 3


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The sample with one compensator, draws for three blocks, few modes and a coarse mesh."""
    for name in ("refine.toml", "mace-simple-lab.json"):
        (tmp_path / name).write_bytes((FOLDER / name).read_bytes())
    text = (FOLDER / "promise.toml").read_text(encoding="utf-8")
    text = re.sub(r"draws = \d+ .*\nbounded = 1", "draws = 51\nbounded = 0", text)
    text = text.replace("log10_authority = [0.0, 3.0, 6.0]", "log10_authority = [0.0]")
    text = text.replace("modes = 20", "modes = 14")
    (tmp_path / "promise.toml").write_text(text, encoding="utf-8")
    article = (ROOT / "articles/mace-simple.toml").read_text(encoding="utf-8")
    assert "elements_per_strut = 8" in article
    coarse = article.replace("elements_per_strut = 8", "elements_per_strut = 1")
    (tmp_path / "article.toml").write_text(coarse, encoding="utf-8")
    return tmp_path


def asked(folder: Path, target: str, *more: object) -> list[object]:
    article, plan = folder / "article.toml", folder / "promise.toml"
    return ["promise", article, plan, "--date", "2026-11-23", "-o", folder / target, *more]


def kept(ledger: Path) -> list[tuple[int, str]]:
    base = sqlite3.connect(ledger)
    try:
        if not base.execute("select count(*) from sqlite_master where name = 'result'").fetchone()[0]:
            return []
        return base.execute("select case_index, body from result order by case_index").fetchall()
    finally:
        base.close()


def committed(ledger: Path, folder: Path) -> int:
    """How many results a running campaign, whose ledger nobody else may open, has committed, by a copy."""
    folder.mkdir(exist_ok=True)
    for suffix in ("", "-wal"):  # the ledger first: pages that its journal gains meanwhile are read with it
        if Path(f"{ledger}{suffix}").exists():
            shutil.copyfile(f"{ledger}{suffix}", folder / f"copy{suffix}")
    found = len(kept(folder / "copy"))
    shutil.rmtree(folder)
    return found


def test_a_killed_promise_goes_on_and_is_the_same_to_the_last_byte(
    folder: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("middeck.updating.refinement.refine.refine", refine_once)  # of this process alone
    ledger = folder / "draws.ledger"
    run = asked(folder, "killed.json", "--ledger", ledger)
    process = subprocess.Popen(script(*run), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not committed(ledger, folder / "copied"):
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    before = kept(ledger)
    assert 0 < len(before) < BLOCKS
    assert not (folder / "killed.json").exists()
    assert middeck(capfd, *asked(folder, "resumed.json", "--ledger", ledger, "--workers", 2)).code == 0
    assert set(before) <= set(kept(ledger))
    assert len(kept(ledger)) == BLOCKS
    assert middeck(capfd, *asked(folder, "alone.json")).code == 0
    assert (folder / "resumed.json").read_bytes() == (folder / "alone.json").read_bytes()
    text = (folder / "promise.toml").read_text(encoding="utf-8")
    (folder / "promise.toml").write_text(text.replace("seed = 1993", "seed = 1994"), encoding="utf-8")
    other = middeck(capfd, *asked(folder, "other.json", "--ledger", ledger))
    assert other.code == 4
    assert "another campaign's: inputs" in other.err
    assert not (folder / "other.json").exists()


def test_processes_need_a_ledger_and_a_ledger_needs_draws(folder: Path, capfd: pytest.CaptureFixture[str]):
    alone = middeck(capfd, *asked(folder, "a.json", "--workers", 2))
    assert alone.code == 2
    assert "--ledger FILE" in alone.err
    article, ledger = ROOT / "articles/mace-simple.toml", folder / "a.ledger"
    loads = middeck(capfd, "promise", article, "--load-cases", "loads.toml", "--ledger", ledger)
    assert loads.code == 2
    assert "load cases have no draws" in loads.err
