"""What is written is read again, in every kind of file, whole and in pieces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from middeck.files.records import load_record, open_record, write_record, write_stream
from middeck.signals.ports import Channel, Port
from middeck.signals.record import Record, stream_record

FINITE = st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False)
# What every kind of file can say; names in letters and digits, as a CSV heading has brackets of its own.
NAMES = st.text(st.characters(categories=["L", "N"], exclude_characters="\N{NULL}"), min_size=1, max_size=4)
CHANNELS = st.none() | st.builds(
    Channel,
    node=st.sampled_from(["12", "bus", ""]),
    direction=st.sampled_from(["+x", "-z", "+ry", ""]),
    role=st.sampled_from(["sensor", "actuator", ""]),
    gain=st.none() | st.floats(1e-6, 1e6),
    raw_unit=st.sampled_from(["V", "N m", ""]),
    calibrated=st.sampled_from(["2026-01-31", ""]),
).map(lambda c: None if c == Channel() else c)
UNITS = st.sampled_from(["N m", "rad", "rad/s", "V", "m/s^2", ""])


@st.composite
def records(draw: st.DrawFn, experiments: int = 3) -> Record:
    e, p, n, i, o = (draw(st.integers(1, most)) for most in (experiments, 3, 4, 3, 3))
    ports = [
        tuple(Port(name, draw(UNITS), draw(CHANNELS)) for name in names)
        for names in (draw(st.lists(NAMES, min_size=k, max_size=k, unique=True)) for k in (i, o))
    ]  # fmt: skip
    periodic = draw(st.booleans())
    shape = (e, p if periodic else 1, n + 1)
    u = draw(arrays(float, (*shape, i), elements=FINITE))
    y = draw(arrays(float, (*shape, o), elements=FINITE))
    return Record(
        sample_hz=draw(st.sampled_from([1.0, 6000.0, 1024.0, 1e3 / 3.0])),
        u=u,
        y=y,
        inputs=ports[0],
        outputs=ports[1],
        periodic=periodic,
    )


def streamed(path: Path, record: Record, size: int) -> None:
    """The blocks of the file are those of the record."""
    stream, held = open_record(path), stream_record(record)
    for e in range(held.experiments):
        for (u, y), (u0, y0) in zip(stream.blocks(size, e), held.blocks(size, e), strict=True):
            assert np.array_equal(u, u0)
            assert np.array_equal(y, y0)
    assert (stream.samples, stream.period, stream.experiments) == (
        held.samples,
        held.period,
        held.experiments,
    )
    assert (stream.inputs, stream.outputs) == (held.inputs, held.outputs)


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat", ".uff"])
@given(record=records(), size=st.integers(1, 7))
def test_every_bit_comes_back(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, record: Record, size: int
) -> None:
    path = tmp_path_factory.mktemp("records") / f"r{suffix}"
    write_record(path, record)
    assert load_record(path) == record
    assert [p.name for p in path.parent.iterdir()] == [path.name], "a temporary was left"
    streamed(path, record, size)


@given(record=records(experiments=1), size=st.integers(1, 7))
def test_csv_keeps_every_digit(tmp_path_factory: pytest.TempPathFactory, record: Record, size: int) -> None:
    path = tmp_path_factory.mktemp("records") / "r.csv"
    write_record(path, record)
    found = load_record(path)
    assert np.array_equal(found.u, record.u)
    assert np.array_equal(found.y, record.y)
    assert (found.inputs, found.outputs, found.periodic) == (record.inputs, record.outputs, record.periodic)
    # The rate comes from time stamps, kept to nine digits.
    assert found.sample_hz == pytest.approx(record.sample_hz, rel=1e-9)
    assert [len(u) for u, _ in open_record(path).blocks(size)] == [
        len(u) for u, _ in stream_record(found).blocks(size)
    ]


@given(record=records())
def test_ascii_universal_files_keep_thirteen_digits(
    tmp_path_factory: pytest.TempPathFactory, record: Record
) -> None:
    path = tmp_path_factory.mktemp("records") / "r.uff"
    write_record(path, record, ascii=True)
    found = load_record(path)
    # Half a unit of the thirteenth digit.
    assert np.allclose(found.u, record.u, rtol=5e-13, atol=0.0)
    assert np.allclose(found.y, record.y, rtol=5e-13, atol=0.0)
    assert (found.inputs, found.outputs, found.sample_hz) == (record.inputs, record.outputs, record.sample_hz)


@given(record=records(), size=st.integers(1, 7))
def test_a_stream_is_written_as_the_record_is(
    tmp_path_factory: pytest.TempPathFactory, record: Record, size: int
) -> None:
    path = tmp_path_factory.mktemp("records") / "r.h5"
    write_stream(path, stream_record(record))
    assert load_record(path) == record
