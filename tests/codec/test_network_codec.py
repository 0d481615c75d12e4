"""Networks as bytes: what is told is read, in the place and of the size it was told; the error asked for is met; damage is noticed."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import CodecError, InputError, MeshError, decode, decode_network, encode, encode_network, sample
from morphlet.codec import network_stream, orthogonal
from morphlet.codec.atoms import AFFINE, FINEST_LEVEL, ODD, STEEP, TURNS, VOICES, Atoms, compass, dilations, kinds_of, levels_up_to, turned
from morphlet.codec.network import NetworkEncoder, NetworkOptions, area_map, network_at, network_of_bytes, read_network
from morphlet.codec.network_fit import named, quantised, selected, settled
from morphlet.codec.network_stream import Head, read_payloads, write_network
from morphlet.codec.surface_error import surface_error
from morphlet.numerics.unit_sphere import fibonacci
from morphlet.surface.mesh import Mesh
from morphlet.wavenet.mothers import MOTHERS, PAPER_SIX
from morphlet.wavenet.spherical import spherical_library
from support import tetrahedron, torus

LEVELS = levels_up_to(4)
BLOB = sample("blob", n_vertices=1500)
OPTIONS = NetworkOptions(finest=3, level=4)
MAPPED = area_map(BLOB)
ENCODER = NetworkEncoder.prepare(MAPPED, 150, OPTIONS)
FILE = ENCODER.of_bytes(480)
HEAD = Head(tuple(range(6)), -100, 4, 5)


def atoms_of(keys: list[tuple[int, int, int, int]]) -> Atoms:
    """Wavelets of (band, place, mother, turn), in the order of a file; places and turns are made to fit."""
    fitting = {(b, c % len(LEVELS[b // VOICES].points), k, t if ODD[k] else 0) for b, c, k, t in keys}
    return Atoms(*np.array(sorted(fitting), np.int64).reshape(-1, 4).T.copy())


KEYS = st.lists(st.tuples(st.integers(0, 9), st.integers(0, 3000), st.integers(0, 5), st.integers(0, TURNS - 1)), max_size=30)
SYMBOLS = st.one_of(st.integers(-3, 3), st.integers(-(2**38), 2**38))


@given(KEYS, st.data())
def test_what_is_told_is_read(keys, data):
    atoms = atoms_of(keys)
    rows = data.draw(st.lists(st.tuples(SYMBOLS, SYMBOLS, SYMBOLS), min_size=AFFINE + len(atoms), max_size=AFFINE + len(atoms)))
    symbols = np.array(rows, np.int64)
    payloads = write_network(HEAD, atoms, symbols, LEVELS)
    head, found, back, _ = read_payloads([*payloads[:-1], payloads[-1]])
    assert head == HEAD
    for name in ("bands", "centers", "kinds", "turns"):
        assert np.array_equal(getattr(found, name), getattr(atoms, name)), name
    assert np.array_equal(back, symbols)


def test_levels_are_nested_and_their_neighbours_near():
    for level, (coarse, fine) in enumerate(pairwise(LEVELS)):
        assert len(fine.points) == 10 * 4 ** (level + 1) + 2
        assert np.array_equal(fine.points[: len(coarse.points)], coarse.points)
        middle = coarse.points[fine.parents].sum(axis=1)
        assert np.allclose(fine.points, middle / np.linalg.norm(middle, axis=1, keepdims=True), atol=1e-15)
    finest = LEVELS[-1]
    count = (finest.neighbours >= 0).sum(axis=1)
    assert sorted(np.unique(count, return_counts=True)[1]) == [12, len(count) - 12]
    for v in range(0, len(count), 97):
        distance = np.linalg.norm(finest.points - finest.points[v], axis=1)
        ring = finest.neighbours[v, : count[v]]
        assert set(ring) == set(np.argsort(distance)[1 : 1 + count[v]])


def test_widths_are_those_of_the_library():
    library = spherical_library([MOTHERS["beta2"]], fibonacci(3000), np.ones(3000), levels=3, voices=VOICES)
    assert np.allclose(dilations(library.bands), library.dilations, rtol=1e-15)


def test_directions_are_unit_tangents_that_no_rounding_can_change():
    points = np.concatenate([level.points for level in levels_up_to(FINEST_LEVEL)])
    assert np.abs(np.abs(points[:, 2]) - STEEP).min() > 1e-5
    east, north = compass(points)
    frames = np.stack([east, north, points], axis=1)
    assert np.allclose(frames @ frames.transpose(0, 2, 1), np.eye(3), atol=1e-14)
    turn = turned(points[:5], np.array([0, 4, 2, 1, 7]))
    assert np.allclose(turn[0], east[0])
    assert np.allclose(turn[1], north[1])


@given(KEYS.filter(lambda keys: len(keys) > 0))
@settings(max_examples=30)
def test_wavelets_of_a_network_get_their_numbers_back(keys):
    atoms = atoms_of(keys)
    found = named(atoms.network(LEVELS, np.zeros((AFFINE + len(atoms), 3))), LEVELS)
    for name in ("bands", "centers", "kinds", "turns"):
        assert np.array_equal(getattr(found, name), getattr(atoms, name)), name


def dense_terms(atoms: Atoms) -> np.ndarray:
    """Terms at the reference points, scaled so that sums are means."""
    points = LEVELS[-1].points
    return orthogonal.terms_at(atoms, LEVELS, points).toarray() / np.sqrt(len(points))


def test_coefficients_are_those_of_a_qr_factorization_and_their_errors_add_up():
    atoms = ENCODER.choice.atoms
    A = dense_terms(atoms)
    upper, dependent = orthogonal.factor(orthogonal.products(atoms, LEVELS, LEVELS[-1].points), orthogonal.REMAINDER)
    assert dependent == -1
    R = np.linalg.qr(A)[1]
    R *= np.sign(np.diag(R))[:, None]
    assert np.allclose(np.triu(upper), R, atol=1e-9 * np.abs(R).max())
    rng = np.random.default_rng(0)
    u, error = rng.normal(size=(A.shape[1], 3)), 0.01 * rng.normal(size=(A.shape[1], 3))
    gram = orthogonal.products(atoms, LEVELS, LEVELS[-1].points)
    moved = A @ (orthogonal.weights(gram, u + error) - orthogonal.weights(gram, u))
    assert np.isclose((moved**2).sum(), (error**2).sum(), rtol=1e-8)


def test_the_first_terms_need_none_of_those_that_follow():
    atoms = ENCODER.choice.atoms
    gram = orthogonal.products(atoms, LEVELS, LEVELS[-1].points)
    whole, _ = orthogonal.factor(gram, orthogonal.REMAINDER)
    part, _ = orthogonal.factor(gram[:40, :40], orthogonal.REMAINDER)
    assert np.array_equal(np.triu(whole)[:40, :40], np.triu(part))


def test_sums_over_points_are_the_same_by_sparse_and_dense_products(monkeypatch):
    wide = atoms_of([(b, c, k, 0) for b in (0, 1, 2) for c in range(12) for k in (0, 4)])
    dense = orthogonal.products(wide, LEVELS, LEVELS[-1].points)
    monkeypatch.setattr(orthogonal, "DENSE", 2.0)
    assert np.allclose(orthogonal.products(wide, LEVELS, LEVELS[-1].points), dense, rtol=1e-12, atol=1e-14)


def test_another_rounding_of_the_wavelets_moves_no_point_by_a_billionth(monkeypatch):
    mesh = read_network(FILE.payloads).mesh()
    rng = np.random.default_rng(0)
    exact = orthogonal.terms_at

    def shaken(*arguments):
        terms = exact(*arguments)
        return sp.csr_matrix(terms.multiply(1 + 4e-16 * rng.choice([-1, 0, 1], terms.shape)))

    monkeypatch.setattr(orthogonal, "terms_at", shaken)
    other = read_network(FILE.payloads).mesh()
    assert 0 < np.abs(other.vertices - mesh.vertices).max() < 1e-9 * BLOB.bbox_diagonal


def test_bytes_are_kept_and_used():
    for size in (70, 250):
        file = ENCODER.of_bytes(size)
        assert 0.93 * size < sum(map(len, file.payloads)) <= size
    assert FILE.report.bytes == sum(map(len, FILE.payloads))


def test_more_bytes_come_nearer():
    errors = [ENCODER.of_bytes(size).report.rms for size in (80, 200)]
    assert errors[0] > 2 * errors[1] > 3 * FILE.report.rms


def test_the_report_is_what_a_reader_finds():
    decoded = read_network(FILE.payloads)
    found = surface_error(BLOB, decoded.mesh())
    assert (FILE.report.rms, FILE.report.hausdorff) == (found.rms, found.hausdorff)
    assert FILE.report.wavelets == len(decoded.network) == sum(FILE.report.counts.values())
    assert FILE.level == decoded.level == 4


def test_the_error_asked_for_is_met_with_few_bytes():
    rms = 2 * FILE.report.rms
    file = network_at(MAPPED, rms, OPTIONS)
    assert 0.8 * rms < file.report.rms <= rms
    assert file.report.bytes < FILE.report.bytes


def test_an_error_out_of_reach_is_none():
    assert network_at(MAPPED, 1e-4 * BLOB.bbox_diagonal, NetworkOptions(finest=1, level=3)) is None


def test_first_payloads_are_the_coarse_part():
    assert len(FILE.payloads) == 2
    head, atoms, symbols, _ = read_payloads(FILE.payloads)
    _, coarse, first, _ = read_payloads(FILE.payloads[:1])
    k = len(coarse)
    assert 0 < k < len(atoms)
    assert np.array_equal(first, symbols[: AFFINE + k])
    whole, part = (read_network(p).network(LEVELS[-1].points) for p in (FILE.payloads, FILE.payloads[:1]))
    left = dense_terms(atoms)[:, : AFFINE + k].T @ (whole - part)
    assert np.abs(left).max() < 1e-9, "what is missing is orthogonal to what is there"
    rest = ((whole - part) ** 2).sum() / len(whole)
    assert np.isclose(rest, ((symbols[AFFINE + k :] * head.step) ** 2).sum(), rtol=1e-7)
    assert surface_error(BLOB, read_network(FILE.payloads[:1]).mesh()).rms > FILE.report.rms


def test_any_resolution_is_of_one_surface():
    decoded = read_network(FILE.payloads)
    fine, coarse = decoded.mesh(5), decoded.mesh(2)
    assert len(coarse.vertices) == 162
    assert np.allclose(fine.vertices[:162], coarse.vertices, atol=1e-12)
    assert fine.topology.euler_characteristic == 2
    with pytest.raises(InputError, match="level from 0 to 8"):
        decoded.mesh(9)


def test_normals_point_outwards():
    mesh = read_network(FILE.payloads).mesh()
    volume = np.einsum("mc,mc->", mesh.vertices[mesh.faces[:, 0]], np.cross(*(mesh.vertices[mesh.faces[:, k]] for k in (1, 2)))) / 6
    assert volume > 0


def test_size_and_place_do_not_matter():
    moved = Mesh(1000 * (BLOB.vertices + np.array([50.0, -20.0, 7.0])), BLOB.topology)
    file = network_of_bytes(moved, 300, OPTIONS)
    here = ENCODER.of_bytes(300)
    assert np.isclose(file.report.rms, 1000 * here.report.rms, rtol=0.15)
    with pytest.raises(InputError, match="nearer to the origin"):
        network_of_bytes(Mesh(BLOB.vertices + 1e12, BLOB.topology), 300, OPTIONS)


def test_last_fit_lets_points_slide_and_comes_nearer():
    step = 2e-4 * BLOB.bbox_diagonal
    part = selected(ENCODER.choice, step)
    errors = []
    for p in (part, settled(ENCODER.choice, part)):
        atoms, symbols = quantised(ENCODER.choice, p, step)
        weights = orthogonal.weights(orthogonal.products(atoms, LEVELS, LEVELS[-1].points), symbols * step)
        mesh = Mesh(atoms.network(LEVELS, weights)(LEVELS[-1].points), read_network(FILE.payloads).mesh(4).topology)
        errors.append(surface_error(BLOB, mesh).rms)
    assert errors[1] < 0.95 * errors[0]


def test_each_of_the_six_can_be_told():
    options = NetworkOptions(mothers=PAPER_SIX, finest=1, level=3)
    file = NetworkEncoder.prepare(MAPPED, 30, options).of_bytes(150)
    assert sum(count > 0 for count in file.report.counts.values()) >= 4
    assert file.report.rms < 0.02 * BLOB.bbox_diagonal


def test_any_change_of_a_payload_is_noticed_or_makes_a_network():
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(120):
        number = int(rng.integers(len(FILE.payloads)))
        bad = [bytearray(p) for p in FILE.payloads]
        bad[number][int(rng.integers(len(bad[number])))] ^= 1 << int(rng.integers(8))
        try:
            assert np.isfinite(read_network([bytes(p) for p in bad]).network.weights).all()
        except CodecError:
            refused += 1
    assert refused > 90


def test_every_cut_payload_is_refused():
    for cut in range(0, len(FILE.payloads[0]), 3):
        with pytest.raises(CodecError):
            read_network([FILE.payloads[0][:cut]])
    with pytest.raises(CodecError, match="without its beginning"):
        read_network([])
    with pytest.raises(CodecError):
        read_network([FILE.payloads[0] + b"\0"])


@settings(max_examples=80)
@given(st.binary(min_size=5, max_size=60))
def test_random_payloads_are_refused_or_read(noise):
    try:
        read_network([HEAD.encoded() + noise])
    except CodecError:
        return


@pytest.mark.parametrize(
    ("head", "message"),
    [
        (Head((), 0, 4, 5), "makes no sense"),
        (Head((4,), 32000, 4, 5), "makes no sense"),
        (Head((4,), 0, 0, 5), "makes no sense"),
        (Head((4,), 0, 7, 5), "makes no sense"),
        (Head((4,), 0, 4, 9), "makes no sense"),
    ],
)
def test_heads_that_make_no_sense_are_refused(head, message):
    with pytest.raises(CodecError, match=message):
        read_network([head.encoded() + b"\0\0\0\0\0\0\0"])


def test_a_wavelet_that_is_told_twice_is_refused():
    twice = Atoms(*(np.array([a, a]) for a in (4, 30, 4, 0)))
    symbols = np.ones((AFFINE + 2, 3), np.int64)
    with pytest.raises(CodecError, match="that others make up"):
        read_network(write_network(HEAD, twice, symbols, LEVELS))


def test_more_wavelets_than_bytes_are_refused(monkeypatch):
    atoms = ENCODER.choice.atoms
    payloads = write_network(HEAD, atoms, np.ones((AFFINE + len(atoms), 3), np.int64), LEVELS)
    monkeypatch.setattr(network_stream, "MOST_ATOMS", len(atoms) - 1)
    with pytest.raises(CodecError, match="cannot be read"):
        read_network(payloads)


def test_meshes_that_no_sphere_can_be_are_refused():
    open_mesh = Mesh(BLOB.vertices, type(BLOB.topology)(BLOB.faces[1:], BLOB.n_vertices))
    with pytest.raises(MeshError, match="closed surface"):
        network_of_bytes(open_mesh, 300, OPTIONS)
    with pytest.raises(MeshError, match="genus"):
        network_at(torus(), 0.1, OPTIONS)


def test_numbers_out_of_range_are_refused():
    with pytest.raises(InputError, match="at least 60 bytes"):
        ENCODER.of_bytes(59)
    with pytest.raises(InputError, match="error above 0"):
        ENCODER.of_error(0.0)
    with pytest.raises(InputError, match="mothers among"):
        NetworkOptions(mothers=(MOTHERS["slog2"],))
    with pytest.raises(InputError, match="finest from 0 to 5"):
        NetworkOptions(finest=6)
    with pytest.raises(InputError, match="a mesh of some size"):
        network_of_bytes(tetrahedron().with_vertices(1e-200 * tetrahedron().vertices), 300, OPTIONS)


def test_the_same_mesh_gives_the_same_bytes():
    assert NetworkEncoder.prepare(BLOB, 150, OPTIONS).of_bytes(480).payloads == FILE.payloads


def test_numbers_of_mothers_are_the_papers():
    assert kinds_of([PAPER_SIX[3], PAPER_SIX[0]]).tolist() == [3, 0]


def test_the_formats_test_vector():
    payload = bytes.fromhex("14a0ff34040030caa8562e718e1ae9fb4e2617d83996e5f7b301cf08e9c87eb839eb76b544c1")
    atoms = Atoms(*np.array([[0, 1, 3], [5, 11, 33], [4, 4, 2], [0, 0, 5]]))
    symbols = np.array([[10, 20, -30], [200, 1, 2], [3, 150, 0], [0, -4, 100], [40, -2, 7], [0, 9, -25], [-3, 0, 60]])
    assert write_network(Head((2, 4), -96, 3, 4), atoms, symbols, LEVELS) == [payload]
    places = read_network([payload]).network([[0, 0, 1], [0.6, 0, 0.8]])
    expected = [
        [0.4903064291420294, -0.023000780768470355, 3.0789165484913688],
        [3.5882874806967386, 0.10796788777294836, 2.175976157510555],
    ]
    assert np.allclose(places, expected, rtol=0, atol=1e-9)
    assert payload.hex() in (Path(__file__).parents[2] / "docs" / "format.md").read_text(encoding="utf-8")


def test_a_file_of_a_network_is_no_larger_than_asked_and_opens_at_any_level():
    blob = sample("blob", n_vertices=1500)
    data = encode_network(blob, size=700, options=NetworkOptions(level=4))
    assert 500 < len(data) <= 700
    network = decode_network(data)
    assert network.mesh(3).n_vertices == 642
    np.testing.assert_array_equal(network.mesh(4).vertices, decode(data)[0].vertices)


def test_what_is_no_file_of_a_network():
    blob = sample("blob", n_vertices=1500)
    with pytest.raises(InputError, match="at least 100 bytes; found 99"):
        encode_network(blob, size=99)
    with pytest.raises(CodecError, match="a file of a wavelet network; found one of mode exact"):
        decode_network(encode(blob, error=0.01).data)
