"""Sets of modes."""

import copy
import pickle

import control
import numpy as np
import pytest
import scipy.sparse
from random_cases import random_modes

from switchctl import ModeSet

A = [[[0.9, 0.1], [0.0, 0.8]], [[0.5, 2.0], [0.0, 1.1]]]


def test_a_set_of_modes_is_a_sequence_with_names():
    modes = ModeSet(A, names=["slow", "fast"], dt=0.1)
    assert len(modes) == 2
    assert modes.A.shape == (2, 2, 2)
    assert [mode.name for mode in modes] == ["slow", "fast"]
    assert "slow" in modes and modes[1] in modes and "medium" not in modes
    assert modes[modes["fast"]].index == modes["fast"].index == modes[1].index == modes[-1].index == 1
    np.testing.assert_array_equal(modes["slow"].A, A[0])
    assert modes.dk == 0.1
    assert ModeSet(A).dk == 1.0
    assert ModeSet(A).names == ("A0", "A1")
    np.testing.assert_allclose(modes.spectral_radii, [0.9, 1.1])
    assert modes["fast"].spectral_radius == pytest.approx(1.1)
    assert modes.schur.tolist() == [True, False]
    assert modes.tails[1] is None


def test_a_mode_is_a_python_control_system_again():
    system = ModeSet(A, names=["slow", "fast"], dt=0.1, states=["angle", "rate"])["slow"].to_ss()
    assert isinstance(system, control.StateSpace)
    np.testing.assert_array_equal(system.A, A[0])
    assert (system.dt, system.name, system.state_labels) == (0.1, "slow", ["angle", "rate"])
    response = control.initial_response(system, 0.1 * np.arange(5), [1.0, 1.0])
    np.testing.assert_allclose(response.states[:, 4], np.linalg.matrix_power(A[0], 4) @ [1.0, 1.0])


def test_unusual_arrays_give_the_same_result():
    rng = np.random.default_rng(1)
    matrices = np.round(random_modes(rng, 3, 2), 2).astype(np.float32).astype(float)
    reference = ModeSet(matrices).A
    strided = np.zeros((4, 6, 6))
    strided[::2, ::2, ::2] = matrices
    readonly = matrices.copy()
    readonly.flags.writeable = False

    class Labelled(np.ndarray):
        pass

    for same in (
        matrices.astype(np.float32),
        np.asfortranarray(matrices),
        strided[::2, ::2, ::2],
        readonly,
        matrices.view(Labelled),
        matrices.tolist(),
        list(matrices),
        tuple(np.asfortranarray(m) for m in matrices),
    ):
        result = ModeSet(same).A
        assert type(result) is np.ndarray
        assert result.dtype == np.float64
        assert result.flags.c_contiguous
        np.testing.assert_array_equal(result, reference)
    np.testing.assert_array_equal(ModeSet([[[0, 1], [1, 0]]]).A, ModeSet([[[0.0, 1.0], [1.0, 0.0]]]).A)


def test_input_is_copied_and_the_set_is_read_only():
    matrices = np.array(A)
    modes = ModeSet(matrices)
    matrices[0, 0, 0] = 99.0
    assert modes.A[0, 0, 0] == 0.9
    with pytest.raises(AttributeError):
        modes.A = matrices
    twin = copy.deepcopy(modes)
    assert twin.names == modes.names
    assert (twin.dt, twin.states, twin.gains) == (modes.dt, modes.states, None)
    for array in (
        modes.A,
        modes.Q,
        modes.spectral_radii,
        modes.schur,
        modes.tails[0],
        pickle.loads(pickle.dumps(modes)).A,
        twin.A,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_repr_in_a_notebook():
    html = ModeSet(A, names=["<slow>", "fast"])._repr_html_()
    assert "&lt;slow&gt;" in html
    assert "<td>no</td>" in html


@pytest.mark.parametrize(
    ("matrices", "keywords", "error", "words"),
    [
        ([], {}, ValueError, r"shape \(0,\); expected \(m, n, n\)"),
        (np.zeros((0, 2, 2)), {}, ValueError, "m and n at least 1"),
        (np.zeros((2, 0, 0)), {}, ValueError, "m and n at least 1"),
        ([[[1.0, 2.0]]], {}, ValueError, r"\(1, 1, 2\)"),
        (np.eye(2), {}, ValueError, r"shape \(2, 2\)"),
        ([np.eye(2), np.eye(3)], {}, ValueError, r"\[\(2, 2\), \(3, 3\)\]"),
        ([np.eye(2), [[0, np.nan], [0, 0]]], {}, ValueError, r"matrices\[1\]\[0, 1\] is nan"),
        (np.array([np.eye(2), [[0, 0], [-np.inf, 0]]]), {}, ValueError, r"matrices\[1, 1, 0\] is -inf"),
        ([1j * np.eye(2)], {}, TypeError, "real numbers, not complex128"),
        ([np.array([[None, 1], [0, 1]])], {}, TypeError, "real numbers, not object"),
        ([[["a", "b"], ["c", "d"]]], {}, TypeError, "real numbers"),
        ([scipy.sparse.eye(2)], {}, TypeError, "toarray"),
        (np.ma.masked_array(np.zeros((1, 2, 2)), mask=True), {}, TypeError, "masked"),
        (3, {}, TypeError, "must be the A_i"),
        (A, {"names": ["a"]}, ValueError, "names has 1 entries; expected 2"),
        (A, {"names": ["a", "a"]}, ValueError, "'a' more than once"),
        (A, {"names": "ab"}, TypeError, "non-empty strings"),
        (A, {"names": ["a", ""]}, TypeError, "non-empty strings"),
        (A, {"dt": 0}, ValueError, "dt is 0"),
        (A, {"dt": None}, ValueError, "dt is None"),
        (A, {"dt": np.nan}, ValueError, "nan"),
        (A, {"dt": -1}, ValueError, "-1"),
        (A, {"dt": 10**400}, ValueError, "floating-point range"),
        (A, {"names": 3}, TypeError, "non-empty strings"),
        (A, {"Q": np.eye(3)}, ValueError, r"Q has shape \(3, 3\); expected \(2, 2\) or \(2, 2, 2\)"),
        (A, {"Q": [[1, 1], [0, 1]]}, ValueError, "Q is not symmetric"),
        (A, {"Q": [np.eye(2), -np.eye(2)]}, ValueError, "least eigenvalue is -1"),
        (A, {"gains": np.zeros((2, 1, 3))}, ValueError, r"gains has shape \(2, 1, 3\); expected \(2, any, 2\)"),
    ],
)
def test_wrong_input(matrices, keywords, error, words):
    with pytest.raises(error, match=words):
        ModeSet(matrices, **keywords)


def test_wrong_look_ups():
    modes = ModeSet(A, names=["slow", "fast"])
    with pytest.raises(KeyError, match="the modes are slow, fast"):
        modes["medium"]
    with pytest.raises(IndexError, match="mode 2 is out of range"):
        modes[2]
    for wrong in (True, 0.0, None):
        with pytest.raises(TypeError, match="index or its name"):
            modes[wrong]


def test_gains_are_read_only_and_weights_checked():
    modes = ModeSet(A, gains=np.ones((2, 1, 2)))
    with pytest.raises(ValueError, match="read-only"):
        modes.gains[0] = 2.0
    with pytest.raises(ValueError, match=r"Q\[0, 1\] is nan"):
        ModeSet(A, Q=[[1.0, np.nan], [np.nan, 1.0]])
