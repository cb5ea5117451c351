"""OUTPUT4: every form has the same matrices, and what is written comes back."""

import struct
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from middeck.errors import ConfigError, DataError
from middeck.files.nastran.output4.matrices import Op4Matrix, op4_by_name, read_op4
from op4_writer import write_op4

DATA = Path("data/nastran-op4")
LAYOUTS = ("dense", "bigmat", "nonbigmat")


@pytest.mark.parametrize(
    "path", [p for p in sorted(DATA.glob("*.op4")) if "badname" not in p.name], ids=lambda p: p.name
)
def test_each_form_has_the_matrices_of_the_mat_file(path):
    twin = scipy.io.loadmat(DATA / "r_c_rc.mat")
    digits = 5e-10 if "_ascii" in path.name else 0.0  # ten digits are printed
    digits = 5e-8 if "single" in path.name and "_i64" not in path.name else digits
    digits = 1e-14 if "nonbigmat_ascii_d" in path.name else digits  # fifteen
    for matrix, name in zip(read_op4(path), ("rmat", "cmat", "rcmat"), strict=True):
        assert matrix.name.lower().startswith(name)
        assert np.abs(matrix.value.toarray() - twin[name]).max() <= digits * np.abs(twin[name]).max()


def test_another_program_and_names_that_are_none():
    one, two = (op4_by_name(DATA / f"double_{n}.op4.other") for n in ("bigmat_ascii", "nonbigmat_be"))
    for name in ("KAA", "MAA"):
        a, b = one[name].value.toarray(), two[name].value.toarray()
        assert np.abs(a - b).max() < 1e-9 * np.abs(b).max()
    assert [m.name for m in read_op4(DATA / "double_bigmat_ascii_badname.op4")] == ["1MAT", "", "09"]


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_round_trips(tmp_path, layout, text):
    rng = np.random.default_rng(5)
    real = sp.random_array((70, 9), density=0.2, rng=rng, format="csc") * 10.0 ** rng.integers(-200, 200, 9)
    full = rng.normal(size=(6, 6))
    matrices = [
        Op4Matrix("R", 2, sp.csc_array(real)),
        Op4Matrix("KXX", 6, sp.csc_array(full + full.T)),
        Op4Matrix("CMPLX", 2, sp.csc_array(real[:, :3] / 7.0 + 1j * real[:, 4:7])),
        Op4Matrix("ZERO", 2, sp.csc_array((3, 4))),
    ]
    for order in "<>":
        write_op4(tmp_path / "a.op4", matrices, layout=layout, text=text, byte_order=order)
        for back, was in zip(read_op4(tmp_path / "a.op4"), matrices, strict=True):
            assert (*back[:2], back.value.shape) == (*was[:2], was.value.shape)
            np.testing.assert_array_equal(back.value.toarray(), was.value.toarray())  # to the last digit
    small = [matrices[1]]
    write_op4(tmp_path / "s.op4", small, layout=layout, text=text, single=True)
    np.testing.assert_allclose(read_op4(tmp_path / "s.op4")[0].value.toarray(), full + full.T, rtol=1e-7)


def test_long_integers_and_many_rows(tmp_path):
    """64-bit integers as Nastran writes them: words of eight bytes, letters of a name spread over two."""
    for order in "<>":
        records = [
            struct.pack(order + "4q", 2, -70000, 2, 2) + b"BIG     " + b" " * 8,
            struct.pack(order + "5q2d", 2, 0, 4, 3, 69999, 1.5, -2.5),
            struct.pack(order + "3qd", 3, 1, 1, 1.0),
        ]
        marked = [struct.pack(order + "i", len(r)) + r + struct.pack(order + "i", len(r)) for r in records]
        (tmp_path / "a.op4").write_bytes(b"".join(marked))
        (matrix,) = read_op4(tmp_path / "a.op4")
        found = matrix.value.tocoo()
        assert (matrix.name, found.shape) == ("BIG", (70000, 2))
        assert (found.row.tolist(), found.col.tolist(), found.data.tolist()) == (
            [69998, 69999],
            [1, 1],
            [1.5, -2.5],
        )
    with pytest.raises(ConfigError, match="70000 rows are too many"):
        write_op4(tmp_path / "b.op4", [matrix], layout="nonbigmat")
    assert not (tmp_path / "b.op4").exists()
    for text in (False, True):
        write_op4(tmp_path / "b.op4", [matrix], layout="dense", text=text)
        assert not (read_op4(tmp_path / "b.op4")[0].value - matrix.value).nnz


def test_exponents_of_three_digits_without_a_letter(tmp_path):
    text = "       1       2       2       2A       1P,2E16.9\n       1       1       2\n" + (
        " 1.234567890-105-2.345678900+101\n       2       1       1\n 1.000000000E+00\n"
    )
    (tmp_path / "a.op4").write_text(text)
    np.testing.assert_array_equal(
        read_op4(tmp_path / "a.op4")[0].value.toarray().ravel(), [1.23456789e-105, -2.3456789e101]
    )


# The bytes of pyNastran 1.4.1 for coo_matrix(...), symmetric in double, rectangular in single precision, and
# complex: columns in the order in which the entries name them, the length of a column in each of its runs.
OF_PYNASTRAN = """\
       3       3       6       2K       1P,3E23.16
       1       0       5
  327681
 1.0000000000000000E+00
  327683
-5.0000000000000000E-01
       3       0       5
  327681
-5.0000000000000000E-01
  327683
 3.0000000000000000E+00
       2       0       3
  196610
 2.0000000000000000E+00
       4       1       1
 1.0000000000000000E+00
       6       4       2       1S       1P,3E23.16
       4       0       7
  458753
-1.3031572103500366E+00
  458755
 5.9884619712829590E-01-2.7560290694236755E-01
       3       0       5
  327683
-4.8211932182312012E-01-2.0000000000000000E+00
       7       1       1
 1.0000000000000000E+00
       2       4       2       4C       1P,3E23.16
       1       0      13
  851969
-1.5000000000000000E+00-2.5000000000000000E+00
  851971
 5.0000000000000000E-01 1.0000000000000000E+00-2.7500000000000000E-01
-5.5000000000000000E-01
       3       1       1
 1.0000000000000000E+00
"""


def test_sparse_text_of_pynastran(tmp_path):
    path = tmp_path / "a.op4"
    path.write_text(OF_PYNASTRAN)
    K, S, C = (m.value.toarray() for m in read_op4(path))
    np.testing.assert_array_equal(K, [[1.0, 0.0, -0.5], [0.0, 2.0, 0.0], [-0.5, 0.0, 3.0]])
    single = np.zeros((4, 6))
    single[2:, 2], single[[0, 2, 3], 3] = (
        np.float32([-0.48211932, -2.0]),
        np.float32([-1.3031572, 0.5988462, -0.2756029]),
    )
    np.testing.assert_array_equal(S, single)
    np.testing.assert_array_equal(C.ravel(), [-1.5 - 2.5j, 0, 0, 0, 0.5 + 1j, 0, -0.275 - 0.55j, 0])
    lines = OF_PYNASTRAN.splitlines()
    for cut, warning in (
        (slice(4, 6), "1 numbers in a column of 5 words"),
        (slice(5, 6), "0 numbers for real entries"),
        (slice(4, 5), "1 numbers in a column of 5 words|characters for"),
    ):
        path.write_text("\n".join(lines[: cut.start] + lines[cut.stop :]))
        with pytest.raises(DataError, match=warning):
            read_op4(path)
    path.write_text(OF_PYNASTRAN.replace("\n       2       0       3", "\n       3       0       3"))
    with pytest.raises(DataError, match="column 3 after column 3"):
        read_op4(path)
