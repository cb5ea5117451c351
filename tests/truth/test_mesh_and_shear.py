"""What a model leaves out of shear and mesh: closed forms, truths in shear, sections that are not round."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.optimize as opt
from test_updating import MODULUS, TOP, clamped, mast, modes_of, survey_of

import structure_builders as build
from middeck.structure.correlation.measured_modes import MeasurementNoise
from middeck.structure.model.article import Structure
from middeck.structure.model.finer_mesh import TUBE_SHEAR, add_shear, refine_mesh
from middeck.structure.model.section import Section
from middeck.structure.modes.solve import Modes
from middeck.updating.orbit.predicted_frequencies import predict_modes
from middeck.updating.refinement.findings import findings
from middeck.updating.refinement.mesh_and_shear import left_out
from middeck.updating.refinement.refine import Refined, refine
from repeats import repeats

EI, EA, RHO_A = 50.0, 1e5, 0.3
KNOWN_WELL = MeasurementNoise(1e-5, 1e-3)


def slender(article: Structure) -> Structure:
    """The mast drawn without shear, its radius of gyration 10 mm, in eight elements."""
    (member,) = article.members
    section = dataclasses.replace(member.section, EA=5.0 * EA, GA_y=np.inf, GA_z=np.inf)
    return dataclasses.replace(article, members=(dataclasses.replace(member, section=section, elements=8),))


def cantilever(elements: int) -> Structure:
    section = Section(EA=EA, GJ=0.8 * EI, EI_y=EI, EI_z=EI, rho_A=RHO_A, rho_I_y=0.0, rho_I_z=0.0)
    nodes = [build.node("foot", (0, 0, 0)), build.node("top", (0, 1, 0))]
    return build.structure(nodes, [build.member("foot", "top", section, elements, up=(0.0, 0.0, 1.0))])


def stiff_in_shear(elements: int) -> Modes:
    """Of the cantilever drawn with a millionth of a tube's shear and less: it lacks elements alone."""
    return modes_of(add_shear(cantilever(elements), 1e-9), clamped(0.0))


def shear_forces(count: int) -> np.ndarray:
    """EI w''' of the lowest modes of a clamped beam of a metre, a row a mode, at even points."""
    x, found = np.linspace(0.0, 1.0, 20_001), []
    for k in range(count):
        ends = max(k * np.pi, 1.0), (k + 1.0) * np.pi
        beta = opt.brentq(lambda b: np.cos(b) + 1.0 / np.cosh(b), *ends)
        s = (np.cos(beta) + np.cosh(beta)) / (np.sin(beta) + np.sinh(beta))
        c, ch, n, sh = np.cos(beta * x), np.cosh(beta * x), np.sin(beta * x), np.sinh(beta * x)
        w, w3 = ch - c - s * (sh - n), beta**3 * (sh - n - s * (ch + c))
        found.append(EI * w3 / np.sqrt(RHO_A * np.mean(w**2)))
    return np.array(found)


def test_shear_of_a_cantilever_is_that_of_its_exact_modes():
    """- integral of V_i V_j / kGA: elements have the mean of V, so that errors fall with their square."""
    V = shear_forces(3)
    exact = -(V @ V.T) / V.shape[1] / (TUBE_SHEAR * 0.4 * EA)
    size, off = np.sqrt(np.outer(np.diag(exact), np.diag(exact))), []
    for elements in (12, 24):
        modes = modes_of(cantilever(elements), clamped(0.0))
        plane = np.flatnonzero(np.abs(modes.shapes[6]) > 1e-6)[:3]  # x of the tip
        found = left_out(modes, plane) - left_out(stiff_in_shear(elements), plane)
        off.append(np.abs(np.abs(found / size) - np.abs(exact / size)).max())
    assert off[1] < 5e-3
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("elements", repeats([8, 12]))
def test_it_is_what_a_finer_mesh_in_shear_changes(elements: int):
    """A hundredth of the shear, solved anew; and four times the elements of members that lack no shear."""
    drawn, place = cantilever(elements), clamped(0.0)
    modes, index = modes_of(drawn, place), np.arange(4)
    lam = modes.omega[index] ** 2
    moved = modes_of(add_shear(drawn, 0.01), place).omega[index] ** 2 - lam
    finer = modes_of(refine_mesh(add_shear(drawn, 1e-9), 4), place).omega[index] ** 2 - lam
    mesh = np.diag(left_out(stiff_in_shear(elements), index))
    np.testing.assert_allclose(0.01 * (np.diag(left_out(modes, index)) - mesh), moved, rtol=0.02)
    np.testing.assert_allclose(mesh, finer, rtol=0.05)


def recovered(part: float, seed: int, chosen: range = range(6)) -> Refined:
    """The mast without shear on modes of one that has so much of a tube's, and a heavier top."""
    truth = modes_of(add_shear(slender(mast(mass=0.42)), part), clamped())
    return refine(slender(mast()), [survey_of(truth, KNOWN_WELL, seed, chosen)], [MODULUS, TOP])


def test_a_negative_amount_of_shear_is_reported_to_be_another_error():
    """Frequencies as far above those of the mast without shear as a tube's shear would put them below."""
    plain, soft = (
        modes_of(article, clamped()) for article in (slender(mast()), add_shear(slender(mast()), 1.0))
    )
    seen = survey_of(plain, KNOWN_WELL)
    hz = plain.frequency_hz[:6] ** 2 / soft.frequency_hz[:6]
    measured = dataclasses.replace(seen.measured, frequency_hz=hz, frequency_std_hz=1e-5 * hz)
    found = refine(slender(mast()), [dataclasses.replace(seen, measured=measured)], [MODULUS, TOP])
    assert found.shear[0] < -2.0 * found.shear[1]
    assert any(
        "it cannot be negative: another error shifts all modes one way" in line for line in findings(found)
    )


IN_SHEAR = [(1.0, 0), (0.0, 1), (0.5, 2), (1.5, 3), (1.0, 4), (0.2, 5), (2.0, 6), (0.8, 7)]


@pytest.mark.parametrize(("part", "seed"), repeats(IN_SHEAR))
def test_shear_is_no_error_of_the_numbers(part: float, seed: int):
    """The modulus is right to 0.03 %; one that takes up a tube's shear is 0.7 % too low, the top as much."""
    found = recovered(part, seed)
    shown, std = found.shear
    assert abs(shown - part) < max(3.0 * std, 0.04 * part)
    off = found.x - [0.0, np.log(1.05)]
    assert np.abs(off).max() < 3e-4
    assert np.abs(off / found.estimate.x_std).max() < 3.0
    warnings = [one for one in findings(found) if "shear" in one]
    assert bool(warnings) == (part > 2.0 * std)


@pytest.mark.parametrize("part", repeats([1.0, 0.0, 0.6]))
def test_modes_that_no_survey_saw_have_the_shear_that_others_showed(part: float):
    """Refined on four modes, told of eight, of which shear moves the last by 2.2 %."""
    truth = add_shear(slender(mast(mass=0.42)), part)
    predicted = predict_modes(recovered(part, 0, range(4)), clamped(0.0), count=8)
    error = np.log(predicted.frequency_hz / modes_of(truth, clamped(0.0)).frequency_hz[:8])
    assert np.abs(error).max() < 2e-3
    assert np.abs(error / predicted.log_std).max() < 3.0


def test_a_draw_has_the_shear_of_the_estimate():
    """At the middle of the posterior what was shown; a deviation of it away along its own row."""
    found = recovered(1.0, 0)
    shown, std = found.shear
    along = found.estimate.root[len(found.unknowns)] / std
    x, middle = found.drawn_at(np.zeros(len(along)))
    np.testing.assert_array_equal(x, found.x)
    assert middle == shown
    assert found.drawn_at(along)[1] == pytest.approx(shown + std)
    article = slender(mast())
    assert add_shear(article, 0.0) is add_shear(article, -0.3) is article


def test_a_plate_is_not_as_soft_in_shear_as_it_is_in_torsion():
    """20 mm by 1 mm, G = E/2.6: GJ over the bending stiffnesses would give a hundredth of G."""
    wide, thick, E = 0.02, 0.001, 7e10
    section = Section(
        EA=E * wide * thick, GJ=E / 2.6 * wide * thick**3 / 3.0, EI_y=E * wide**3 * thick / 12.0,
        EI_z=E * wide * thick**3 / 12.0, rho_A=0.05, rho_I_y=0.0, rho_I_z=0.0,
    )  # fmt: skip
    article = cantilever(1)
    (member,) = article.members
    plate = dataclasses.replace(article, members=(dataclasses.replace(member, section=section),))
    found = add_shear(plate, 1.0).members[0].section
    assert found.GA_y == found.GA_z == pytest.approx(TUBE_SHEAR * E / 2.6 * wide * thick, rel=0.2)


def test_a_cross_of_two_plates_has_the_shear_of_its_area():
    """60 x 3 mm each: equal bending stiffnesses, hardly any torsion, k G A about half of G A."""
    E, width, t = 7e10, 0.06, 0.003
    area, second = width * t * 2.0 - t * t, (t * width**3 + (width - t) * t**3) / 12.0
    section = Section(EA=E * area, GJ=E / 2.6 * 2.0 * width * t**3 / 3.0, EI_y=E * second, EI_z=E * second,
                      rho_A=2700.0 * area, rho_I_y=0.0, rho_I_z=0.0)  # fmt: skip
    nodes = [build.node("foot", (0, 0, 0)), build.node("top", (0, 1, 0))]
    cross = build.structure(nodes, [build.member("foot", "top", section, 2, up=(0.0, 0.0, 1.0))])
    found = add_shear(cross, 1.0).members[0].section
    assert 0.3 < found.GA_y / (E / 2.6 * area) < 0.7
    assert found.GA_y == found.GA_z
