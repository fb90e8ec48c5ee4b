"""Names of touches, as people give them."""

from __future__ import annotations

from skinmap.errors import InvalidArrayError

MAX_LENGTH = 64  # characters; a longer name breaks every table
UNNAMED = "touch"  # a touch that nobody has named
# What is said of touches without a name of their own; the loop, the classifiers and their
# rejection say these words.
RESERVED = (UNNAMED, "unknown", "no_contact")
JOIN = "+"  # between the labels of touches that overlap in time


def check_label(label: str) -> str:
    """A name that touches can be trained under, without the blanks around it.

    Raises
    ------
    InvalidArrayError
        An empty one, one with control characters or `+`, one that is too long, or a word that
        classifiers say where they give no name.

    Examples
    --------
    >>> check_label(" poke ")
    'poke'
    """
    if not label.isprintable():
        raise InvalidArrayError(f"a label without control characters is needed, got {label!r}")
    word = label.strip()
    if not word:
        raise InvalidArrayError("a label is empty; name the gesture, poke for one")
    if len(word) > MAX_LENGTH:
        raise InvalidArrayError(
            f"a label has {len(word)} characters, at most {MAX_LENGTH}: {word[:20]!r}..."
        )
    if JOIN in word:
        raise InvalidArrayError(f"{word!r}: '+' joins the labels of touches at once; use another")
    if word in RESERVED:
        raise InvalidArrayError(
            f"{word!r} is the answer of classifiers for a touch without a name; use another"
        )
    return word
