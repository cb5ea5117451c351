"""A process that supervises an engine until it is killed; tests/edges/test_engine_kills.py runs it."""

from __future__ import annotations

import sys
from pathlib import Path

from engine_cases import plain_settings, random_article, random_package
from ungated import Supervisor


def settings(real_time: bool):
    """With a heartbeat; in real time without a test of lateness, which belongs to the machine."""
    late = {"late_s": 1e3, "heartbeat_s": 0.4} if real_time else {"heartbeat_s": 0.2}
    return plain_settings(**late)


def main(folder: Path, real_time: bool) -> None:
    with Supervisor(settings(real_time), random_article(), real_time=real_time, folder=folder) as engine:
        engine.load(random_package())
        engine.reset()
        recorder = engine.record(folder / "loop.mdr")
        engine.command("engage", values=[1.0])
        print(engine.process.pid, flush=True)
        while True:
            engine.run(25 if real_time else 200)
            print(recorder.synced, engine.sample, flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2] == "real")
