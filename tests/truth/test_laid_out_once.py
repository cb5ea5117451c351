"""Places of entries hang on the topology alone: articles of one topology share them, and others do not."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg

from middeck.control.riccati.lyapunov import real_schur
from middeck.structure.assembly import pattern
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.elements import offset_points
from middeck.structure.elements.sparse_of_parts import csr_of
from middeck.structure.model.article import Structure
from middeck.structure.model.finer_mesh import refine_mesh
from middeck.structure.sensitivity.parameters import find_parameters, set_parameter


def mass_of(article: Structure) -> np.ndarray:
    model = mesh_structure(article)
    return mass_matrix(model, model.rest).toarray()


def test_an_article_of_another_mass_has_the_places_of_the_first_and_its_own_numbers(dm, lab):
    (heavier,) = find_parameters(dm, lab, ["node.n1.mass"])
    other, _ = set_parameter(dm, lab, heavier, 2.0)
    first, second = mesh_structure(dm), mesh_structure(other)
    assert second.pattern is first.pattern
    assert second.pose_map.layout.indices is first.pose_map.layout.indices
    shared = mass_of(other)
    for places in (pattern._laid_out, offset_points._lay_out):
        places.cache_clear()
    np.testing.assert_array_equal(mass_of(other), shared)
    assert not np.array_equal(shared, mass_of(dm))


def test_another_mesh_and_an_arm_where_there_was_none_have_places_of_their_own(dm):
    first = mesh_structure(dm)
    assert mesh_structure(refine_mesh(dm, 2)).pattern is not first.pattern
    points = first.points
    drawn = np.flatnonzero(~np.any(points.offset != 0.0, axis=1))[0]
    offset = points.offset.copy()
    offset[drawn] = [0.1, 0.0, 0.0]
    bent = offset_points.map_points(first.tree, dataclasses.replace(points, offset=offset))
    assert len(bent.special.point) == len(first.pose_map.special.point) + 1
    assert len(bent.layout.indices) == len(first.pose_map.layout.indices) + 6


def test_as_many_elements_between_other_points_have_places_of_their_own(dm):
    """The sum over elements, with a Jacobian that is dense, is that of either list of ends."""
    points = mesh_structure(dm).pose_map
    values = np.random.default_rng(0).standard_normal(len(points.layout.indices))
    shape = 6 * len(points.points.frame), points.tree.size
    laid = points.layout
    A = csr_of(values * (laid.constant != 1.0) + laid.constant, laid.indices, laid.indptr, shape)
    drawn = np.flatnonzero(np.any(points.points.offset != 0.0, axis=1))[:3]
    for ends in (drawn[[[0, 1], [1, 2]]], drawn[[[0, 1], [0, 2]]]):
        blocks = np.random.default_rng(1).standard_normal((2, 12, 12))
        blocks = blocks + blocks.transpose(0, 2, 1)
        found = pattern.lay_out_pattern(points, {"strut": ends}).matrix(A.data, {"strut": blocks})
        rows = (6 * ends[:, :, None] + np.arange(6)).reshape(2, 12)
        truth = sum(A.toarray()[row].T @ B @ A.toarray()[row] for row, B in zip(rows, blocks, strict=True))
        np.testing.assert_allclose(found.toarray(), truth, atol=1e-12)


def test_an_arm_at_another_point_has_places_of_its_own(dm):
    first = mesh_structure(dm)
    points, moved = first.points, []
    for drawn in np.flatnonzero(~np.any(points.offset != 0.0, axis=1))[:2]:
        offset = points.offset.copy()
        offset[drawn] = [0.1, 0.0, 0.0]
        bent = offset_points.map_points(first.tree, dataclasses.replace(points, offset=offset))
        moved.append(np.flatnonzero(np.diff(bent.layout.indptr) > np.diff(first.pose_map.layout.indptr)) // 6)
        assert set(moved[-1]) == {drawn}


def test_a_large_pattern_is_not_kept(dm, monkeypatch):
    """Sixteen of a million coordinates would hold 5 GB for good."""
    kept = mesh_structure(dm).pattern
    monkeypatch.setattr(pattern, "LARGEST", len(kept.indptr) - 2)
    alone = mesh_structure(dm).pattern
    assert alone is not kept
    np.testing.assert_array_equal(alone.indices, kept.indices)


def test_a_large_layout_of_points_is_not_kept(dm, monkeypatch):
    kept = mesh_structure(dm).pose_map
    monkeypatch.setattr(offset_points, "LARGEST", len(kept.points.frame) - 1)
    alone = mesh_structure(dm).pose_map
    assert alone.layout.indices is not kept.layout.indices
    np.testing.assert_array_equal(alone.layout.indices, kept.layout.indices)


def test_what_articles_share_cannot_be_written_to(dm):
    """Matrices keep the places unchecked: one that sorted its own in place would sort those of all."""
    model = mesh_structure(dm)
    groups = (a for parts in model.pattern.groups.values() for part in parts for a in part)
    of_matrix, of_map = vars(model.pattern), vars(model.pose_map.layout)
    shared = [a for a in (*of_matrix.values(), *of_map.values(), *groups) if isinstance(a, np.ndarray)]
    assert len(shared) > len(of_map)
    assert not any(a.flags.writeable for a in shared)


@pytest.mark.parametrize("states", [0, 1, 2, 7, 40])
def test_a_schur_form_is_that_of_scipy(states):
    A = np.random.default_rng(states).standard_normal((states, states))
    for ours, theirs in zip(real_schur(A), scipy.linalg.schur(A), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_a_complex_matrix_has_no_real_schur_form():
    """LAPACK would take its real parts, and say so in a warning of NumPy at most."""
    with pytest.raises(TypeError, match="complex"):
        real_schur(np.array([[1.0j]]))
