"""How much memory an array or a list may take."""

MEMORY = 8e9  # bytes


def affordable(size: float, what: str, instead: str = "ask for less") -> None:
    """Refuse, before it is made, what would take more bytes than `MEMORY`."""
    if size > MEMORY:
        raise MemoryError(f"{what} would take {size:.3g} bytes, and at most {MEMORY:.0e} are allowed; {instead}")
