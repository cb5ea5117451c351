"""Universal files that were cut between two data sets, or in the mark that opens one."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from middeck.errors import DataError
from middeck.files.records import load_record, load_response, read_record, write_record, write_response
from middeck.files.records.uff58 import Place
from middeck.files.records.uff58_write import Header, write_58
from middeck.signals.ports import Channel, Port
from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse

PORTS = (Port("u", "N"), Port("a", "m", Channel(node="1", direction="+x")), Port("b", "m"))


def ends(data: bytes) -> list[int]:
    """Bytes at which data sets end; the second of two marks opens the next."""
    marks = [k for k in range(len(data)) if data.startswith(b"    -1\n", k)]
    return [k + 7 for k in marks[1::2]]


def functions(path: Path, outputs: tuple[int, ...]) -> bytes:
    """Time functions as of another program: an excitation and ``outputs`` by their nodes."""
    rng = np.random.default_rng(5)
    with open(path, "wb") as stream:
        for node, quantity in ((1, 13), *((node, 12) for node in outputs)):
            header = Header(
                texts=("test", "", "", "", ""),
                kind=1,
                response=Place("", node, 3),
                reference=Place("", 0, 0),
                axis=17,
                axis_unit="s",
                quantity=quantity,
                unit="N" if quantity == 13 else "m/s^2",
            )
            write_58(stream, header, 0.0, 0.01, rng.standard_normal(8), binary=False)
    return path.read_bytes()


@pytest.mark.parametrize("ascii", [True, False])
def test_our_files_of_functions_state_their_number(tmp_path: Path, ascii: bool) -> None:
    path, rng = tmp_path / "r.uff", np.random.default_rng(3)
    write_record(
        path,
        Record(
            sample_hz=4.0,
            u=rng.standard_normal((1, 1, 9, 1)),
            y=rng.standard_normal((1, 1, 9, 2)),
            inputs=PORTS[:1],
            outputs=PORTS[1:],
            periodic=False,
        ),
        ascii=ascii,
    )
    whole = path.read_bytes()
    assert load_record(path).outputs == PORTS[1:]
    path.write_bytes(whole[: ends(whole)[-2]])
    with pytest.raises(DataError, match="cut: 2 of the 3 functions that its header states"):
        load_record(path)


def test_our_files_of_responses_state_their_number(tmp_path: Path) -> None:
    path, lines = tmp_path / "r.uff", np.arange(1.0, 5.0)
    H = np.ones((4, 2, 1)) + 1j
    held = FrequencyResponse(frequency_hz=lines, H=H, inputs=PORTS[:1], outputs=PORTS[1:])
    write_response(path, held, ascii=True)
    assert dataclasses.replace(load_response(path), frequency_hz=lines) == held
    whole = path.read_bytes()
    path.write_bytes(whole[: ends(whole)[-2]])
    with pytest.raises(DataError, match="cut: 1 of the 2 functions"):
        load_response(path)


@pytest.mark.parametrize("blanks", [1, 4])
def test_a_file_that_ends_in_a_mark_is_cut(tmp_path: Path, blanks: int) -> None:
    path = tmp_path / "r.uff"
    whole = functions(path, (2, 3))
    path.write_bytes(whole + b"\n")
    assert len(load_record(path).outputs) == 2
    path.write_bytes(whole[: ends(whole)[-2] + blanks])
    with pytest.raises(DataError, match="in the midst of a mark"):
        load_record(path)


def test_trace_lines_show_nodes_without_functions(tmp_path: Path) -> None:
    path = tmp_path / "r.uff"
    trace = b"    -1\n    82\n         1         5        30\nwing\n"
    trace += "".join(f"{n:10d}" for n in (1, 2, 0, 2, 3)).encode() + b"\n    -1\n"
    path.write_bytes(trace + functions(path, (2, 3)))
    assert not [f for f in read_record(path).faults if f.kind == "truncated"]
    path.write_bytes(trace + functions(path, (2,)))
    (fault,) = (f for f in read_record(path).faults if f.kind == "truncated")
    assert "1 of the 3 nodes with places or trace lines have no function (3)" in fault.what
