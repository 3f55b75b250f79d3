"""Model files of MATLAB, whole: damaged bytes through `load_model`, which reads each in a process of its own (slowly).

python fuzz/model_mat_file.py -max_total_time=600
"""

import io
import random
import tempfile
from pathlib import Path

import numpy as np
from checked_model import try_model
from mutations import run_bytes
from scipy.io import savemat

from switchctl.load_model import load_model

FILE = Path(tempfile.mkdtemp(prefix="fuzz-")) / "model.mat"


def seeds() -> list[bytes]:
    """Models of several versions of the format."""
    A = np.moveaxis(np.array([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]]), 0, -1)
    cells = np.empty((1, 2), dtype=object)
    cells[0, :] = [A[:, :, 0], A[:, :, 1]]
    names = np.array(["fast", "calm"], dtype=object)
    kinds = [
        ({"A": A}, {}),
        ({"A": cells, "names": names, "dt": 0.1, "mean": [1.0, 2.0], "cov": np.eye(2)}, {}),
        ({"A": A, "Q": np.eye(2), "dt": True, "mean": [[1.0], [2.0]]}, {"do_compression": True}),
        ({"A": np.array([[0.5]]), "mean": [3.0]}, {"format": "4"}),
    ]
    files = []
    for content, options in kinds:
        file = io.BytesIO()
        savemat(file, content, **options)
        files.append(file.getvalue())
    return files


def mutate(data: bytes, rng: random.Random) -> bytes:
    """Change some bytes behind the header, or the length."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        place = rng.randrange(min(120, len(changed) - 1), len(changed))
        changed[place] = rng.choice((0, 1, 5, 14, 15, 127, 128, 255, rng.randrange(256)))
    return bytes(changed[: rng.randrange(1, len(changed))] if rng.random() < 0.1 else changed)


def try_input(data: bytes) -> None:
    """Load it as a file."""
    FILE.write_bytes(data)
    try_model(lambda: load_model(str(FILE)))


if __name__ == "__main__":
    run_bytes(seeds(), mutate, try_input)
