"""What all fuzz targets share: mutations of JSON documents that keep their structure, limits, and the loop."""

import copy
import json
import os
import random
import re
import resource
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import atheris

SECONDS = 5.0
"""Of processor time, for one input."""
ADDRESSES = 4 << 30
"""Bytes of memory that may be asked for."""
OPTIONS = ("-timeout=120", "-rss_limit_mb=1024", "-max_len=60000", "-len_control=0")
VALUES = (
    *(None, True, False, 0, 1, -1, 2, 7, 100, 10**5, 2**31, 2**53 + 1, 10**30, 10**400, -(10**400)),
    *(0.5, -0.0, 0.1, 1.5, 5e-324, 1e-300, 1e154, 1e200, 1.7e308, -1e308, float("nan"), float("inf"), float("-inf")),
    *("", "x", "0", "total", "average", "0x1p-3", "-0x1.8p+1000", "nan", "\ud800", "a" * 3000),
    *([], {}, [[]], [[[0.0]]], [0] * 999, [[0.0] * 40] * 40, ["discounted", 0.9], {"infinite": True}),
    *({"by mode": [[0, 1]]}, {"by mode": [[[], 1]]}, {"by mode": 5}),
)
TOKENS = (
    "1e400",
    "-1e400",
    "1e-400",
    "NaN",
    "-Infinity",
    "9" * 5000,
    "01",
    "[" * 400 + "]" * 400,
    '{"a":' * 300 + "1" + "}" * 300,
)


def places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every container of a tree with every key or index in it."""
    todo = [tree]
    while todo:
        here = todo.pop()
        for key, value in here.items() if isinstance(here, dict) else enumerate(here):
            yield here, key
            if isinstance(value, dict | list) and value:
                todo.append(value)


def mutate(tree: Any, rng: random.Random) -> None:
    """Change one place of a tree."""
    found = list(places(tree))
    if rng.random() < 0.6:  # rather something near the root than one of many numbers
        found = [(here, key) for here, key in found if not isinstance(here[key], float)] or found
    here, key = rng.choice(found)
    value = here[key]
    choice = rng.randrange(10)
    if choice == 0:
        del here[key]
    elif choice == 1:
        other, place = rng.choice(found)
        here[key] = json.loads(json.dumps(other[place]))
    elif choice == 2:
        other, place = rng.choice(found)
        here[key], other[place] = other[place], value
        if cyclic(tree):
            other[place], here[key] = here[key], value
    elif choice == 3 and isinstance(value, list):
        here[key] = value * rng.choice((0, 2, 3, 30))
    elif choice == 4 and isinstance(value, list):
        rng.shuffle(value)
    elif choice == 5:
        here[key] = [value] if rng.random() < 0.5 else {"by mode": [[0, value]]}
    elif choice == 6 and isinstance(value, dict):
        value[rng.choice(("budget", "min_dwell", "word", "moves", "x", ""))] = copy.deepcopy(rng.choice(VALUES))
    elif choice <= 8 and isinstance(value, int | float) and abs(value) < 1e300:
        here[key] = rng.choice(
            (value + 1, value - 1, -value, 2 * value, value * 1e10, value * (1 + 1e-12), float(value), str(value))
        )
    else:
        here[key] = copy.deepcopy(rng.choice(VALUES))


def cyclic(tree: Any) -> bool:
    """Whether swapping has put a container into itself."""
    try:
        json.dumps(tree)
    except (ValueError, RecursionError):
        return True
    return False


def changed(data: bytes, most: int, seed: int, seeds: list[str], sealed: Callable[[str], str]) -> bytes:
    """An input made of another: mostly by its tree, with digests that fit; else by its text or its bytes."""
    rng = random.Random(seed)
    if rng.random() < 0.1:
        return bytes(atheris.Mutate(data, most))
    try:
        tree = json.loads(data) if rng.random() < 0.8 else None
    except (ValueError, RecursionError):
        tree = None
    if not isinstance(tree, dict) or not tree:
        tree = json.loads(rng.choice(seeds))
    try:
        for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
            if tree and len(json.dumps(tree)) < most:
                mutate(tree, rng)
        text = json.dumps(tree)
        if rng.random() < 0.1:
            spots = list(re.finditer(r"(?<=[\[ ])-?\d[\d.e+-]*(?=[,\]}])", text))
            if spots:
                spot = rng.choice(spots)
                text = text[: spot.start()] + rng.choice(TOKENS) + text[spot.end() :]
        if rng.random() < 0.05:
            text = re.sub(r'"(\w+)": ("\w*"|\d+)', r'"\1": 0, "\1": \2', text, count=1)  # a key that comes twice
        if rng.random() < 0.95:
            text = sealed(text)
    except (ValueError, RecursionError):
        return rng.choice(seeds).encode()
    return text.encode()[:most]


def resealed(text: str, **digests: str) -> str:
    """A document with other digests, the rest as it is written."""
    for key, digest in digests.items():
        text = re.sub(rf'"{key}": "[^"]*"', f'"{key}": "{digest}"', text)
    return text


def run(seeds: list[str], sealed: Callable[[str], str], try_input: Callable[[bytes], None]) -> None:
    """Fuzz documents for as long as the command line says, or run the inputs that it names."""
    _fuzz(lambda data, most, seed: changed(data, most, seed, seeds, sealed), try_input)


def run_bytes(
    seeds: list[bytes], mutate: Callable[[bytes, random.Random], bytes], try_input: Callable[[bytes], None]
) -> None:
    """Fuzz files that are no text."""

    def mutator(data: bytes, most: int, seed: int) -> bytes:
        rng = random.Random(seed)
        return mutate(data if len(data) > 2 and rng.random() < 0.7 else rng.choice(seeds), rng)[:most]

    _fuzz(mutator, try_input)


def _fuzz(mutator: Callable[[bytes, int, int], bytes], try_input: Callable[[bytes], None]) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    warnings.simplefilter("error", RuntimeWarning)

    def limited(data: bytes) -> None:
        begin = time.process_time()
        try_input(data)
        taken = time.process_time() - begin
        if taken > SECONDS:
            raise TimeoutError(f"{taken:.1f} s for one input")

    atheris.Setup([sys.argv[0], *OPTIONS, *sys.argv[1:]], limited, custom_mutator=mutator)
    atheris.Fuzz()
