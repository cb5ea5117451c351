"""Write docs/reference/api.md from the public names; with --check only say whether it is stale."""

from __future__ import annotations

import inspect
import sys
from pathlib import Path

from made_page import write_or_check

import middeck

PAGE = Path(__file__).parent / "reference" / "api.md"
HEAD = """\
# Public names

`import middeck as md` gives the names below; each is imported from its room when it is first used. A name
with a dot is one of a room: `control.find_aliases` is `md.control.find_aliases`. Everything else is found by
room, as `CONTRIBUTING.md` describes. Units, shapes, errors and sources stand in the docstrings:
`help(md.fit_response)`. This page is written by `docs/make_api_reference.py`.
"""
SECTIONS = {
    "structure.model": "Articles and environments",
    "structure.summary": "Articles and environments",
    "structure.rest": "Rest states, modes and plants",
    "structure.modes": "Rest states, modes and plants",
    "structure.plants": "Rest states, modes and plants",
    "structure.gravity": "What gravity does",
    "structure.hanging": "Suspension",
    "structure.gimbals": "Gimbals and joints",
    "joints": "Gimbals and joints",
    "structure.sensitivity": "Sensitivities",
    "structure.correlation": "Correlation with a test",
    "systems": "Plants",
    "signals.excitation": "Test signals",
    "signals": "Records and ports",
    "identification.faults": "Records and ports",
    "identification.spectra": "Spectra and frequency responses",
    "identification.plants": "From a fit to a plant",
    "identification.uncertainty": "How far to trust a fit",
    "identification.tracking": "Tracking",
    "identification": "Fits",
    "control.law": "Compensators and loops",
    "control.loop": "Compensators and loops",
    "control.analysis": "Stability, margins, rms and worst cases",
    "control.noise": "Stability, margins, rms and worst cases",
    "control.qualification": "Stability, margins, rms and worst cases",
    "control.lqg": "LQG design",
    "control.riccati": "LQG design",
    "control.sampled": "Sampled control",
    "control.robust": "Robust control",
    "control": "Shaping and reduction",
    "realtime": "Controller packages",
    "laboratory": "The rig",
    "files": "Files and other programs",
    "campaign": "Campaigns",
    "updating": "Refinement and promises",
    "plot": "Drawings",
}


def page() -> str:
    """The whole page."""
    sections: dict[str, list[str]] = {title: [] for title in SECTIONS.values()} | {"Around": []}
    for name, value in sorted(public().items(), key=lambda item: (item[0].count("."), item[0].lower())):
        module = getattr(value, "__module__", "middeck")
        title = next((t for room, t in SECTIONS.items() if module.startswith(f"middeck.{room}")), "Around")
        sections[title].append(f"| `{call_of(name, value)}` | {sentence_of(value)} | `{module}` |")
    parts = [HEAD]
    for title, rows in sections.items():
        parts.append(
            f"## {title}\n\n| name | what it is | module |\n| --- | --- | --- |\n" + "\n".join(rows) + "\n"
        )
    return "\n".join(parts)


def public() -> dict[str, object]:
    """All names, those of a room behind its name."""
    own = {name: getattr(middeck, name) for name in middeck.__all__}
    rooms = {name: value for name, value in own.items() if inspect.ismodule(value)}
    of_rooms = {
        f"{room}.{name}": getattr(held, name) for room, held in rooms.items() for name in held.__all__
    }
    return {name: value for name, value in own.items() if name not in rooms} | of_rooms


def call_of(name: str, value: object) -> str:
    """A function with the names of its arguments; a class by its name."""
    if not inspect.isfunction(value):
        return name
    words: list[str] = []
    for parameter in inspect.signature(value).parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY and "*" not in words:
            words.append("*")
        words.append(parameter.name)
    return f"{name}({', '.join(words)})"


def sentence_of(value: object) -> str:
    """The first paragraph of its docstring."""
    if isinstance(value, str):
        return "the version"
    text = (inspect.getdoc(value) or "").split("\n\n", maxsplit=1)[0]
    return " ".join(text.split()).rstrip(".").replace("|", "\\|")


def main(arguments: list[str]) -> int:
    """Write the page, or compare it; 1 where it is stale."""
    return write_or_check(PAGE, page(), arguments, Path(__file__).name)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
