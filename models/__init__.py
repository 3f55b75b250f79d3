"""Plants with several controllers each, ready to schedule.

Every module says where its numbers come from and offers ``plant()``, ``controllers()``, ``initial_state()``,
``modes()`` and ``method()``, the method that shows it best.
"""

NAMES = ("five_mode", "medium_access", "quadrotor", "servo", "suspension")
"""The bundled models."""
