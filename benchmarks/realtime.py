"""Controller packages: bits, steps beside NumPy, single precision, small processors; the engine.

    python benchmarks/realtime.py [--only CASES] [--made DATE] [--ledgers FOLDER] [--workers N]

The case "guards" takes hours, "truth" an hour, "gated" and "slow" ten minutes: with a folder they keep each
outcome there, and go on where they were cut off; a folder holds for one state of the code. Needs a C
compiler; the case "small" also arm-none-eabi-gcc and qemu-system-arm (packages of Debian).
Each case is a module of the folder packaged, with a function rows(options). Times are medians.
"""

from __future__ import annotations

import functools
import importlib
import sys
from pathlib import Path
from typing import Any

from measured.result_file import options_of, write_rows

# The harness of compiled laws and of emulated processors is that of the tests.
sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "tests" / sub) for sub in ("", "cross")]
CASES = (
    "step", "bits", "single", "small", "fuzz", "beam", "engine", "lockstep", "guards", "slow", "gated",
    "truth",
)  # fmt: skip


def _case(name: str, options: Any) -> Any:
    return importlib.import_module(f"packaged.{name}").rows(options)


def main() -> None:
    cases = {name: functools.partial(_case, name) for name in CASES}
    write_rows("realtime", "python benchmarks/realtime.py", cases, options_of(__doc__, cases).parse_args())


if __name__ == "__main__":
    main()
