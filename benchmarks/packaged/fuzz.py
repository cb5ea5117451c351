"""Changed packages through both readers: under the hash that they had, and sealed again."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from engine_campaigns import CAMPAIGNS
from fuzzed_packages import accepted_by_python, build_fuzzer, python_reads, small_packages, told_by_engine
from measured.rows import row
from middeck.realtime.package.package_bytes import encode_package

CASE, PYTHON, ENGINE = "fuzz of packages", "reader in Python", "engine's reader"


def rows(options: Any) -> list[dict]:
    packages = [encode_package(package) for package in small_packages()]
    by_python = {
        seal: accepted_by_python(packages, _cases(seal, PYTHON), seal=seal) for seal in (False, True)
    }
    with tempfile.TemporaryDirectory() as folder:
        by_engine = {seal: _accepted_by_engine(packages, Path(folder), seal) for seal in (False, True)}
    unsealed = sum(_cases(False, reader) for reader in (PYTHON, ENGINE))
    others = sum(not python_reads(data) for data in by_engine[True])
    sealed = (
        f"of {_cases(True, ENGINE)}, {len(by_engine[True])} accepted as other packages; Python's"
        f" reader accepts {by_python[True]} of {_cases(True, PYTHON)}, each the one encoding of"
        " what it says; no crash"
    )
    return [
        row(CASE, "changed under their own hash, accepted", "", by_python[False] + len(by_engine[False]), 0.0,
            note=f"of {unsealed}, by Python's reader and by the engine's with sanitizers; no crash"),
        row(CASE, "sealed again, accepted by the engine's reader and not by Python's", "", others, 0.0,
            note=sealed),
    ]  # fmt: skip


def _cases(seal: bool, reader: str) -> int:
    how = "sealed again" if seal else "under their own hash"
    return CAMPAIGNS[f"changed packages {how}, the {reader}"].whole


def _accepted_by_engine(packages: list[bytes], folder: Path, seal: bool) -> list[bytes]:
    files = [folder / f"{k}.mdk" for k in range(len(packages))]
    for file, data in zip(files, packages, strict=True):
        file.write_bytes(data)
    count = _cases(seal, ENGINE)
    told = told_by_engine(build_fuzzer(), files, count, seal=seal, every=count)
    return [data for data, word in told if word == "done"]
