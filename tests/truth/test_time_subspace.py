import numpy as np
import pytest

from middeck.identification.record_fit.time_subspace import compress_past, observability, record_poles

Z = np.array([0.95 * np.exp(0.7j), 0.9 * np.exp(1.9j)])


def a_system():
    rng = np.random.default_rng(4)
    A = np.zeros((4, 4))
    for k, z in enumerate(Z):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[z.real, -z.imag], [z.imag, z.real]]
    return A, rng.standard_normal((4, 2)), rng.standard_normal((2, 4)), rng.standard_normal((2, 2))


def run(count, seed, noise=0.0):
    rng = np.random.default_rng(seed)
    A, B, C, D = a_system()
    u, e = rng.standard_normal((2, count, 2))
    w, x = np.zeros(2), rng.standard_normal(4)
    y = np.empty((count, 2))
    for k in range(count):
        w = 0.9 * w + e[k]  # coloured output noise
        y[k] = C @ x + D @ u[k] + noise * w
        x = A @ x + B @ u[k]
    return u, y


def distance(z):
    truth = np.concatenate([Z, Z.conj()])
    return max(np.abs(z - t).min() for t in truth)


@pytest.mark.parametrize("weighting", ["moesp", "cva", "n4sid"])
def test_exact_records_give_the_exact_poles(weighting):
    u, y = run(300, 0)
    # Directions of the past beyond the four states are rounding; poles keep nine digits of it.
    assert distance(record_poles(compress_past([u], [y], 6), weighting, 4)) < 1e-8


@pytest.mark.parametrize("weighting", ["moesp", "cva", "n4sid"])
def test_coloured_noise_leaves_no_bias(weighting):
    def error(count, seed):
        u, y = run(count, seed, noise=0.3)
        # Two states more, for the poles of the noise of either output.
        return distance(record_poles(compress_past([u], [y], 8), weighting, 6))

    few = np.sqrt(np.mean([error(500, seed) ** 2 for seed in range(6)]))
    many = error(8000, 0)
    # 16 times the samples: a scatter falls by 4 (by 2 with what one seed leaves open), a bias would stay.
    assert many < 0.5 * few


def test_chunks_and_experiments_are_one_least_squares_problem():
    u, y = run(20000, 2, noise=0.1)
    whole = compress_past([u], [y], 3)
    # The triangle's square is the sum over columns, whatever the order they came in.
    windows = np.arange(20000 - 5)[:, None] + np.arange(6)
    U, Y = u[windows], y[windows]
    rows = np.hstack([U[:, 3:].reshape(-1, 6), U[:, :3].reshape(-1, 6), Y.reshape(-1, 12)])
    np.testing.assert_allclose(whole.L @ whole.L.T, rows.T @ rows, atol=1e-8 * np.abs(rows.T @ rows).max())
    two = compress_past([u[:9000], u[9000:]], [y[:9000], y[9000:]], 3)
    kept = np.r_[0 : 9000 - 5, 9000 : 20000 - 5]
    np.testing.assert_allclose(two.L @ two.L.T, rows[kept].T @ rows[kept], rtol=1e-6, atol=1e-4)


def test_too_few_samples_or_rows_have_no_poles():
    u, y = run(40, 3)
    assert compress_past([u], [y], 6) is None
    past = compress_past([u], [y], 2)
    assert record_poles(past, "moesp", 3) is None
    assert observability(past, "cva").shape == (4, 4)
