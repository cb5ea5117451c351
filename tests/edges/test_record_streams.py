"""Records longer than memory: read and converted within a limit that the record itself would break."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cli_runner import middeck
from middeck.errors import DataError
from middeck.files.records import load_record, open_record, write_record
from middeck.signals.ports import Port
from middeck.signals.record import Record, RecordStream

HZ = 1000.0
PORTS = (Port("force", "N"),), (Port("tip", "m"),)
# Two channels of doubles: 24 MB. Read whole, file, record and its checks hold several times as much.
SAMPLES = 1_500_000
ALLOWED = 16 << 20

WITHIN = """
import resource, sys
import numpy as np, h5py, csv
from middeck.files.records import load_record, open_record
from middeck.signals.record import RecordStream
path, allowed = sys.argv[1], int(sys.argv[2])
for _ in open_record(sys.argv[3]).blocks(4096):  # what is imported at first use
    pass
held = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (held + allowed, held + allowed))
total, samples = 0.0, 0
for u, y in open_record(path).blocks(4096):
    total += float((u * y).sum())
    samples += len(u)
print(samples, repr(total))
try:
    load_record(path)
except MemoryError:
    print("load_record: MemoryError")
"""


def ramp() -> tuple[np.ndarray, np.ndarray]:
    n = np.arange(SAMPLES)
    return (n % 1000) / 1000.0, (n % 7) - 3.0


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits its address space")
@pytest.mark.parametrize("suffix", [".h5", ".npz", ".uff"])
def test_a_stream_needs_less_than_its_record(tmp_path: Path, suffix: str) -> None:
    u, y = ramp()
    long, short = tmp_path / f"long{suffix}", tmp_path / f"short{suffix}"
    write_record(long, Record(HZ, u[None, None, :, None], y[None, None, :, None], *PORTS, False))
    write_record(short, Record(HZ, u[None, None, :9, None], y[None, None, :9, None], *PORTS, False))
    command = [sys.executable, "-c", WITHIN, str(long), str(ALLOWED), str(short)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    samples, total = lines[0].split()
    assert int(samples) == SAMPLES
    # Sums of a million terms of order one, in two orders: rounding of 1e-16 times their number.
    assert float(total) == pytest.approx(float(u @ y), abs=1e-6)
    assert lines[1:] == ["load_record: MemoryError"], "the limit is none"


def test_a_night_of_csv_becomes_hdf5(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(0)
    u, y = rng.standard_normal((2, 1, 1, 20_000, 1))
    record = Record(HZ, u, y, *PORTS, periodic=False)
    write_record(tmp_path / "night.csv", record)
    ended = middeck(capfd, "record", tmp_path / "night.csv", "-o", tmp_path / "night.h5", "--stream")
    assert (ended.code, ended.err) == (0, "")
    assert load_record(tmp_path / "night.h5") == record


def test_blocks_of_a_part_of_the_channels(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    u, y = rng.standard_normal((2, 1, 3, 10, 2))
    ports = (Port("a", "N"), Port("b", "N")), (Port("c", "m"), Port("d", "m"))
    write_record(tmp_path / "r.uff", Record(HZ, u, y, *ports, periodic=True))
    (tmp_path / "r.uff.toml").write_text(
        '[[channel]]\nname = "d"\nside = "output"\n[[channel]]\nname = "b"\nside = "input"\n'
    )
    stream = open_record(tmp_path / "r.uff")
    assert (stream.inputs, stream.outputs) == ((ports[0][1],), (ports[1][1],))
    assert (stream.samples, stream.period) == (30, 10)
    blocks = list(stream.blocks(7))
    assert [len(b) for b, _ in blocks] == [7, 7, 7, 7, 2]
    assert np.array_equal(np.concatenate([b for b, _ in blocks])[:, 0], u[0, :, :, 1].ravel())
    assert np.array_equal(np.concatenate([c for _, c in blocks])[:, 0], y[0, :, :, 1].ravel())


def test_an_experiment_that_is_not_there(tmp_path: Path) -> None:
    write_record(tmp_path / "r.h5", Record(HZ, *np.ones((2, 1, 1, 9, 1)), *PORTS, False))
    with pytest.raises(DataError, match="no experiment 1") as caught:
        next(open_record(tmp_path / "r.h5").blocks(4, experiment=1))
    assert "counted from 0, there are 1" in caught.value.hint


def test_a_stream_that_ends_early_says_so() -> None:
    stream = RecordStream(HZ, *PORTS, 10, 1, None, lambda e, n: iter([(np.ones((4, 1)), np.ones((4, 1)))]))
    with pytest.raises(DataError, match="truncated: 4 of 10 samples"):
        list(stream.blocks(3))
