"""A rig in a process of its own, behind UDP on the loopback interface: hardware in the loop."""

import os
import pickle
import socket
import subprocess
import sys
from types import TracebackType

from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.interface.monitors import LONGEST_S
from middeck.realtime.engine.process.launch import UdpRig
from middeck.realtime.engine.rigs.engine_rig import EngineRig
from middeck.realtime.engine.rigs.rig_server import LOOPBACK, run_child


class ServedRig:
    """``rig`` in a process of its own; a context manager that gives the `UdpRig` for an engine.

    Its time is the engine's sample number: in lockstep a run is reproducible to the bit for a seed, whatever
    is lost or doubled on the way. With ``period_s`` its time goes on by itself where no request comes for two
    periods, with outputs of zero. The process ends with this context, and with the process that started it;
    engines may follow each other.

    Raises `ConfigError` for a rig that does not go through pickle, and a period that no clock keeps.
    """

    def __init__(self, rig: EngineRig, *, period_s: float | None = None) -> None:
        if period_s is not None and not 1e-6 <= period_s <= LONGEST_S:  # as of an engine
            raise ConfigError(f"a period of {period_s} s", where="ServedRig", hint=f"1e-6 to {LONGEST_S:g} s")
        try:
            self.given = pickle.dumps(rig), period_s
        except (pickle.PicklingError, TypeError, AttributeError) as error:
            raise ConfigError(
                f"the rig cannot go to another process: {error}",
                where="ServedRig",
                hint="a class of a module, given before its first read",
            ) from None
        self.process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> UdpRig:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
            opened.bind((LOOPBACK, 0))
            port, handle = opened.getsockname()[1], opened.fileno()
            self.process = subprocess.Popen(
                [sys.executable, "-c", f"from {run_child.__module__} import run_child; run_child({handle})"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                pass_fds=[handle],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(pickle.dumps(self.given))
        self.process.stdin.close()
        if self.process.stdout.read(1) != b"r":
            self.__exit__(None, None, None)
            raise DataError(
                "the rig's process has ended before it served", where="ServedRig", hint="what it said"
            )
        return UdpRig(port)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.process is not None:
            self.process.terminate()
            self.process.wait()
            assert self.process.stdout is not None
            self.process.stdout.close()

    def kill(self) -> None:
        """End its process at once, as a failure would."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
