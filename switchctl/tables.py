"""Small tables, as text for a terminal and as HTML for a notebook."""

from abc import abstractmethod
from collections.abc import Sequence
from html import escape
from typing import Any


def text_table(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Align columns: the first to the left, numbers to the right."""
    cells = [[str(cell) for cell in row] for row in (header, *rows)]
    widths = [max(len(row[j]) for row in cells) for j in range(len(header))]
    lines = [
        "  ".join(
            cell.ljust(w) if j == 0 else cell.rjust(w) for j, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in cells
    ]
    lines.insert(1, "  ".join("-" * width for width in widths))
    return "\n".join(line.rstrip() for line in lines)


def html_table(header: Sequence[str], rows: Sequence[Sequence[Any]], caption: str) -> str:
    """One HTML table with a caption."""
    head = "".join(f"<th>{escape(str(cell))}</th>" for cell in header)
    left = ' style="text-align: left"'
    body = "".join(
        "<tr>" + "".join(f"<td{left * (j == 0)}>{escape(str(cell))}</td>" for j, cell in enumerate(row)) + "</tr>"
        for row in rows
    )
    style = "caption-side: top; text-align: left; font-weight: bold; white-space: nowrap"
    return (
        f'<table><caption style="{style}">{escape(caption)}</caption>'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    )


def tree(heading: str, facts: Sequence[tuple[str, str]]) -> str:
    """A heading with facts branching from it, for a terminal."""
    width = max((len(key) for key, _ in facts), default=0)
    branches = ["├──"] * (len(facts) - 1) + ["└──"]
    lines = [f"{branch} {key:<{width}}  {value}" for branch, (key, value) in zip(branches, facts, strict=False)]
    return "\n".join([heading, *lines])


class Summary:
    """What is printed as a heading and facts: a tree at a terminal, a table in a notebook."""

    @abstractmethod
    def _heading(self) -> str: ...

    @abstractmethod
    def _facts(self) -> Sequence[tuple[str, str]]: ...

    def __repr__(self) -> str:
        return tree(self._heading(), self._facts())

    def _repr_html_(self) -> str:
        return html_table(["", ""], self._facts(), self._heading())
