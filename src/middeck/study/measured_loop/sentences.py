"""Sentences on a measured loop, from its entry in numbers.json."""

from __future__ import annotations

from middeck.study.words import Line, Numbers, fixed, signed


def changed(loop: Numbers) -> str:
    """The change of the rms angle in words, as predicted and as measured."""
    predicted, measured = loop["predicted_db"], loop["measured_db"]
    foreseen = (
        "an amount that cannot be predicted (the fit or its loop is undamped in the band)"
        if predicted is None
        else f"{fixed(predicted, 2)} dB predicted"
    )
    if not loop["stable"]:
        return f"{foreseen} and unstable on the rig"
    return f"{foreseen} and {fixed(measured, 2)} dB measured"


def held(loop: Numbers) -> str:
    """On which shifts of the pair a loop stays stable on the rig, and on which it does not."""
    parts: list[str] = []
    for stable, word in ((True, "stable"), (False, "unstable")):
        moved = [on["percent"] for on in loop["rig"] if on["stable"] is stable and on["percent"]]
        parts += [f"{word} with the pair at {' and '.join(map(signed, moved))} %"] if moved else []
    return " but ".join(parts) or "not tried with the pair moved"


def decibels(loop: Numbers) -> str:
    """The measured change alone."""
    return "unstable" if loop["measured_db"] is None else f"{fixed(loop['measured_db'], 1)} dB"


def lost(who: str, loop: Numbers, section: str) -> list[Line]:
    """A line for a loop that the rig, as it was or shifted, makes unstable."""
    return [] if all(on["stable"] for on in loop["rig"]) else [Line(f"{who} is {held(loop)}.", section)]
