"""The bad-input table: every public callable against what it can't take, with the error, its words, and no harm."""

import importlib
import pkgutil

import bad_input
import numpy as np
import pytest
from bad_input.table import Refused, Same, state_of, unchanged

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
