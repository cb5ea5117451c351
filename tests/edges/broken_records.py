"""One builder for each way in which a record file can be broken."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import scipy.io

from middeck.files.records import write_record
from middeck.signals.ports import Port
from middeck.signals.record import Record

HEADER = "time [s],u:torque [N m],y:angle [rad]\n"
Builder = Callable[[Path], Path]


def good_record(samples: int = 64, hz: float = 500.0) -> Record:
    rng = np.random.default_rng(3)
    u, y = rng.standard_normal((2, 1, samples, 1)), rng.standard_normal((2, 1, samples, 2))
    return Record(
        sample_hz=hz,
        u=u,
        y=y,
        inputs=(Port("torque", "N m"),),
        outputs=(Port("a", "rad"), Port("b", "rad/s")),
        periodic=False,
    )


def written(folder: Path, suffix: str, *, ascii: bool = False) -> Path:
    path = folder / f"r{suffix}"
    write_record(path, good_record(), ascii=ascii)
    return path


def truncated(suffix: str, keep: float, *, ascii: bool = False) -> Builder:
    def build(folder: Path) -> Path:
        path = written(folder, suffix, ascii=ascii)
        content = path.read_bytes()
        path.write_bytes(content[: int(keep * len(content))])
        return path

    return build


def text(content: str, name: str = "r.csv", encoding: str = "utf-8") -> Builder:
    def build(folder: Path) -> Path:
        (folder / name).write_text(content, encoding=encoding)
        return folder / name

    return build


def hdf5_with(**changes: object) -> Builder:
    """The HDF5 of a good record with data sets changed, or left out where None."""

    def build(folder: Path) -> Path:
        path = written(folder, ".h5")
        with h5py.File(path, "a") as archive:
            for key, value in changes.items():
                if key in archive:
                    del archive[key]
                if value is not None:
                    archive[key] = value
        return path

    return build


def hdf5_never_written(folder: Path) -> Path:
    """As a program leaves it that made room for samples and was then stopped: they would be read as zeros."""
    path = written(folder, ".h5")
    with h5py.File(path, "a") as archive:
        del archive["u"]
        archive.create_dataset("u", (2, 1, 64, 1), float, chunks=(1, 1, 64, 1))
    return path


def hdf5_bit_lost(folder: Path) -> Path:
    path = written(folder, ".h5")
    content = bytearray(path.read_bytes())
    place = content.index(good_record().u[0].tobytes())
    content[place + 100] ^= 1
    path.write_bytes(bytes(content))
    return path


def mat_with(**contents: object) -> Builder:
    def build(folder: Path) -> Path:
        scipy.io.savemat(folder / "r.mat", contents)
        return folder / "r.mat"

    return build


def uff_with(old: bytes, new: bytes, count: int = 1, *, ascii: bool = False) -> Builder:
    """A universal file with bytes replaced by as many others."""

    def build(folder: Path) -> Path:
        assert len(old) == len(new)
        path = written(folder, ".uff", ascii=ascii)
        content = path.read_bytes()
        assert old in content
        path.write_bytes(content.replace(old, new, count))
        return path

    return build


def uff_rows(change: Callable[[list[str]], list[str]]) -> Builder:
    """An ASCII universal file with its lines changed, which are counted behind its header of ten."""

    def build(folder: Path) -> Path:
        path = written(folder, ".uff", ascii=True)
        rows = path.read_text().splitlines()
        assert rows[9:11] == ["    -1", "    -1"]
        path.write_text("\n".join([*rows[:10], *change(rows[10:])]) + "\n")
        return path

    return build


def mended(row: int, old: str, new: str) -> Callable[[list[str]], list[str]]:
    """``new`` for ``old`` in one row of the first data set 58, counted from its -1."""

    def change(rows: list[str]) -> list[str]:
        assert old in rows[row], rows[row]
        return [*rows[:row], rows[row].replace(old, new, 1), *rows[row + 1 :]]

    return change


def without(row: int) -> Callable[[list[str]], list[str]]:
    return lambda rows: rows[:row] + rows[row + 1 :]


def npy_with(array: np.ndarray) -> Builder:
    def build(folder: Path) -> Path:
        np.save(folder / "r.npy", array)
        return folder / "r.npy"

    return build


def beside(content: str) -> Builder:
    """A good CSV with a file of channels beside it."""

    def build(folder: Path) -> Path:
        path = text(HEADER + "0.0,1,2\n0.1,3,5\n0.2,5,4\n")(folder)
        (folder / "r.csv.toml").write_text(content)
        return path

    return build


def flipped(suffix: str, seed: int) -> Builder:
    """A file with one byte changed at random, or its checksum lost."""

    def build(folder: Path) -> Path:
        path = written(folder, suffix)
        content = bytearray(path.read_bytes())
        rng = np.random.default_rng([zlib.crc32(suffix.encode()), seed])
        content[rng.integers(len(content))] ^= int(rng.integers(1, 256))
        path.write_bytes(bytes(content))
        return path

    return build
