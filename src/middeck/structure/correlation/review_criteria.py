"""Criteria of reviews for a correlated model, each with its limit, its source and its status.

The limits are data, never part of an algorithm. One that is marked ``recalled`` was not read in its document;
everything that quotes it says so.
"""

import dataclasses
from difflib import get_close_matches
from enum import Enum

from middeck.errors import ConfigError
from middeck.values import record

SEEN = "seen in the source"
RECALLED = "recalled, check against the document"


class Quantity(Enum):
    """Quantity that is judged: an error or an off-diagonal term must be small, the others near 1."""

    FREQUENCY_ERROR = "frequency error"
    CROSS_OFF_DIAGONAL = "cross-orthogonality off-diagonal"
    SELF_OFF_DIAGONAL = "test self-orthogonality off-diagonal"
    CROSS_DIAGONAL = "cross-orthogonality diagonal"
    MAC = "MAC"
    COMAC = "COMAC"

    @property
    def has_upper_limit(self) -> bool:
        """Whether small is good."""
        return self in (Quantity.FREQUENCY_ERROR, Quantity.CROSS_OFF_DIAGONAL, Quantity.SELF_OFF_DIAGONAL)


class Scope(Enum):
    """The paired modes to which a criterion applies."""

    ALL = "all modes"
    FUNDAMENTAL = "fundamental"  # the model's lowest flexible one, not the lowest that was measured
    SIGNIFICANT = "large effective mass"  # others with more than the profile's part in any direction
    OTHER = "other modes"


@record(kw_only=True)
class Criterion:
    """One line of a profile.

    Attributes:
        limit: Largest or smallest value that passes, as a pure number (0.05 is 5 %).
        source: The document, with its revision.
        recalled: True if the limit was not read in the source but recalled.
    """

    quantity: Quantity
    group: Scope
    limit: float
    source: str
    recalled: bool

    @property
    def status(self) -> str:
        """Whether the limit was seen in the source, or recalled and to be checked."""
        return RECALLED if self.recalled else SEEN

    def holds(self, value: float) -> bool:
        """Whether ``value`` passes."""
        return value <= self.limit if self.quantity.has_upper_limit else value >= self.limit

    def __str__(self) -> str:
        sign = "<=" if self.quantity.has_upper_limit else ">="
        return f"{self.quantity.value} {sign} {self.limit:g}, {self.group.value}"


@record
class Profile:
    """A set of criteria under a name.

    ``significant_fraction`` is the part of the rigid mass or inertia beyond which a mode counts as one of
    large effective mass.
    """

    name: str
    title: str
    criteria: tuple[Criterion, ...]
    significant_fraction: float = 0.10

    @property
    def recalled(self) -> bool:
        """Whether any limit was recalled rather than seen."""
        return any(c.recalled for c in self.criteria)


def _profile(name: str, title: str, recalled: bool, *rows: tuple[Quantity, Scope, float]) -> Profile:
    criteria = (
        Criterion(quantity=quantity, group=group, limit=limit, source=title, recalled=recalled)
        for quantity, group, limit in rows
    )
    return Profile(name, title, tuple(criteria))


_Q, _G = Quantity, Scope

ECSS = _profile(
    "ecss-e-st-32-11c",
    "ECSS-E-ST-32-11C, Modal survey assessment, 31 July 2008 (EN 16603-32-11:2014)",
    True,
    (_Q.FREQUENCY_ERROR, _G.FUNDAMENTAL, 0.03),
    (_Q.FREQUENCY_ERROR, _G.SIGNIFICANT, 0.05),
    (_Q.FREQUENCY_ERROR, _G.OTHER, 0.10),
    (_Q.MAC, _G.FUNDAMENTAL, 0.90),
    (_Q.MAC, _G.SIGNIFICANT, 0.85),
    (_Q.MAC, _G.OTHER, 0.80),
    (_Q.CROSS_DIAGONAL, _G.ALL, 0.90),
    (_Q.CROSS_OFF_DIAGONAL, _G.ALL, 0.10),
)
NASA = _profile(
    "nasa-std-5002",
    "NASA-STD-5002 (1996; revision A 2019, superseded by revision B of 10 March 2026: check there)",
    True,
    (_Q.FREQUENCY_ERROR, _G.ALL, 0.05),
    (_Q.CROSS_DIAGONAL, _G.ALL, 0.90),
    (_Q.CROSS_OFF_DIAGONAL, _G.ALL, 0.10),
    (_Q.SELF_OFF_DIAGONAL, _G.ALL, 0.10),
)
SMC = _profile(
    "smc-s-004",
    "SMC-S-004 (USAF Space and Missile Systems Center)",
    True,
    (_Q.FREQUENCY_ERROR, _G.ALL, 0.03),
    (_Q.CROSS_DIAGONAL, _G.ALL, 0.95),
    (_Q.CROSS_OFF_DIAGONAL, _G.ALL, 0.10),
)
ORION_WELL = _profile(
    "orion-well",
    "J. C. Akers and J. Sills, SEM: target modes of the Orion mobile launcher, well identified",
    False,
    (_Q.SELF_OFF_DIAGONAL, _G.ALL, 0.05),
    (_Q.CROSS_OFF_DIAGONAL, _G.ALL, 0.05),
    (_Q.CROSS_DIAGONAL, _G.ALL, 0.95),
)
ORION_ADEQUATE = _profile(
    "orion-adequate",
    "J. C. Akers and J. Sills, SEM: target modes of the Orion mobile launcher, adequately identified",
    False,
    (_Q.SELF_OFF_DIAGONAL, _G.ALL, 0.10),
    (_Q.CROSS_OFF_DIAGONAL, _G.ALL, 0.10),
    (_Q.CROSS_DIAGONAL, _G.ALL, 0.90),
)
COPPOLINO = _profile(
    "coppolino",
    "R. N. Coppolino, Topics in Modal Analysis & Parameter Identification 9: US aerospace community",
    False,
    (_Q.SELF_OFF_DIAGONAL, _G.ALL, 0.10),
)
PROFILES: tuple[Profile, ...] = (ECSS, NASA, SMC, ORION_WELL, ORION_ADEQUATE, COPPOLINO)
# In the order of the command line's help.
PROFILE_NAMES: tuple[str, ...] = tuple(p.name for p in PROFILES)


def find_profile(name: str) -> Profile:
    """The profile called ``name``; raises `ConfigError` with the nearest name.

    >>> find_profile("orion-well").criteria[0].limit
    0.05
    """
    for profile in PROFILES:
        if profile.name == name:
            return profile
    near = get_close_matches(name, PROFILE_NAMES, 1)
    hint = f"did you mean {near[0]!r}?" if near else f"one of {', '.join(PROFILE_NAMES)}"
    raise ConfigError(f"no profile {name!r}", where="profile", hint=hint)


def change_limit(profile: Profile, quantity: Quantity, limit: float, source: str) -> Profile:
    """``profile`` with another limit for ``quantity`` in every group of modes, quoted from ``source``.

    Raises `ConfigError` for a quantity that the profile does not judge.
    """
    judged = dict.fromkeys(c.quantity for c in profile.criteria)
    if quantity not in judged:
        raise ConfigError(
            f"the profile {profile.name} has no limit for the {quantity.value}",
            where="limit",
            hint=f"it judges {', '.join(q.value for q in judged)}; or another profile",
        )
    criteria = tuple(
        Criterion(quantity=c.quantity, group=c.group, limit=limit, source=source, recalled=False)
        if c.quantity is quantity
        else c
        for c in profile.criteria
    )
    before = ", ".join(f"{c.limit:g} ({c.group.value})" for c in profile.criteria if c.quantity is quantity)
    title = f"{profile.title}; {quantity.value} by {source}: {limit:g} in place of {before}"
    return dataclasses.replace(profile, title=title, criteria=criteria)
