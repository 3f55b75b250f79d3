"""The bad-input table: every public callable against what it can't take, with the error, its words, and no harm."""

import importlib
import inspect
import pkgutil
from pathlib import Path

import bad_input
import numpy as np
import pytest
from bad_input.table import Refused, Same, state_of, unchanged
from test_package import CALLABLE

TABLES = [importlib.import_module(f"bad_input.{module.name}") for module in pkgutil.iter_modules(bad_input.__path__)]
ROWS = [row for table in TABLES for row in getattr(table, "ROWS", [])]


def of(kind):
    rows = [row for row in ROWS if isinstance(row, kind)]
    return pytest.mark.parametrize("row", rows, ids=[f"{row.name}: {row.what}" for row in rows])


@of(Refused)
def test_it_is_refused_in_words_and_nothing_is_changed(row):
    arguments = row.arguments()
    before = state_of(arguments)
    with pytest.raises(row.error) as refusal:
        row.call(**arguments)
    for words in row.words:
        assert words in str(refusal.value)
    assert unchanged(before, state_of(arguments))


@of(Same)
def test_it_is_taken_as_what_it_says(row):
    arguments = row.arguments()
    before = state_of(arguments)
    answer = row.call(**arguments)
    assert unchanged(before, state_of(arguments))
    np.testing.assert_equal(answer, row.call(**row.plain()))


def test_rows_have_names_of_their_own():
    names = [(row.name, row.what) for row in ROWS]
    assert len(names) == len(set(names))


# Answers: functions make them, of numbers that they have checked.
ANSWERS = set(
    "AverageDwellTime CostParts DwellTime DwellTimes Edge Fall GrowthRate JointSpectralRadius Mode MonteCarlo Move "
    "PairGrowth PolicyStability Report Run Rung Stationary Sweep Switch SwitchingHelp TradeOff TransientGrowth".split()
)
BEHIND_THE_BOUNDARY = {"switchctl.moments", "switchctl.gramians"}  # the kernel takes what has been checked
CHECKED_BY_CHOOSE = {"Scheduler.take"}


def test_every_public_callable_that_takes_anything_has_rows():
    rows = {row.name for row in ROWS}
    for thing in CALLABLE.values():
        name = thing.__qualname__
        given = [parameter for parameter in inspect.signature(thing).parameters if parameter not in ("self", "cls")]
        if given and thing.__module__ not in BEHIND_THE_BOUNDARY and name not in ANSWERS | CHECKED_BY_CHOOSE:
            assert name in rows, f"{name} has no row in tests/bad_input"


def test_the_table_is_as_large_as_it_is_said_to_be():
    text = (Path(__file__).parent.parent / "docs" / "trust.md").read_text(encoding="utf-8")
    assert f"{len(ROWS):,} rows" in text
    assert len(ROWS) >= 400
