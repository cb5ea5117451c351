"""A package's C, cross-compiled without a library and run under an emulator of small processors."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import NamedTuple

from middeck.realtime.generate.c_source import generate_c
from middeck.realtime.package.package import ControllerPackage

HERE = Path(__file__).parent
COMPILER, EMULATOR = "arm-none-eabi-gcc", "qemu-system-arm"
# A Cortex-M7 with a unit of double precision, and a Cortex-M4 with one of single precision.
TARGETS = {
    False: ("mps2-an500", ("-mcpu=cortex-m7", "-mfpu=fpv5-d16")),
    True: ("mps2-an386", ("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16")),
}
FLAGS = (
    *("-Wall", "-Wextra", "-Werror", "-pedantic", "-O2"),
    *("-ffreestanding", "-mthumb", "-mfloat-abi=hard"),
)


class Emulated(NamedTuple):
    """First test sample of another bit (0: none), instructions of a step, and bytes of flash and memory."""

    first_difference: int
    instructions: int
    flash: int
    memory: int


def emulate_package(
    package: ControllerPackage, folder: Path, flags: tuple[str, ...] = ("-std=c99", "-ffp-contract=off")
) -> Emulated:
    """Compile and run ``package`` in ``folder``; flash and memory are those of the law alone."""
    made = generate_c(package, "law")
    (folder / "law.c").write_text(made.source)
    (folder / "law.h").write_text(made.header)
    board, cpu = TARGETS[package.single]
    compile_ = (COMPILER, *FLAGS, *flags, *cpu)
    _run([*compile_, "-c", "law.c", "-o", "law.o"], folder)
    sizes = _run(["arm-none-eabi-size", "law.o"], folder).splitlines()[1].split()
    start = [str(HERE / "start.c"), "-I", ".", "-DLAW_REPLAY", "law.c"]
    _run([*compile_, "-nostdlib", "-T", str(HERE / "memory.ld"), *start, "-lgcc", "-o", "law.elf"], folder)
    said = _run(
        [EMULATOR, "-M", board, "-nographic", "-monitor", "none", "-serial", "none", "-icount", "shift=6",
         "-semihosting-config", "enable=on,target=native", "-kernel", "law.elf"],
        folder,
    )  # fmt: skip
    found = dict(re.findall(r"^(first difference|instructions|state bytes) (\d+)$", said, re.MULTILINE))
    return Emulated(
        int(found["first difference"]), int(found["instructions"]), int(sizes[0]),
        int(sizes[1]) + int(sizes[2]) + int(found["state bytes"]),
    )  # fmt: skip


def _run(command: list[str], folder: Path) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout}{done.stderr}"
    return done.stdout + done.stderr
