"""From a deck to the document of an article: nodes, members, bodies and rigid links, in SI units."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from middeck.files.faults import Fault
from middeck.files.nastran.article_sections import (
    ArticleSections,
    Formulation,
    article_sections,
    lumps,
    taper_notes,
)
from middeck.files.nastran.bodies import Mass, merged, read_masses, read_scalar_masses, scalar_masses
from middeck.files.nastran.constraints import (
    Constraint,
    check_dependent,
    joined_components,
    read_constraints,
    term_rows,
    that_matter,
)
from middeck.files.nastran.coordinates import Places, place_grids
from middeck.files.nastran.deck import Deck, asked_formulation, read_deck, real_parameter
from middeck.files.nastran.direct_input import NAME, direct_component
from middeck.files.nastran.entries import Entries, Entry, raise_some
from middeck.files.nastran.formats import DIVIDING
from middeck.files.nastran.loads import LoadSets
from middeck.files.nastran.loose_turns import loose_turns, turn_clamp
from middeck.files.nastran.members import NAMES, RODS, Bar, own_axes, read_bars
from middeck.files.nastran.numbers import integer
from middeck.files.nastran.restraints import clamp, read_restraints
from middeck.files.nastran.rigid_links import ALL, find_carriers
from middeck.files.nastran.scalars import (
    MASSES,
    WAY,
    Element,
    ScalarNodes,
    held_points,
    read_elements,
    scalar_nodes,
    scalar_points,
    tie_terms,
)
from middeck.files.nastran.sections_of_bars import read_material
from middeck.files.nastran.ties import Tie, read_ties
from middeck.files.nastran.units import Units, doubt_modulus, guess_units
from middeck.structure.model.component import Component
from middeck.structure.model.connectivity import separate_parts, some_names

__all__ = ["Conversion", "Formulation", "convert_deck", "likely_units", "read_deck"]

REDUCTION = ("ASET", "ASET1", "BSET", "BSET1", "QSET", "QSET1", "CSET", "CSET1")
# Cards that an article has no place for, and what that means for its modes: nothing.
NO_PART = {
    "sets of a reduction: the article is not reduced": REDUCTION,
    "an article that is free needs none": ("SUPORT", "SUPORT1"),
    "how to solve": ("EIGR", "EIGRL"),
}

# Of a place, from sums of such places.
ROUNDING = 1e-12


class Conversion(NamedTuple):
    """An article's document, and what became of the cards.

    ``environment`` is the document of an environment: what holds the deck, if anything does, and its gravity.
    ``read`` counts the cards whose fields were read; ``left_out`` has rows (card, how many, why);
    ``notes`` are sentences for the report, ``components`` what the document names, by file.
    """

    document: dict[str, Any]
    read: dict[str, int]
    converted: dict[str, int]
    left_out: tuple[tuple[str, int, str], ...]
    notes: tuple[str, ...]
    environment: dict[str, Any]
    components: dict[str, Component] = {}  # noqa: RUF012 -- of a frozen tuple, never changed

    @property
    def holds(self) -> bool:
        """Whether the ground holds the deck anywhere."""
        return "clamp" in self.environment or "bushing" in self.environment


def likely_units(deck: Deck) -> list[Units]:
    """Units in which the materials and the size of ``deck`` are plausible, the likeliest first."""
    places = place_grids(deck.entries).grids
    factor = real_parameter(deck, "WTMASS", 1.0)
    x = np.array(list(places.values())).reshape(-1, 3)
    size = float(np.linalg.norm(np.ptp(x, axis=0))) if len(x) else 0.0
    materials: list[tuple[float, float]] = []
    for card in deck.entries.of("MAT1"):
        try:
            material = read_material(card)
        except ValueError:
            continue
        materials.append((material.E, factor * material.rho))
    return guess_units(materials, size)


def convert_deck(
    deck: Deck,
    units: Units,
    formulation: Formulation,
    name: str,
    components: Mapping[str, Component] | None = None,
) -> Conversion:
    """The article that ``deck`` describes, in SI units, its members' mass by ``formulation``.

    ``components`` stand on its grids, see `read_assembly`, by the names of the files that they will be in.

    ``consistent`` is middeck's own (with rotary inertia), ``coupled`` the coupled bar mass of MSC and NX
    Nastran (`MemberMass.COUPLED`, no rotary nor torsional inertia), ``lumped`` halves at the ends of each
    member. Raises `ConfigError` with all that cannot be represented and would change the modes.
    """
    return _Converter(deck, units, formulation).conversion(name, dict(components or {}))


class _Converter:
    """What is known of the deck so far; faults are gathered and raised together."""

    def __init__(self, deck: Deck, units: Units, formulation: Formulation) -> None:
        self.deck, self.units = deck, units
        self.formulation: Formulation = formulation
        self.mass_unit = units.mass * real_parameter(deck, "WTMASS", 1.0)
        self.places: Places = place_grids(deck.entries)
        self.left_out: list[tuple[str, int, str]] = []
        self.notes: list[str] = []
        self.tapers: dict[str, ArticleSections] = {}
        self.rotors: list[str] = []  # grids with an inertia that no body has by itself

    def conversion(self, name: str, parts: dict[str, Component]) -> Conversion:
        entries, faults = self.deck.entries, list[Fault]()
        self._check_systems(faults)
        bars = read_bars(entries, self.places, faults)
        masses = read_masses(entries, self.places, faults)
        points = scalar_points(entries, self.places, faults)
        held = read_restraints(self.deck, self.places, points, faults)
        properties = scalar_masses(entries, faults)
        scalars = self._scalars(points, properties, held, faults)
        direct = direct_component(self.deck, self.units, faults)
        constraints = read_constraints(self.deck, self.places, faults)
        ties = read_ties(entries, self.places, points, held, faults)
        masses += read_scalar_masses(entries, self.places, points, held, _linked(entries), properties, faults)
        if direct is not None and direct.modal and scalars:
            what = "matrices by direct input have scalar points of their own: not converted yet beside them"
            faults.append(scalars[0].entry.fault(what))
        raise_some(faults)
        constraints = [self._in_metres(c) for c in constraints]
        constraints += [self._tied(element) for element in scalars if element.has_node]
        parts |= {} if direct is None else {f"{name}-{NAME}.npz": direct}
        joined = [tuple(int(frame[1:]) for frame in part.frames) for part in parts.values()]
        met = {grid for part in (*bars, *ties, *constraints) for grid in part.grids} | _linked(entries)
        still = [m for m in masses if held.get(m.grid) == "123456" and m.grid not in met.union(*joined)]
        masses = [m for m in masses if all(m is not other for other in still)]
        self._leave("masses", len(still), "the ground holds them, and nothing else joins them")
        used = {grid for part in (*bars, *ties) for grid in part.grids} | {mass.grid for mass in masses}
        on_components = set().union(*joined)
        used |= on_components
        carriers = find_carriers(entries, self.places.grids)
        pushed = {entry["g"] for entry in entries.of("FORCE", "MOMENT")}
        standing = used | set(held) | pushed | set(carriers) | set(carriers.values())
        tied, every = that_matter(constraints, standing), constraints
        self._check_unconverted(tied, every, carriers, faults)
        self._check_held(held, carriers, faults)
        check_dependent(tied, carriers, held, faults)
        raise_some(faults)
        linked = {g for c in tied for g in c.grids} | on_components
        riders = {g: carriers.pop(g) for g in self.places.grids if g in linked and g in carriers}
        borne = {carriers.get(grid, grid) for grid in used}
        used |= linked | set(riders.values())
        if self.formulation == "lumped":
            masses += [half for bar in bars for half in lumps(bar)]
        bodies = merged(mass._replace(grid=carriers.get(mass.grid, mass.grid)) for mass in masses)
        kept = {carriers.get(grid, grid) for grid in used}
        links = [*(c.grids for c in tied), *riders.items()]
        self._check_whole(kept, bars, ties, [*links, *joined], scalars, carriers)
        loads = LoadSets(self.deck, self.places, carriers, kept)
        cases = loads.cases(self.units, faults)
        raise_some(faults)
        self._account(used | set(held), carriers, direct, scalars)
        sections, struts = self._members(bars, carriers)
        pinned, pins = self._pins(bars, carriers)
        single = self._scalar_nodes(scalars)
        riding, bushings, grounds = self._ties(ties, carriers)
        clamps = [
            clamp(grid, held[grid], self.places)
            for grid in self.places.grids
            if grid in held and grid in kept
        ]
        self._leave("SPC, PS", len(held) - len(clamps), "at grids on which nothing stands")
        # What constraints join is not loose; of grids on which nothing else stands all other motions are.
        whole = dict.fromkeys({*on_components, *riders, *riders.values()}, ALL)
        joins = joined_components(tied) | whole
        taken = {grid: held.get(grid, "") + joins.get(grid, "") for grid in kept}
        bare = {
            g: "".join(sorted(set("123") - set(taken[g]))) for g in self.places.grids if g in linked - borne
        }
        bare = {grid: shifts for grid, shifts in bare.items() if shifts}
        shifts = [clamp(grid, components, self.places) for grid, components in bare.items()]
        turning = {grid for grid, body in bodies.items() if _turns(body)}
        turning |= {grid for grid, components in joins.items() if not set(components).isdisjoint("456")}
        found = loose_turns(kept, bars, ties, turning, taken, carriers, self.places)
        loose = {grid: found[grid] for grid in self.places.grids if grid in found}
        turns = [turn_clamp(grid, directions) for grid, directions in loose.items()]
        if turns:
            named = some_names([f"{grid}" for grid in loose])
            self.notes.append(
                f"nothing holds rotations of grid {named}: the environment holds them, as PARAM AUTOSPC does"
            )
        if bare:
            named = some_names([f"{grid}" for grid in bare])
            self.notes.append(
                f"nothing holds shifts of grid {named}: the environment holds them, as PARAM AUTOSPC does"
            )
        document = _filled(
            {
                "schema": 1,
                "name": name,
                "title": f"{name} (from {self.deck.path.rsplit('/', 1)[-1]})",
                "mesh": {"elements_per_strut": 1},
                "section": sections,
                "node": [self._node(g, bodies.get(g)) for g in self.places.grids if g in kept]
                + pinned
                + single.nodes,
                "strut": struts,
                "attach": [self._rider(g, carriers[g]) for g in self.places.grids if carriers.get(g) in kept]
                + riding
                + single.attach,
                "bushing": bushings + single.bushings,
                "component": [
                    {
                        "name": part.name,
                        "file": file,
                        "nodes": dict(zip(part.grids, part.frames, strict=True)),
                    }
                    for file, part in parts.items()
                ],
                "link": [
                    {"name": f"rigid_g{g}", "from": f"g{carrier}", "to": f"g{g}"}
                    for g, carrier in riders.items()
                ]
                + [c.table for c in tied if c.kind == "link"]
                + pins,
                "interpolation": [c.table for c in tied if c.kind == "interpolation"],
                "equation": [c.table for c in tied if c.kind == "equation"],
                "load_case": cases,
            }
        )
        if self.rotors:
            self.notes.append(
                f"grid {some_names(self.rotors)} carries an inertia that no body has by itself "
                "(without mass, or the triangle inequality)"
            )
        converted = Counter(bar.entry.name for bar in bars)
        converted.update(entry.name for entry in entries.of("CONM1", "CONM2", *MASSES))
        converted.update(element.entry.name for element in scalars if not element.is_mass)
        converted.update(tie.entry.name for tie in ties)
        converted["components"] = len(parts)
        alone = {id(element.entry) for element in scalars}
        converted.update(c.entry.name for c in tied if id(c.entry) not in alone)
        converted["clamped grids"] = len(clamps)
        converted["load cases"] = len(cases)
        converted["grids that are nodes"] = len(kept)
        converted["grids that ride rigidly"] = sum(carriers.get(g, g) in kept for g in carriers)
        read = {name: len(found) for name, found in entries.by_name.items()}
        constants, notes = loads.constants(bool(clamps or grounds or single.grounds))
        self.notes += notes
        self.left_out += loads.refused
        converted["gravity"] = len(constants) and 1
        environment = {"schema": 1, "name": f"{name}-supports"}
        environment |= {"constants": constants} if constants else {}
        environment |= {"clamp": clamps + shifts + turns + single.clamps, "bushing": grounds + single.grounds}
        return Conversion(
            document,
            read,
            dict(converted),
            tuple(self.left_out),
            tuple(self.notes),
            _filled(environment),
            parts,
        )

    def _check_held(self, held: dict[int, str], carriers: dict[int, int], faults: list[Fault]) -> None:
        grid = self.deck.entries.numbered("GRID")
        faults += [
            grid[rider].fault(
                f"its components {components} are held and depend on grid {carriers[rider]} too",
                hint=f"hold grid {carriers[rider]}",
            )
            for rider, components in held.items()
            if rider in carriers
        ]

    def _check_systems(self, faults: list[Fault]) -> None:
        for entry in self.deck.entries.of("GRDSET", "GRID"):
            cd = entry["cd"]
            if cd is not None and cd > 0 and cd not in self.places.systems:
                faults.append(entry.fault(f"there is no coordinate system {cd}", "cd"))
        raise_some(faults)

    def _check_unconverted(
        self, tied: list[Constraint], every: list[Constraint], carriers: dict[int, int], faults: list[Fault]
    ) -> None:
        """Refuse what is not converted yet and would change the modes; list what would not."""
        entries, selection = self.deck.entries, self.deck.selection
        matter = {id(c.entry) for c in tied}
        idle = {id(c.entry): c.entry for c in every if id(c.entry) not in matter}
        for entry in idle.values():
            what = "an average" if entry.name == "RBE3" else "links"
            self._leave(entry.name, 1, f"{what} at a grid that nothing stands on")
        partial = {id(c.entry) for c in every}
        for entry in entries.of("RBE2", "RBAR"):
            if id(entry) not in partial and not any(grid in carriers for grid in _grids_named(entry)):
                self._leave(entry.name, 1, "links at grids that nothing stands on")
        for command in ("SPC", "MPC"):
            chosen = self.deck.selected(command)
            names = ("SPC", "SPC1", "SPCADD") if command == "SPC" else ("MPC", "MPCADD")
            for name in names:
                unions = [e for e in entries.of(f"{command}ADD") if selection.selects(command, e.id)]
                count = len(entries.of(name)) - sum(entry.name == name for entry in (*chosen, *unions))
                self._leave(name, count, "not selected by case control")
            absent = selection.sets.get(command, frozenset()) - {e.id for e in entries.of(*names)}
            self.notes += [f"case control selects {command} {n}, which is not there" for n in sorted(absent)]
        if selection.sets.get("NSM"):
            line = selection.lines["NSM"]
            faults.append(
                Fault(file=line[1], line=line[2], key="NSM", message="NSM sets are not converted yet")
            )

    def _check_whole(
        self,
        kept: set[int],
        bars: list[Bar],
        ties: list[Tie],
        links: list[tuple[int, ...]],
        scalars: list[Element],
        carriers: dict[int, int],
    ) -> None:
        """A part of its own would float beside the rest."""
        grid = self.deck.entries.numbered("GRID")
        pairs = [
            tuple(f"{carriers.get(g, g)}" for g in bar.grids) for bar in (*bars, *ties) if len(bar.grids) > 1
        ]
        pairs += [(f"{grids[0]}", f"{g}") for grids in links for g in grids[1:]]
        single = {f"s{point}": element.entry for element in scalars for point in element.points}
        for element in scalars:
            ends = [
                f"s{point}" if not component else f"{carriers.get(point, point)}"
                for point, component in element.ends
            ]
            pairs += [(ends[0], end) for end in ends[1:]]
        names = [f"{g}" for g in self.places.grids if g in kept]
        parts = separate_parts([*names, *single], [(a, b) for a, b in pairs])
        if not names and not single:
            message = "there is no bar, beam or rod in this deck, and no spring or mass"
            raise_some([Fault(file=self.deck.path, line=0, key="", message=message)])
        raise_some(
            [
                (single[part[0]] if part[0] in single else grid[int(part[0])]).fault(
                    f"no member, spring or rigid link joins {_points(part)} to the rest",
                    hint="one structure in a deck",
                )
                for part in parts[1:]
            ]
        )

    def _account(
        self,
        used: set[int],
        carriers: dict[int, int],
        direct: Component | None,
        scalars: list[Element],
    ) -> None:
        entries, deck = self.deck.entries, self.deck
        for why, names in NO_PART.items():
            for name in names:
                if name != "SPOINT":
                    self._leave(name, len(entries.of(name)), why)
        if not scalars and (direct is None or not direct.modal):  # else its modal coordinates
            self._leave("SPOINT", len(entries.of("SPOINT")), "nothing stands on these scalar points")
        for name, count in sorted(deck.entries.idle.items()):
            divides = "which superelement something is in: the article is not divided"
            self._leave(name, count, divides if name in DIVIDING else "no part in stiffness and mass")
        inside = [e for e in entries.of("GRID") if e["seid"]]
        self._leave("GRID SEID", len(inside), "which superelement they are in: the article is not divided")
        idle = [e for e in entries.of("DMIG") if e["name"] not in deck.selection.matrices.values()]
        self._leave("DMIG", len(idle), "not selected by case control")
        bare = set(self.places.grids) - used - set(carriers) - set(carriers.values())
        self._leave("GRID", len(bare), "nothing stands on them: points of orientation, for instance")
        damped = [e for e in entries.of("MAT1", "PELAS", "CELAS2") if e["ge"]]
        self._leave("MAT1, PELAS GE", len(damped), "damping of materials: give it in the article's [damping]")
        self.notes += [f"include not found before BEGIN BULK: {name}" for name in deck.missing]
        stiff = {e["type"] for e in entries.of("PBARL", "PBEAML")} - {"ROD", "TUBE", "TUBE2", "BAR"}
        if stiff:
            self.notes.append(f"no shear flexibility in sections of shape {', '.join(sorted(stiff))}")
        if deck.bulk_only:
            self.notes.append("bulk data only: no case control, nothing is selected")
        if deck.entries.of("ASET", "ASET1"):
            self.notes.append("the deck reduces to its ASET: the article keeps all degrees of freedom")
        for card in entries.of("MAT1"):
            doubt = doubt_modulus(self.units, card["e"] or 0.0)
            self.notes += [f"{card.label} has {doubt}: are the units {self.units.name}?"] * bool(doubt)
        asked = asked_formulation(deck)
        if asked != self.formulation and entries.of(*NAMES):
            self.notes.append(
                f"the deck's own program would give its bars {asked} mass (PARAM COUPMASS), "
                f"the article has {self.formulation} mass: with {asked} it compares with that program"
            )

    def _leave(self, card: str, count: int, why: str) -> None:
        if count > 0:
            self.left_out.append((card, count, why))

    def _members(
        self, bars: list[Bar], carriers: dict[int, int]
    ) -> tuple[dict[str, dict[str, Any]], list[dict[str, Any]]]:
        sections: dict[str, dict[str, Any]] = {}
        along: dict[str, dict[str, Any]] = {}  # what struts of one property share
        struts: list[dict[str, Any]] = []
        for bar in bars:
            entry = bar.entry
            own = entry.name == "CONROD"
            section = (
                f"conrod{entry.id}" if own else f"{entry.name.replace('C', 'p', 1).lower()}{entry['pid']}"
            )
            if section not in along:
                along[section] = self._sections(section, bar, sections)
            strut: dict[str, Any] = {
                "name": f"{entry.name[1:].lower()}{entry.id}",
                "from": f"g{carriers.get(bar.grids[0], bar.grids[0])}",
                "to": f"g{carriers.get(bar.grids[1], bar.grids[1])}",
                "up": bar.up / np.linalg.norm(bar.up),
                **along[section],
            }
            if entry.name in RODS:
                strut["elements"] = 1  # two rods in line are a mechanism
            for k, (side, grid, end) in enumerate(zip(("from", "to"), bar.grids, bar.ends, strict=True)):
                offset = end - self.places.grids[carriers.get(grid, grid)]
                if bar.released(k):
                    strut[side] = f"{strut['name']}{'ab'[k]}"
                elif np.any(offset):
                    strut[f"{side}_offset_m"] = offset * self.units.length
            struts.append(strut)
        self.notes += taper_notes(self.tapers)
        return sections, struts

    def _sections(self, name: str, bar: Bar, sections: dict[str, dict[str, Any]]) -> dict[str, Any]:
        """Adds the sections of a property to ``sections``; what a strut says of them."""
        rod = bar.entry.name in RODS
        made = article_sections(bar.section, rod, self.units, self.mass_unit, self.formulation)
        count = len(made.tables)
        named = [name] if count == 1 else [f"{name}_{k}" for k in range(1, count + 1)]
        sections |= dict(zip(named, made.tables, strict=True))
        self.tapers[name] = made
        shared: dict[str, Any] = {"section": named[0]}
        if count > 1:
            middles = [(k + 0.5) / count for k in range(count)]
            shared["elements"] = count
            shared["stations"] = [
                {"at": at, "section": part}
                for at, part in zip([*middles, 1.0], [*named, named[-1]], strict=True)
            ]
        return shared

    def _pins(
        self, bars: list[Bar], carriers: dict[int, int]
    ) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        """Nodes of the ends that pins part from their grids, and the links that leave them free to move."""
        nodes: list[dict[str, Any]] = []
        links: list[dict[str, Any]] = []
        for bar in bars:
            for k, (grid, end) in enumerate(zip(bar.grids, bar.ends, strict=True)):
                released = bar.released(k)
                if not released:
                    continue
                name = f"{bar.entry.name[1:].lower()}{bar.entry.id}{'ab'[k]}"
                x, y, z = end * self.units.length
                axes = own_axes(bar.ends[1] - bar.ends[0], bar.up)
                nodes.append({"name": name, "x_m": x, "y_m": y, "z_m": z})
                links.append(
                    {
                        "name": f"pin_{name}",
                        "from": f"g{carriers.get(grid, grid)}",
                        "to": name,
                        "along": "".join(a for a, c in zip("xyz", "123", strict=True) if c not in released),
                        "about": "".join(a for a, c in zip("xyz", "456", strict=True) if c not in released),
                        "x_axis": axes[:, 0],
                        "y_axis": axes[:, 1],
                    }
                )
        return nodes, links

    def _ties(
        self, ties: list[Tie], carriers: dict[int, int]
    ) -> tuple[list[dict[str, Any]], list[dict[str, Any]], list[dict[str, Any]]]:
        """Attach points, bushings between them, and bushings to the ground."""
        points: list[dict[str, Any]] = []
        between: list[dict[str, Any]] = []
        grounds: list[dict[str, Any]] = []
        length, force = self.units.length, self.units.force
        for tie in ties:
            name = f"{'bush' if tie.entry.name == 'CBUSH' else 'spring'}{tie.entry.id}"
            ends = [name + end for end in "ab"[: len(tie.grids)]]
            for end, grid, point in zip(ends, tie.grids, tie.points, strict=True):
                carrier = carriers.get(grid, grid)
                offset = (point - self.places.grids[carrier]) * length
                points.append({"name": end, "frame": f"g{carrier}", "offset_m": offset})
            law = {
                "stiffness": tie.stiffness * force * np.repeat([1.0 / length, length], 3),
                "x_axis": tie.axes[:, 0],
                "y_axis": tie.axes[:, 1],
            }
            if len(ends) == 2:
                between.append({"name": name, "from": ends[0], "to": ends[1], **law})
            else:
                grounds.append({"name": name, "attach": ends[0], **law})
        return points, between, grounds

    def _scalars(
        self,
        points: dict[int, Entry],
        masses: dict[int, float],
        held: dict[int, str],
        faults: list[Fault],
    ) -> list[Element]:
        """Springs and masses with scalar points that are free to move."""
        entries = self.deck.entries
        values = {"PELAS": {e.id: e["k"] for e in entries.of("PELAS")}, "PMASS": masses}
        still = held_points(self.deck, points, faults)
        return read_elements(entries, points, self.places, values, (held, still), faults)

    def _tied(self, element: Element) -> Constraint:
        """The equation that moves an element's own node as what it sees of grids and scalar points."""
        terms: list[dict[str, Any]] = []
        for node, end, factor in tie_terms(element):
            if end is None:
                terms.append({"frame": node, "direction": WAY, "coefficient": factor})
            else:
                terms += self._scaled(term_rows(self.places, [(end[0], f"{end[1]}", factor)]))
        moves = tuple((grid, f"{component}") for grid, component in element.grids)
        table = {"name": element.name, "term": terms}
        return Constraint("equation", table, element.entry, "g1", moves, (), ())

    def _scalar_nodes(self, scalars: list[Element]) -> ScalarNodes:
        units = self.units
        if scalars:
            names = some_names([f"{p}" for p in dict.fromkeys(p for e in scalars for p in e.points)])
            self.notes.append(
                f"scalar point {names} is a node that turns about x, one metre as one radian, "
                "so that it has no weight; its mass counts as inertia, and the environment holds its other "
                "motions"
            )
        return scalar_nodes(scalars, self.places, units.length, self.mass_unit, units.force / units.length)

    def _node(self, grid: int, body: Mass | None) -> dict[str, Any]:
        place, length = self.places.grids[grid], self.units.length
        x, y, z = place * length
        node: dict[str, Any] = {"name": f"g{grid}", "x_m": x, "y_m": y, "z_m": z}
        if body is None or (body.mass == 0.0 and not np.any(body.inertia)):
            return node
        inertia = body.inertia * self.mass_unit * length**2
        node["mass_kg"] = body.mass * self.mass_unit
        arm = body.centre - place
        reach = ROUNDING * float(np.linalg.norm(body.centre))
        if np.linalg.norm(arm) > reach:
            node["cg_m"] = arm * length
        if _turns(body):
            node["inertia_kg_m2"] = inertia
            a, b, c = np.linalg.eigvalsh(inertia)
            if body.mass == 0.0 or a + b < c * (1.0 - 1e-9):
                node["rotors_excluded"] = True
                self.rotors.append(f"{grid}")
        return node

    def _scaled(self, terms: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """Factors of turns times the length unit: shifts are in metres."""
        return [
            t | {"coefficient": t["coefficient"] * (self.units.length if t["direction"][0] == "r" else 1.0)}
            for t in terms
        ]

    def _in_metres(self, constraint: Constraint) -> Constraint:
        if constraint.kind != "equation" or not constraint.table:
            return constraint
        table = constraint.table | {"term": self._scaled(constraint.table["term"])}
        return constraint._replace(table=table)

    def _rider(self, grid: int, carrier: int) -> dict[str, Any]:
        offset = (self.places.grids[grid] - self.places.grids[carrier]) * self.units.length
        return {"name": f"g{grid}", "frame": f"g{carrier}", "offset_m": offset}


def _filled(document: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in document.items() if value != []}


def _points(names: list[str]) -> str:
    """Grids and scalar points by number."""
    scalars = [name[1:] for name in names if name[0] == "s"]
    grids = [name for name in names if name[0] != "s"]
    said = [f"grid {some_names(grids)}"] if grids else []
    return " and ".join([*said, *([f"scalar point {some_names(scalars)}"] if scalars else [])])


def _turns(body: Mass) -> bool:
    """Whether it has inertia beyond the rounding of its place."""
    reach = ROUNDING * float(np.linalg.norm(body.centre))
    return bool(np.abs(body.inertia).max() > body.mass * reach**2)


def _linked(entries: Entries) -> set[int]:
    """Grids that rigid links name."""
    return {grid for entry in entries.of("RBE2", "RBAR") for grid in _grids_named(entry)}


def _grids_named(entry: Entry) -> list[int]:
    if entry.name == "RBAR":
        return [entry["ga"], entry["gb"]]
    return [entry["gn"], *(n for n in map(integer, filter(None, entry["gm"])) if n)]
