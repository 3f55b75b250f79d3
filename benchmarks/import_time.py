"""What `import switchctl` takes on top of `import control`, each in a fresh interpreter."""

import subprocess
import sys
from statistics import median
from time import perf_counter

from switchctl.tables import text_table

RUNS = 9
STATEMENTS = ("import control", "import switchctl")


def seconds(statement: str) -> float:
    """Time a fresh interpreter that runs one statement."""
    start = perf_counter()
    subprocess.run([sys.executable, "-c", statement], check=True)
    return perf_counter() - start


def main() -> None:
    for statement in STATEMENTS:
        seconds(statement)  # warm-up: the compiled files, the disk
    turns = [[seconds(statement) for statement in STATEMENTS] for _ in range(RUNS)]
    control, ours = (median(times) for times in zip(*turns, strict=True))
    difference = median(ours - control for control, ours in turns)
    quotient = median(ours / control for control, ours in turns)
    rows = [
        [STATEMENTS[0], f"{control:.3f}", "1.00"],
        [STATEMENTS[1], f"{ours:.3f}", f"{quotient:.2f}"],
    ]
    print(text_table([f"fresh interpreter, median of {RUNS}", "seconds", "ratio"], rows))
    print(f"\nmedian difference: {difference:.3f} s")


if __name__ == "__main__":
    main()
