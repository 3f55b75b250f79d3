"""Models from .mat files, read in a process of their own: whatever the file, this process goes on."""

import os
import random
import sys

import numpy as np
import pytest
import scipy.io
from scipy import sparse

from switchctl import FormatError
from switchctl.load_model import load_model

A = np.moveaxis(np.array([[[0.5, 0.1], [0.0, 0.3]], [[0.2, 0.0], [0.4, 0.1]]]), 0, -1)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"A": sparse.eye_array(2).tocsc()}, r"A is a sparse matrix; save full\(A\)"),
        ({"A": {"field": 1.0}}, "A must hold real numbers, words or cells of them, not void"),
        ({"A": A * 1j}, "A must hold real numbers.* not complex128"),
        ({"A": A, "K": 1.0}, "holds 'K'; expected only A,"),
        ({"A": A, "info": {"who": "me"}}, "holds 'info'; expected only A,"),
        ({"Q": np.eye(2)}, "holds no A"),
        ({}, "holds nothing"),
    ],
    ids=["sparse", "struct", "complex", "stray", "stray struct", "no A", "empty"],
)
def test_what_is_no_model_is_a_format_error(tmp_path, content, words):
    scipy.io.savemat(tmp_path / "m.mat", content)
    with pytest.raises(FormatError, match=words):
        load_model(str(tmp_path / "m.mat"))


@pytest.mark.parametrize("compressed", [False, True])
def test_a_damaged_file_is_a_format_error_or_a_model(tmp_path, compressed):
    path = tmp_path / "m.mat"
    scipy.io.savemat(path, {"A": A, "dt": 0.1, "mean": [1.0, 2.0]}, do_compression=compressed)
    content, rng = path.read_bytes(), random.Random(3)
    for _ in range(4):
        damaged = bytearray(content)
        for _ in range(8):
            damaged[rng.randrange(128, len(content))] ^= 1 << rng.randrange(8)
        for each in (damaged, content[: rng.randrange(len(content))]):
            path.write_bytes(each)
            try:
                load_model(str(path))
            except (FormatError, ValueError, TypeError):
                pass


def test_newer_files_are_refused_with_what_to_do(tmp_path):
    path = tmp_path / "m.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(100))
    with pytest.raises(FormatError, match="version 7 or older, save -v7"):
        load_model(str(path))


@pytest.mark.parametrize(
    ("script", "words"),
    [("kill -9 $$", "its reader ended with code -9"), ("sleep 9", "could not be read in 0.2 s; save it again")],
    ids=["killed", "hanging"],
)
def test_a_reader_that_dies_or_hangs_is_a_format_error(tmp_path, monkeypatch, script, words):
    (tmp_path / "reader").write_text(f"#!/bin/sh\nexec 2>&-\n{script}\n")
    os.chmod(tmp_path / "reader", 0o755)
    scipy.io.savemat(tmp_path / "m.mat", {"A": A})
    monkeypatch.setattr(sys, "executable", str(tmp_path / "reader"))
    monkeypatch.setattr("switchctl.load_model._SECONDS", 0.2 if "sleep" in script else 30)
    with pytest.raises(FormatError, match=words):
        load_model(str(tmp_path / "m.mat"))


def test_memory_is_limited(tmp_path, monkeypatch):
    pytest.importorskip("resource")
    monkeypatch.setattr("switchctl.load_model._BYTES", 1 << 28)
    scipy.io.savemat(tmp_path / "m.mat", {"A": np.zeros((5000, 5000))}, do_compression=True)  # 200 MB in 0.2 MB
    with pytest.raises(FormatError, match="MemoryError"):
        load_model(str(tmp_path / "m.mat"))


def test_cells_and_means_are_read_in_matlabs_order(tmp_path):
    """By columns, as A{k} and mean(:)."""
    cells = np.empty((2, 2), dtype=object)
    for k, a in enumerate([0.5, 0.6, 0.7, 0.8]):
        cells[k % 2, k // 2] = np.array([[a]])
    scipy.io.savemat(tmp_path / "cells.mat", {"A": cells, "Q": np.arange(1.0, 5.0).reshape(1, 1, 4)})
    modes = load_model(tmp_path / "cells.mat").modes
    np.testing.assert_array_equal(modes.A.ravel(), [0.5, 0.6, 0.7, 0.8])
    np.testing.assert_array_equal(modes.Q.ravel(), [1.0, 2.0, 3.0, 4.0])
    scipy.io.savemat(tmp_path / "mean.mat", {"A": 0.5 * np.eye(4), "mean": [[1.0, 3.0], [2.0, 4.0]], "cov": np.eye(4)})
    np.testing.assert_array_equal(load_model(tmp_path / "mean.mat").initial_state.mean, [1.0, 2.0, 3.0, 4.0])
