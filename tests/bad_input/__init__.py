"""The bad-input table: what public callables say of what they can't take, and what they take in any form."""
