"""Print the variables of a .mat file as JSON: ``python mat_reader.py PATH BYTES``, BYTES the memory it may take.

scipy's reader is not hardened against damaged files. `load_model` runs this script in a process of its own, with a time
limit, so that a file which crashes it, exhausts its memory or keeps it busy ends here. It imports nothing of switchctl.
"""

import json
import sys
from typing import Any

KNOWN = {"A", "names", "states", "dt", "Q", "mean", "cov"}
"""What a model file may hold."""


def plain(value: Any, name: str) -> Any:
    """A variable as nested lists."""
    import numpy as np
    from scipy.sparse import issparse

    if issparse(value):
        raise TypeError(f"{name} is a sparse matrix; save full({name})")
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "biufUSO":
        kind = getattr(getattr(value, "dtype", None), "name", type(value).__name__)
        raise TypeError(f"{name} must hold real numbers, words or cells of them, not {kind} entries")
    return [plain(entry, name) for entry in value.ravel("F")] if value.dtype == object else value.tolist()  # as A{k}


def variables(path: str) -> dict[str, Any]:
    """What `ModeSet` and `Gaussian` take, matrices of each mode first to last."""
    import numpy as np
    from scipy.io import loadmat

    content = {key: value for key, value in loadmat(path).items() if not key.startswith("__")}
    found = {name: plain(value, name) if name in KNOWN else None for name, value in content.items()}
    for name in {"A", "Q"} & found.keys():
        # MATLAB stacks along the third axis; a cell array arrives as an array of objects.
        if content[name].dtype != object and (name == "A" or content[name].ndim == 3):
            found[name] = np.moveaxis(np.atleast_3d(content[name]), -1, 0).tolist()
    for name in {"names", "states"} & found.keys():
        words = [np.squeeze(word) for word in content[name].ravel("F")]
        if any(word.dtype == object for word in words):
            raise TypeError(f"{name} must be a cell of words, not of cells")
        found[name] = [str(word).strip() for word in words]
    if "dt" in found and content["dt"].size == 1:
        dt = content["dt"].item()
        found["dt"] = True if content["dt"].dtype == np.uint8 and dt == 1 else dt  # how scipy reads a logical
    if "mean" in found and content["mean"].dtype != object:
        found["mean"] = content["mean"].ravel("F").tolist()
    return found


if __name__ == "__main__":
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[2]),) * 2)
    except (ImportError, OSError, ValueError):
        pass  # no such limits on this system
    try:
        print(json.dumps(variables(sys.argv[1])))
    except Exception as error:
        sys.exit(f"{type(error).__name__}: {error}")
