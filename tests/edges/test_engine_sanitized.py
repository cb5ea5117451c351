"""The engine with address and undefined-behaviour sanitizers: laws, monitors, faults and a rig over UDP."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterator

import numpy as np

from engine_campaigns import cases_of
from engine_faults import ARTICLE, KINDS, STATES, fault_settings, good, play
from engine_rigs import nominal_article, wait_for_hold
from middeck.realtime.engine.process.launch import UdpRig
from middeck.realtime.engine.rigs.rig_server import LARGEST, LOOPBACK
from middeck.realtime.engine.rigs.stepped_article import SteppedArticle
from middeck.realtime.engine.rigs.udp_replies import RigSession
from ungated import Supervisor

STRIDE = 17
"""Prime to the number of kinds: the first cases are of all groups."""


def test_no_fault_shows_what_sanitizers_find(sanitized_engine, monkeypatch):
    """Any finding ends the engine with a code of its own and words, which the end of each case would show."""
    monkeypatch.setenv("ASAN_OPTIONS", "verify_asan_link_order=0")  # the faked clock is loaded first
    wrong = {}
    for case in range(cases_of("kinds of fault, the engine built with sanitizers")):
        kind, state = KINDS[STRIDE * case % len(KINDS)], STATES[-1 - case % len(STATES)]
        ending = play(kind, state, case, program=sanitized_engine)
        if ending.why:
            wrong[kind, state] = ending
    assert not wrong


@contextlib.contextmanager
def babbling_rig(article: SteppedArticle, seed: int) -> Iterator[UdpRig]:
    """A rig over UDP that sends other datagrams before each reply: of any length, echoes, changed replies."""
    rng, session = np.random.default_rng(seed), RigSession(article)

    def serve(opened: socket.socket) -> None:
        while (asked := opened.recvfrom(LARGEST))[0]:
            data, sender = asked
            reply = session.answer(data)
            if reply is not None:
                changed = bytearray(reply)
                changed[int(rng.integers(len(reply)))] ^= 1 << int(rng.integers(8))
                for other in (rng.bytes(int(rng.integers(2000))), data, bytes(changed), reply):
                    opened.sendto(other, sender)

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind((LOOPBACK, 0))
        thread = threading.Thread(target=serve, args=(opened,))
        thread.start()
        try:
            yield UdpRig(opened.getsockname()[1])
        finally:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as waker:
                waker.sendto(b"", opened.getsockname())
            thread.join()


def test_a_law_over_udp_shows_nothing_that_sanitizers_find(sanitized_engine):
    """Engaged beside the hold, under all monitors, on a rig that babbles."""
    rig = SteppedArticle(nominal_article(*ARTICLE))
    with babbling_rig(rig, 1) as port, Supervisor(fault_settings(), port, program=sanitized_engine) as engine:
        assert engine.load(good()).done
        assert engine.reset().done
        wait_for_hold(engine)
        assert engine.command("engage", values=[1.0]).done
        records = engine.run(engine.settings.samples(engine.settings.ramp_s) + 1)
        assert engine.state == "control"
        assert np.any(records["added_0"])
    assert engine.process.returncode == 0
