"""A supervisor that asks for no verdict, for tests of what an engine does with any package."""

from __future__ import annotations

from middeck.realtime.engine.process import supervisor


class Supervisor(supervisor.Supervisor):
    """As on a bench: packages that no gate would pass are run too, unless ``admitted`` is given."""

    def __init__(self, *args, admitted="ungated", **given):
        super().__init__(*args, admitted=admitted, **given)

    @classmethod
    def attach(cls, *args, admitted="ungated", **given):
        return super().attach(*args, admitted=admitted, **given)
