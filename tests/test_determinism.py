"""The same question has the same answer to the last bit: again, in threads, in other processes, whatever BLAS does."""

import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from threading import Barrier

import pytest
from answers import Cases, digests, found

TOGETHER = 4
ALONE = {"average dwell", "dwells", "dwell", "help", "report", "policy", "followed"}  # long, and on caches of their own
ALONE |= {f"certificate of {name}" for name in ALONE}


@pytest.fixture(scope="module")
def once():
    return digests(found())


def different(answers, expected):
    there = digests(answers)
    assert there.keys() >= expected.keys() - ALONE
    return [name for name in there if there[name] != expected[name]]


@pytest.fixture
def hurried():
    """Threads that take turns as often as they can."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval)


def test_threads_that_share_modes_find_what_one_finds_alone(once, hurried):
    """Nothing is cached before, so all of them compute what is cached at once."""
    cases, start = Cases(), Barrier(TOGETHER)

    def ask(_):
        start.wait()
        return found(cases, ALONE)

    with ThreadPoolExecutor(TOGETHER) as executor:
        for answers in executor.map(ask, range(TOGETHER)):
            assert different(answers, once) == []
    assert different(found(cases), once) == []  # and again from what they left behind


@pytest.mark.parametrize(
    ("threads", "seed"), [("2", "1"), *[pytest.param(n, s, marks=pytest.mark.slow) for n, s in ("10", "11", "42")]]
)
def test_another_process_finds_the_same(once, monkeypatch, threads, seed):
    """With other BLAS threads and other orders of sets; fresh processes, and what they found pickled and sent back."""
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        monkeypatch.setenv(name, threads)
    monkeypatch.setenv("PYTHONHASHSEED", seed)
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as executor:
        assert different(executor.submit(found).result(), once) == []
