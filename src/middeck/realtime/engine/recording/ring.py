"""What an engine has written into its shared file, as far as it is whole: it may write there meanwhile."""

from __future__ import annotations

import numpy as np

from middeck.realtime.engine.interface.shared_file import SharedFile


def take_records(file: SharedFile, last: int, *, runs_on: bool) -> tuple[np.ndarray, int]:
    """Records up to sample ``last`` that have not been taken yet, and how many were overwritten before.

    ``runs_on``: the engine does not wait for its supervisor.
    """
    ring, first = file.ring, int(file.asks["taken"])
    begin = max(first, last - len(ring))
    found = ring[np.arange(begin, last) % len(ring)]
    # The engine may be in the midst of the record after the last that it has told of.
    safe = int(file.status["sample"]) - len(ring) + (2 if runs_on else 0)
    kept = found[max(0, safe - begin) :]
    whole = kept["sequence"] == np.arange(last - len(kept), last) + 1
    kept = kept[len(whole) - int(np.argmin(whole[::-1])) :] if not whole.all() else kept
    return kept, last - first - len(kept)


def event_rows(file: SharedFile, seen: int) -> np.ndarray:
    """Events after number ``seen`` that are still there, without a gap."""
    count, most = int(file.status["events"]), len(file.events)
    numbers = np.arange(max(seen, count - most), count) + 1
    places = (numbers - 1) % most
    rows = file.events[places]
    return rows[(rows["sequence"] == numbers) & (file.events["sequence"][places] == numbers)]


def pretrip_records(file: SharedFile) -> np.ndarray:
    """Records up to the trip that holds the loop in SAFE, oldest first; without one, those until now."""
    kept, end = file.pretrip, int(file.status["frozen_at"])
    samples = np.arange(max(0, end - len(kept)), end)
    found = kept[samples % len(kept)]
    return found[found["sequence"] == samples + 1]  # none was kept while an earlier trip held the loop
