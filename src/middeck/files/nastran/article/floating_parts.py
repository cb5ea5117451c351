"""Parts of a deck that nothing joins to the rest: each would float beside it."""

from middeck.files.nastran.article.nodes_and_riders import Standing
from middeck.files.nastran.article.parts import Basis, DeckParts
from middeck.files.nastran.deck.entries import raise_some
from middeck.files.nastran.masses_and_springs.scalars import MASSES, SPRINGS
from middeck.files.toml.faults import DocumentFault
from middeck.structure.model.connectivity import separate_parts, some_names


def check_whole(basis: Basis, parts: DeckParts, standing: Standing) -> None:
    """Raise `ConfigError` if the deck has no structure, or more than one."""
    single = {f"s{point}": element.entry for element in parts.scalars for point in element.points}
    separate = find_pieces(basis, parts, standing)
    if not separate:
        idle = basis.entries.of("CBUSH", *SPRINGS, *MASSES, "CONM1", "CONM2")
        message = "there is no bar, beam or rod in this deck, and no spring or mass"
        message = (
            "the ground holds all springs and masses of this deck: nothing in it moves" if idle else message
        )
        raise_some([DocumentFault(file=basis.deck.path, line=0, key="", message=message)])
    grid = basis.entries.numbered("GRID")
    raise_some(
        [
            (single[part[0]] if part[0] in single else grid[int(part[0])]).fault(
                f"no member, spring or rigid link joins {_points(part)} to the rest",
                hint="one structure in a deck",
            )
            for part in separate[1:]
        ]
    )


def find_pieces(basis: Basis, parts: DeckParts, standing: Standing) -> list[list[str]]:
    """Names of the grids and scalar points of each piece of the deck, the largest first."""
    names = [f"{g}" for g in basis.places.grids if g in standing.kept]
    single = dict.fromkeys(f"s{point}" for element in parts.scalars for point in element.points)
    return separate_parts([*names, *single], _pairs(parts, standing))


def _pairs(parts: DeckParts, standing: Standing) -> list[tuple[str, str]]:
    """Pairs of joined grids and scalar points, by their names."""
    on = standing.carrier
    pairs = [
        (f"{on(part.grids[0])}", f"{on(part.grids[1])}")
        for part in (*parts.bars, *parts.ties)
        if len(part.grids) > 1
    ]
    links = [*standing.riders.items(), *standing.joined]
    pairs += [(f"{grids[0]}", f"{g}") for grids in links for g in grids[1:]]
    for tied in standing.tied:
        names = [*(f"{on(grid)}" for grid in tied.grids), *(f"s{point}" for point in tied.points)]
        pairs += [(names[0], name) for name in names[1:]]
    for element in parts.scalars:
        ends = [f"{on(point)}" if component else f"s{point}" for point, component in element.ends]
        pairs += [(ends[0], end) for end in ends[1:]]
    return pairs


def _points(names: list[str]) -> str:
    """Grids and scalar points by number."""
    scalars = [name[1:] for name in names if name[0] == "s"]
    grids = [name for name in names if name[0] != "s"]
    named = [f"grid {some_names(grids)}"] if grids else []
    return " and ".join([*named, *([f"scalar point {some_names(scalars)}"] if scalars else [])])
