"""Grids of a deck that become nodes, those that ride on others, and the constraints with an effect."""

from collections.abc import Sequence

from middeck.files.nastran.article.article_sections import lumps
from middeck.files.nastran.article.parts import Basis, DeckParts, LeftOut, grids_named, linked_grids
from middeck.files.nastran.constraints.constraints import Constraint, check_dependent, that_matter
from middeck.files.nastran.constraints.rigid_links import find_carriers
from middeck.files.nastran.deck.entries import raise_some
from middeck.files.nastran.masses_and_springs.bodies import Mass, merged
from middeck.files.toml.faults import DocumentFault
from middeck.structure.model.component import Component
from middeck.values import record


@record(kw_only=True)
class Standing:
    """Grids of a deck that become nodes of the article, and those that ride on others.

    Attributes:
        kept: Grids that are nodes.
        carriers: Carrier by grid, of those that are points of their carrier's frame.
        riders: Carrier by grid, of those that constraints or components join: nodes on rigid links.
        tied: Constraints that mean something.
        joined: Grids of each component.
        linked: Grids that constraints or components join.
        borne: Grids on which members, springs, bodies or components stand.
        account: Every grid that something stands on or that the ground holds.
        bodies: Rigid body by grid.
    """

    kept: set[int]
    carriers: dict[int, int]
    riders: dict[int, int]
    tied: list[Constraint]
    joined: list[tuple[int, ...]]
    linked: set[int]
    borne: set[int]
    account: set[int]
    bodies: dict[int, Mass]

    def carrier(self, grid: int) -> int:
        """The node that ``grid`` moves with: its own, or that of its carrier."""
        return self.carriers.get(grid, grid)


def find_standing(
    basis: Basis, parts: DeckParts, components: Sequence[Component], left_out: list[LeftOut]
) -> Standing:
    """The nodes; raises `ConfigError` for dependents given twice or held, and fills ``left_out``."""
    grids = basis.places.grids
    joined = [tuple(int(frame[1:]) for frame in part.frames) for part in components]
    on_components = set().union(*joined)
    masses = _moving(basis, parts, on_components, left_out)
    used = {grid for part in (*parts.bars, *parts.ties) for grid in part.grids} | {m.grid for m in masses}
    used |= on_components
    carriers = find_carriers(basis.entries, grids)
    pushed = {entry["g"] for entry in basis.entries.of("FORCE", "MOMENT")}
    single = {point for element in parts.scalars for point in element.points}
    known = used | single | set(parts.held) | pushed | {*carriers, *carriers.values()}
    tied = that_matter(parts.constraints, known)
    raise_some(_bare(parts.constraints if any(c.modal for c in components) else tied, single))
    _check(basis, parts, tied, carriers, left_out)
    linked = {g for c in tied for g in c.grids} | on_components
    riders = {g: carriers.pop(g) for g in grids if g in linked and g in carriers}
    borne = {carriers.get(grid, grid) for grid in used}
    used |= linked | set(riders.values())
    if basis.formulation == "lumped":
        masses += [half for bar in parts.bars for half in lumps(bar)]
    return Standing(
        kept={carriers.get(grid, grid) for grid in used},
        carriers=carriers,
        riders=riders,
        tied=tied,
        joined=joined,
        linked=linked,
        borne=borne,
        account=used | set(parts.held),
        bodies=merged(mass._replace(grid=carriers.get(mass.grid, mass.grid)) for mass in masses),
    )


def _bare(constraints: Sequence[Constraint], single: set[int]) -> list[DocumentFault]:
    """Equations that name scalar points without a spring or a mass."""
    why = "scalar point {} in equations, without a spring or a mass: not converted yet"
    found = [(c, point) for c in constraints for point in c.points if point not in single]
    return [c.entry.fault(why.format(point), c.key) for c, point in found]


def _moving(basis: Basis, parts: DeckParts, on_components: set[int], left_out: list[LeftOut]) -> list[Mass]:
    """Masses but those that the ground holds and nothing else joins."""
    met = {grid for part in (*parts.bars, *parts.ties, *parts.constraints) for grid in part.grids}
    met |= linked_grids(basis.entries) | on_components
    moving = [m for m in parts.masses if parts.held.get(m.grid) != "123456" or m.grid in met]
    if still := len(parts.masses) - len(moving):
        left_out.append(("masses", still, "the ground holds them, and nothing else joins them"))
    return moving


def _check(
    basis: Basis, parts: DeckParts, tied: list[Constraint], carriers: dict[int, int], left_out: list[LeftOut]
) -> None:
    faults: list[DocumentFault] = []
    left_out += _idle(basis, parts.constraints, tied, carriers)
    selection = basis.deck.selection
    for number in selection.sets.get("NSM", ()):
        faults.append(selection.fault("NSM", number, "NSM sets are not converted yet"))
    for number in selection.sets.get("TEMPERATURE", ()) if basis.entries.idle["MATT1"] else ():
        what = "sets the moduli of materials by MATT1, which is not converted: the modes would be others"
        hint = "write the moduli at this temperature in MAT1, and leave MATT1 out"
        faults.append(selection.fault("TEMPERATURE", number, what, hint))
    grid = basis.entries.numbered("GRID")
    faults += [
        grid[rider].fault(
            f"its components {components} are held (SPC or its PS) and depend on grid {carriers[rider]} too",
            hint=f"hold grid {carriers[rider]}",
        )
        for rider, components in parts.held.items()
        if rider in carriers
    ]
    check_dependent(tied, carriers, parts.held, faults)
    raise_some(faults)


def _idle(
    basis: Basis, every: list[Constraint], tied: list[Constraint], carriers: dict[int, int]
) -> list[LeftOut]:
    """Constraints at grids without an element or a mass, and sets that are not selected."""
    entries, selection = basis.entries, basis.deck.selection
    matter = {id(c.entry) for c in tied}
    idle = {id(c.entry): c.entry for c in every if id(c.entry) not in matter}
    found: list[LeftOut] = [
        (name, 1, f"{'an average' if name == 'RBE3' else 'links'} at a grid without an element or a mass")
        for name in (entry.name for entry in idle.values())
    ]
    partial = {id(c.entry) for c in every}
    found += [
        (entry.name, 1, "links at grids without an element or a mass")
        for entry in entries.of("RBE2", "RBAR")
        if id(entry) not in partial and not any(grid in carriers for grid in grids_named(entry))
    ]
    for command, names in (("SPC", ("SPC", "SPC1", "SPCADD")), ("MPC", ("MPC", "MPCADD"))):
        unions = [e for e in entries.of(f"{command}ADD") if selection.selects(command, e.id)]
        taken = [entry.name for entry in (*basis.deck.selected(command), *unions)]
        for name in names:
            if (count := len(entries.of(name)) - taken.count(name)) > 0:
                found.append((name, count, "not selected by case control"))
    return found
