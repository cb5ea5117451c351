"""Clamps of the tests that a predicted environment does not have."""

from middeck.structure.model.environment import Environment
from middeck.updating.refinement.refine import Refined

ADVICE = (
    "taken as rigid, what they yielded has gone into the unknowns; a [[bushing]] in place of each, its "
    "stiffness an unknown, would tell it apart"
)


def released_clamps(refined: Refined, environment: Environment) -> str:
    """Notes on clamps that held the article in a test but not in ``environment``.

    A model's clamp is rigid, a stand is not: one whose compliance is 1 % of a cantilever's L / EI lowers its
    first frequency by 2 %, and a stiffness refined on that predicts the free beam too low. Empty without one.
    """
    tests = [c.survey for c in refined.compared] + [c.test for c in refined.statics]
    held = [clamp.node for test in tests for clamp in test.environment.clamps]
    there = {clamp.node for clamp in environment.clamps}
    gone = [node for node in dict.fromkeys(held) if node not in there]
    named = ", ".join(gone)
    return f"the yielding of the tests' clamps at {named}, which are not there: {ADVICE}" if gone else ""
