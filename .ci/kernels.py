#!/usr/bin/env python3
"""The marked tests and the study under several BLAS kernels, as other processors would run them.

    python .ci/kernels.py -o out/kernels

OpenBLAS picks its kernels by processor, and their last digits differ; ``OPENBLAS_CORETYPE`` picks another
on the same machine. NumPy and SciPy carry a copy each, which name their kernel (``OPENBLAS_VERBOSE=2``).
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parents[1]
KERNELS = ("Prescott", "Haswell", "Zen", "SkylakeX")
PROBE = "import numpy, scipy.linalg; a = numpy.eye(64); a @ a; scipy.linalg.inv(a)"
COPIES = 2  # NumPy's OpenBLAS and SciPy's
# The chapter on the promise takes two thirds of the study's time; MIDDECK_LONG=1 leaves it whole.
FEWER = ("promise.draws=4", "promise.log10_authority=[0, 3]")
SHORTER = () if os.environ.get("MIDDECK_LONG") == "1" else [w for one in FEWER for w in ("--set", one)]


def environment(kernel: str | None) -> dict[str, str]:
    """That in which a process runs ``kernel``, or that of the suite before it, on one thread."""
    asked = {} if kernel is None else {"OPENBLAS_CORETYPE": kernel}
    return {**os.environ, **asked, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def running_kernel(kernel: str | None) -> str | None:
    """What both copies of OpenBLAS run when asked for ``kernel``; none where the processor cannot run it.

    Asked for none, they run what the suite ran: the processor's own, or what ``OPENBLAS_CORETYPE`` asks for.
    """
    probe = subprocess.run(
        [sys.executable, "-c", PROBE],
        env={**environment(kernel), "OPENBLAS_VERBOSE": "2"},
        capture_output=True,
        text=True,
    )
    said = probe.stdout + probe.stderr
    found = re.findall(r"^Core: (\w+)$", said, re.MULTILINE)
    if probe.returncode != 0 or "not found" in said.lower():
        return None
    if len(found) != COPIES or len(set(found)) != 1:
        raise SystemExit(f"{kernel}: NumPy and SciPy run {found or 'kernels that they do not name'}")
    return found[0]


def distinct_kernels() -> dict[str, str]:
    """The names that this processor runs, one for each core; prints what becomes of every name."""
    ran: dict[str, str] = {}
    for kernel in KERNELS:
        core = running_kernel(kernel)
        if core is None:
            print(f"{kernel}: not run, this processor cannot run it", flush=True)
        elif core in ran:
            print(f"{kernel}: runs the kernel {core}, as {ran[core]} does", flush=True)
        else:
            print(f"{kernel}: runs the kernel {core}", flush=True)
            ran[core] = kernel
    return ran


def marked_files() -> list[str]:
    """Files with marked tests: to collect all others takes 20 s of CPU."""
    return sorted(str(p) for p in (ROOT / "tests").rglob("test_*.py") if "mark.kernels" in p.read_text())


def run(kernel: str, command: list[str]) -> bool:
    """Runs ``command`` under ``kernel`` and prints what it prints; whether it succeeded."""
    done = subprocess.run(
        command, env=environment(kernel), cwd=ROOT, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    print(f"--- {kernel}: {Path(command[0]).name} {command[1]}\n{done.stdout}", flush=True)
    return done.returncode == 0


def main() -> int:
    """0 where all tests pass and all numbers agree."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "out/kernels")
    parser.add_argument(
        "--after-suite", action="store_true",
        help="the suite has just run the marked tests, under one of the kernels",
    )  # fmt: skip
    asked = parser.parse_args()
    kernels = distinct_kernels()
    tested = running_kernel(None) if asked.after_suite else None
    tests = [sys.executable, "-m", "pytest", "-m", "kernels", "-q", "--assert=plain", *marked_files()]
    study = [str(Path(sys.executable).with_name("middeck")), "study", "studies/mace-1993.toml", "-o"]
    work = [(kernel, tests) for core, kernel in kernels.items() if core != tested]
    work += [(kernel, [*study, str(asked.out / kernel), *SHORTER]) for kernel in kernels.values()]
    with ThreadPoolExecutor(os.cpu_count()) as side_by_side:
        succeeded = list(side_by_side.map(lambda job: run(*job), work))
    failed = sorted({kernel for (kernel, _), good in zip(work, succeeded, strict=True) if not good})
    if failed:
        print(f"failed under {', '.join(failed)}")
        return 1
    compare = [sys.executable, str(Path(__file__).with_name("compare_numbers.py"))]
    numbers = (str(asked.out / kernel / "numbers.json") for kernel in kernels.values())
    return subprocess.run([*compare, *numbers]).returncode


if __name__ == "__main__":
    raise SystemExit(main())
