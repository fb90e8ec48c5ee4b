"""One way to check what comes from outside: a type says what it must be, one line what is wrong.

class Part(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    channels: Annotated[int, msgspec.Meta(ge=1)]

checked(tomllib.load(file), Part, what="the part", fail=partial(DataFormatError, path=path))
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec

T = TypeVar("T")
Steps = tuple[str | int, ...]
SHOWN = 40  # letters of a value that a message shows
FAULT = re.compile(r"(?P<said>.*?)(?: - at `\$(?P<path>[^`]*)`)?", re.DOTALL)
STEP = re.compile(r"\.([^.\[]+)|\[(\d+)\]")
NAMES = {
    "str": "text", "int": "a whole number", "float": "a number", "bool": "true or false",
    "object": "a table", "array": "a list", "null": "nothing",
}  # fmt: skip


def checked(
    value: object,
    kind: type[T],
    *,
    what: str,
    fail: Callable[[str], Exception],
    called: Callable[[Steps], str] | None = None,
) -> T:
    """Input converted to the type that it must be.

    Parameters
    ----------
    value : object
        Of plain dicts, lists, numbers and texts, as TOML or JSON gives them.
    kind : type
        A `msgspec.Struct` with its constraints.
    what : str
        What came, for messages: "the manifest".
    fail : callable
        Makes the error of a message.
    called : callable, optional
        What a table or list inside is called, of its steps (keys and numbers) from the top.

    Raises
    ------
    Exception
        What `fail` makes of one line: which key, what came, what was expected and what exists.
    """
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        found = FAULT.fullmatch(str(error))
        assert found is not None  # it matches anything
        steps = tuple(key or int(number) for key, number in STEP.findall(found["path"] or ""))

        def place(inside: Steps) -> str:
            return what if not inside else (called or dotted)(inside)

        raise fail(_words(found["said"], steps, value, kind, place)) from None


def shown(value: object) -> str:
    """A value for a message: short ones as they are, others by their kind."""
    if isinstance(value, bool):
        return str(value).lower()
    if value is None or isinstance(value, int | float | str):
        text = repr(value)
        return text if len(text) <= SHOWN else f"{text[: SHOWN - 3]}..."
    return (
        "a table" if isinstance(value, dict) else "a list" if isinstance(value, list) else "a date"
    )


def dotted(steps: Steps) -> str:
    """`parts[0].name`, as JSON is spoken of."""
    words = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps)
    return "".join(words).removeprefix(".")


def toml_table(steps: Steps) -> str:
    """`[robot]` or `[[part]] number 2`, as TOML is spoken of."""
    if len(steps) == 2 and isinstance(steps[1], int):
        return f"[[{steps[0]}]] number {steps[1] + 1}"
    return f"[{'.'.join(map(str, steps))}]"


def _words(said: str, steps: Steps, value: Any, kind: type, place: Callable[[Steps], str]) -> str:
    """What msgspec said, with the value that came and what exists."""
    key = re.search(r"field `([^`]*)`", said)
    if key is not None and "missing" in said:
        return f"{place(steps)} lacks {key[1]!r}"
    if key is not None:
        known = ", ".join(_keys(kind, steps))
        return f"{place(steps)} has unknown keys: {key[1]!r}; the keys are: {known}"
    for step in steps:
        value = value[step]
    if "enum value" in said:
        expected = "one of " + ", ".join(map(str, _choices(kind, steps)))
    else:
        wanted = said.partition(", got")[0].removeprefix("Expected ")
        named = re.sub(r"`([^`]*)`", lambda each: _name(each[1]), wanted)
        bounds = named.replace(">=", "from").replace("<=", "up to")
        expected = re.sub(r"(\d)\.0\b", r"\1", bounds)
    whole = not steps or isinstance(steps[-1], int)  # of a table or list, or of one of its keys
    where = place(steps) if whole else f"{place(steps[:-1])}: {steps[-1]}"
    return f"{where} must be {expected}, got {shown(value)}"


def _name(types: str) -> str:
    return " or ".join(NAMES.get(one, one) for one in types.split(" | ") if one != "null")


def _keys(kind: type, steps: Steps) -> list[str]:
    found = _inner(msgspec.inspect.type_info(kind), steps)
    return [field.encode_name for field in getattr(found, "fields", ())]


def _choices(kind: type, steps: Steps) -> tuple[Any, ...]:
    return tuple(getattr(_inner(msgspec.inspect.type_info(kind), steps), "values", ()))


def _inner(info: Any, steps: Steps) -> Any:
    """The type at some steps from the top."""
    if isinstance(info, msgspec.inspect.UnionType):
        some = [one for one in info.types if not isinstance(one, msgspec.inspect.NoneType)]
        return _inner(some[0], steps)
    if not steps:
        return info
    if isinstance(info, msgspec.inspect.ListType):
        return _inner(info.item_type, steps[1:])
    inside = {field.encode_name: field.type for field in info.fields}
    return _inner(inside[str(steps[0])], steps[1:])
