"""Guarantees: when switching is stable, whether it helps at all, and how long a controller must dwell."""

__all__: list[str] = []
