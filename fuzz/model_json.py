"""Model files in JSON: what is loaded is refused by the package, or can be copied, shown and scheduled.

python fuzz/model_json.py -max_total_time=600
"""

import tempfile
from pathlib import Path

from checked_model import seeds, try_model
from mutations import run

from switchctl.load_model import load_model

FILE = Path(tempfile.mkdtemp(prefix="fuzz-")) / "model.json"


def sealed(text: str) -> str:
    """Models have no digest."""
    return text


def try_input(data: bytes) -> None:
    """Load it as a file."""
    FILE.write_bytes(data)
    try_model(lambda: load_model(str(FILE)))


if __name__ == "__main__":
    run(seeds(), sealed, try_input)
