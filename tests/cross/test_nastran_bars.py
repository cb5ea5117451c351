"""Random decks of bars against the textbook's matrices: coordinates, offsets, links, masses, formulations."""

import numpy as np
import pytest
import scipy.linalg

import middeck as md
from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units
from middeck.structure.elements.beam import beam_properties
from middeck.structure.elements.beam_inertia import beam_mass
from middeck.structure.model.section import MemberMass, Section
from middeck.structure.summary.summary import summarise
from nastran_decks import random_deck, skew, textbook

# Reals of the decks have ten digits; a frequency loses some to the differences of coordinates.
DIGITS = 1e-6
SHIFT = 1e-6  # of the inverse problem, over the largest omega^2


def converted(tmp_path, deck, formulation):
    (tmp_path / "a.dat").write_text(deck.text)
    made = convert_deck(read_deck(tmp_path / "a.dat"), parse_units("m-kg-s-N"), formulation, "a")
    (tmp_path / "a.toml").write_text(document_text(made.document, "a"))
    return md.load_structure(tmp_path / "a.toml")


def frequencies(K, M):
    """By the inverse problem: some rotations have no mass, and their frequencies no end."""
    shift = SHIFT * np.linalg.norm(K) / np.linalg.norm(M)
    mu = scipy.linalg.eigh(M, K + shift * M, eigvals_only=True)[::-1]
    return np.sqrt(np.maximum(1.0 / mu[mu > 1e-13 * mu[0]] - shift, 0.0))


@pytest.mark.parametrize("formulation", ["consistent", "coupled", "lumped"])
def test_modes_and_masses_of_random_decks_are_those_of_the_textbook(tmp_path, campaign, formulation):
    for seed in campaign(80):
        deck = random_deck(seed, rods=True)
        structure = converted(tmp_path, deck, formulation)
        K, M = textbook(deck, formulation)
        omega = md.solve_modes(md.solve_equilibrium(structure, md.Environment.orbit())).omega
        assert np.all(omega[:6] == 0.0)
        assert omega[6] > 1.0
        np.testing.assert_allclose(omega[6:], frequencies(K, M)[6:], rtol=DIGITS)
        summary = summarise(structure)
        free = [deck.places[n] for n in deck.places if n not in deck.riders]
        rigid = np.vstack([np.block([[np.eye(3), -skew(x)], [np.zeros((3, 3)), np.eye(3)]]) for x in free])
        whole = rigid.T @ M @ rigid
        cross = summary.mass * skew(summary.centre)
        np.testing.assert_allclose(whole[:3, :3], summary.mass * np.eye(3), atol=1e-8 * summary.mass)
        np.testing.assert_allclose(whole[3:, :3], cross, atol=1e-7 * summary.mass)
        if formulation == "coupled":
            continue  # across its axis the mass of a coupled rod is at its ends, in the summary along it
        about = summary.inertia + summary.mass * skew(summary.centre).T @ skew(summary.centre)
        np.testing.assert_allclose(whole[3:, 3:], about, atol=1e-7 * np.trace(about))


def test_coupled_mass_is_that_of_a_bar_rigid_in_shear():
    """The numbers of subroutine BARD of NASTRAN-95, with K1 and K2 or without."""
    L, mass = 0.7, 3.0
    section = Section(
        EA=1e7,
        GJ=9.0,
        EI_y=8e3,
        EI_z=3e4,
        rho_A=mass / L,
        rho_I_y=0.0,
        rho_I_z=0.0,
        GA_y=2e5,
        GA_z=1e5,
        mass=MemberMass.COUPLED,
    )
    expected = np.zeros((12, 12))
    for places, sign in (((1, 5, 7, 11), 1.0), ((2, 4, 8, 10), -1.0)):
        turns = np.array([1.0, sign * L, 1.0, sign * L])
        block = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
        expected[np.ix_(places, places)] = block * np.outer(turns, turns)
    expected[np.ix_((0, 6), (0, 6))] = [[175, 35], [35, 175]]
    found = beam_mass(
        beam_properties([section], np.array([L])),
        np.array([[[0.0, 0, 0], [L, 0, 0]]]),
        np.tile(np.eye(3), (1, 2, 1, 1)),
    )
    np.testing.assert_allclose(found[0], expected * mass / 420.0, atol=1e-14)
