"""How much memory an array may take."""

MEMORY = 8_000_000_000  # bytes


def affordable(size: int, what: str) -> None:
    """Refuse, before it is made, what would need more bytes than `MEMORY`."""
    if size > MEMORY:
        told = f"{size / 1e9:,.0f} GB" if size < 10**30 else "more than 10^21 GB"
        raise MemoryError(f"{what} would need {told} of memory, and no more than {MEMORY / 1e9:g} GB are taken")
