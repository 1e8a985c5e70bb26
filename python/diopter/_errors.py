"""What can go wrong, and what is found odd."""

from __future__ import annotations

from typing import Any


class DiopterError(Exception):
    """Something that was asked for cannot be had.

    Attributes:
        message: The whole sentence.
        place: Setting, quantity or file (with line) that it is about, or None.
        found: What is there, or None.
        expected: What belongs there, or None.
        hint: A way out, such as the nearest name that is known, or None.
    """

    message: str
    place: str | None
    found: str | None
    expected: str | None
    hint: str | None

    def __init__(
        self,
        message: str,
        place: str | None = None,
        found: str | None = None,
        expected: str | None = None,
        hint: str | None = None,
    ) -> None:
        super().__init__(message)
        self.message = message
        self.place = place
        self.found = found
        self.expected = expected
        self.hint = hint

    def __reduce__(self) -> tuple[Any, ...]:
        return (DiopterError, (self.message, self.place, self.found, self.expected, self.hint))


class DiopterWarning(UserWarning):
    """Something odd that the picture is taken with all the same."""
