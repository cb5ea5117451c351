"""Damaged OUTPUT4 files: an error that says where, or what one number more or less makes of a matrix."""

import random

import numpy as np
import pytest
import scipy.sparse as sp

from cpu_limit import cpu_limit
from middeck.errors import DataError
from middeck.files.nastran.output4.matrices import Op4Matrix, op4_by_name, read_op4
from op4_writer import write_op4

FORMS = [
    (layout, text, order)
    for layout in ("dense", "bigmat", "nonbigmat")
    for text, order in ((0, "<"), (0, ">"), (1, "<"))
]


def _matrices():
    rng = np.random.default_rng(0)
    A, R = rng.normal(size=(9, 9)), rng.normal(size=(7, 4))
    A, R[2], R[:, 1] = A @ A.T, 0.0, 0.0
    A[3:5], A[:, 3:5] = 0.0, 0.0
    parts = (("KXX", 6, A), ("R", 2, R), ("C", 2, R + 1j * R[::-1]))
    return [Op4Matrix(name, form, sp.csc_array(value)) for name, form, value in parts]


def _damaged(rng, content, text):
    """Characters or bits replaced, bytes taken out or put in, or the end cut off; how many were replaced."""
    out, kind, times = bytearray(content), rng.randrange(4), rng.randint(1, 3)
    if kind == 3 and rng.random() < 0.5:
        return bytes(out[: rng.randrange(len(out))]), 0
    for _ in range(times):
        at = rng.randrange(len(out))
        if kind == 0:
            out[at] = rng.choice(b"0123456789 +-.EDA\n") if text else rng.randrange(256)
        elif kind == 1:
            del out[at : at + rng.randint(1, 9)]
        elif kind == 2:
            out[at:at] = bytes(rng.choice(b"0123456789 +-.E\n") for _ in range(rng.randint(1, 5)))
        else:
            out[at] ^= 1 << rng.randrange(8)
    return bytes(out), times if kind in (0, 3) else 0


def test_damage_is_refused_or_stays_where_it_was_done(tmp_path, campaign):
    was, path = _matrices(), tmp_path / "a.op4"
    refused = 0
    seeds = campaign(2400)
    for layout, text, order in FORMS:
        write_op4(path, was, layout=layout, text=bool(text), byte_order=order)
        content, good = path.read_bytes(), read_op4(path)
        for seed in seeds:
            damaged, replaced = _damaged(random.Random(seed), content, text)
            path.unlink()  # to write over a file takes longer than to read it, on some disks
            path.write_bytes(damaged)
            try:
                with cpu_limit(5.0):  # it takes a millisecond
                    found = read_op4(path)
            except DataError as error:
                refused += str(path) in error.where
                continue
            for new, old in zip(found, good, strict=False):
                # A number of rows stands nowhere twice; who reads the matrix knows it.
                if new.value.shape != old.value.shape:
                    assert replaced
                    assert (new.form, new.value.shape[1]) == (2, old.value.shape[1])
                    continue
                apart = (new.value != old.value).toarray()
                assert (
                    np.count_nonzero(apart.any(axis=0)) <= 2 * replaced
                )  # a column, or two that it moved between
    assert refused > 0.6 * len(seeds) * len(FORMS)


@pytest.mark.parametrize(
    ("at", "new", "message"),
    [
        (4, b"\x00\x00\x00\x09", "0 columns|9 columns|no matrix's|150994944 columns|column"),
        (0, b"\x19\x00\x00\x00", "no header in either byte order"),
        (24 + 4, b"\x19\x00\x00\x00", "a record of 24 bytes that ends as one of 25"),
    ],
)
def test_headers(tmp_path, at, new, message):
    write_op4(tmp_path / "a.op4", _matrices())
    content = bytearray((tmp_path / "a.op4").read_bytes())
    content[at : at + 4] = new
    (tmp_path / "a.op4").write_bytes(bytes(content))
    with pytest.raises(DataError, match=message):
        read_op4(tmp_path / "a.op4")


def test_what_a_file_says_twice_must_agree(tmp_path):
    K = sp.csc_array(np.array([[2.0, 1.0], [1.5, 2.0]]))
    write_op4(tmp_path / "a.op4", [Op4Matrix("KXX", 6, K)])
    with pytest.raises(
        DataError, match=r"stated as symmetric \(form 6\), but \(2, 1\) is 1.5 and its mirror 1"
    ):
        read_op4(tmp_path / "a.op4")
    write_op4(tmp_path / "b.op4", [Op4Matrix("K", 2, K), Op4Matrix("k", 2, K)])
    with pytest.raises(DataError, match="two matrices 'K'"):
        op4_by_name(tmp_path / "b.op4")
    (tmp_path / "c.op4").write_text("")
    with pytest.raises(DataError, match="no matrix"):
        read_op4(tmp_path / "c.op4")
    with pytest.raises(DataError, match="cannot be read"):
        read_op4(tmp_path / "none.op4")
