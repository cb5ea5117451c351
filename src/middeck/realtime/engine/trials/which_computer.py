"""On what a package is tried: the engine, or the reference law in Python."""

from __future__ import annotations

from typing import Literal

from middeck.realtime.generate.compiler import find_compiler
from middeck.realtime.package.package import ControllerPackage

Computer = Literal["auto", "engine", "reference"]


def which_computer(package: ControllerPackage, asked: Computer) -> Computer:
    """``"auto"`` is the engine where there is a compiler and the package is for it, else the reference law.

    The engine runs packages in double precision without an inner loop of their own.
    """
    if asked != "auto":
        return asked
    fits = not (package.single or package.paths)
    return "engine" if fits and find_compiler() is not None else "reference"
