#!/usr/bin/env python3
"""Compare the numbers.json of one study made on several machines, or with several kernels of OpenBLAS.

    python3 .ci/compare_numbers.py haswell/numbers.json prescott/numbers.json [more ...]

Verdicts, names, kinds, counts and what is null must be the same; numbers agree to the digits that the report
states of their kind (`KINDS`), or to a tenth of the deviation stated beside them. A number whose deviation is
null is not determined by the data, and may be anything. Prints a table of all that differs, the worst first,
and exits with 1 if there is any.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

# Of the first kind whose name matches the end of a key: relative difference allowed, absolute one, and a
# share of the largest number in the same list.
KINDS = (
    (r"claimed_db", 0.0, 0.05, 0.0),  # claims in decibels, of loops on the rig too: 0.6 % of a magnitude
    (r"residual|quadrature_error", 0.0, 1e-9, 0.0),  # of solvers: how much is rounding
    (r"_deviation(_hz|_s)?", 0.05, 0.0, 0.0),  # two digits
    (r"(^|_)db", 0.0, 0.005, 0.0),  # two decimals
    (r"re|im|matrix|mac|subspace_angle_deg|strain_share", 1e-4, 0.0, 1e-4),  # curves, as far as they are seen
    (r"", 1e-4, 0.0, 0.0),  # four digits
)
# What is measured on the simulated rig: its friction carries last digits on, from sample to sample.
MEASURED, CARRIED_ON = re.compile(r"^\.figure_(9b|1[12])\b"), 3e-3
DEVIATION = {
    "natural_hz": "natural_hz_deviation",
    "damping": "damping_deviation",
    "frequency_hz": "frequency_deviation_hz",
    "delay_s": "delay_deviation_s",
}
OF_DEVIATION = 0.1
SHOWN = 40
NUMBER = re.compile(r"[-\u2212+]?\d+(\.\d+)?([eE][-+]?\d+)?")


class Difference(NamedTuple):
    """Where two documents differ, by how many times what is allowed, and what each has."""

    times: float
    where: str
    first: Any
    other: Any


def differences(first: Any, other: Any) -> list[Difference]:
    """All of two documents, the worst first."""
    return sorted(_compare(first, other, "", "", 0.0, None), key=lambda d: -d.times)


def _compare(a: Any, b: Any, where: str, key: str, largest: float, deviation: Any) -> Iterator[Difference]:
    if isinstance(a, dict) and isinstance(b, dict):
        for k in [*a, *(k for k in b if k not in a)]:
            if k not in a or k not in b:
                yield Difference(math.inf, f"{where}.{k}", a.get(k, "missing"), b.get(k, "missing"))
            else:
                beside = a.get(DEVIATION.get(k, ""), math.nan)
                kind = "claimed_db" if (k, a.get("unit")) == ("number", "dB") else k
                yield from _compare(a[k], b[k], f"{where}.{k}", kind, 0.0, beside)
    elif isinstance(a, list) and isinstance(b, list):
        if len(a) != len(b):
            yield Difference(math.inf, where, f"{len(a)} entries", f"{len(b)} entries")
            return
        most = max((abs(x) for x in a if is_number(x)), default=largest)
        each = deviation if isinstance(deviation, list) and len(deviation) == len(a) else [math.nan] * len(a)
        for k, (x, y, d) in enumerate(zip(a, b, each, strict=True)):
            yield from _compare(x, y, f"{where}[{k}]", key, most, d)
    elif is_number(a) and is_number(b):
        of_rig = MEASURED.search(where) is not None
        if deviation is not None and (times := _times(a, b, key, largest, deviation, of_rig)) > 1.0:
            yield Difference(times, where, a, b)
    elif _words(a) != _words(b):
        yield Difference(math.inf, where, a, b)


def is_number(value: Any) -> bool:
    """Whether it is one; a truth value is a verdict."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _times(a: float, b: float, key: str, largest: float, deviation: float, of_rig: bool) -> float:
    """Difference over what is allowed."""
    relative, absolute, share = next(rest for name, *rest in KINDS if re.search(rf"(?:{name})$", key))
    if of_rig:
        relative, share = max(relative, CARRIED_ON), max(share, CARRIED_ON)
    allowed = max(relative * max(abs(a), abs(b)), absolute, share * largest)
    if is_number(deviation) and not math.isnan(deviation):
        allowed = max(allowed, OF_DEVIATION * deviation)
    return 0.0 if a == b else abs(a - b) / allowed if allowed else math.inf


def _words(value: Any) -> Any:
    """A text without its numbers, which are compared where they stand alone."""
    return NUMBER.sub("#", value) if isinstance(value, str) else value


def main(files: list[str]) -> int:
    """0 where all documents agree."""
    if len(files) < 2:
        print(__doc__)
        return 2
    documents = [json.loads(Path(file).read_text(encoding="utf-8")) for file in files]
    wrong = 0
    for file, other in zip(files[1:], documents[1:], strict=True):
        found = differences(documents[0].get("figures"), other.get("figures"))
        wrong += len(found)
        print(f"{files[0]} and {file}: {len(found) or 'no'} differences beyond the digits stated")
        for d in found[:SHOWN]:
            times = "other" if math.isinf(d.times) else f"{d.times:.1f} x"
            print(f"  {times:>10}  {d.where.lstrip('.'):<60} {d.first!s:>24.40} {d.other!s:>24.40}")
        if len(found) > SHOWN:
            print(f"  and {len(found) - SHOWN} more")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
