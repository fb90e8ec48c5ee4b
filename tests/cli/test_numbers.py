"""Every option that takes a number says its limits, and refuses what lies beyond them."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import replace

import click
import pytest

from skinmap.cli.main import cli
from skinmap.cli.simulate import SENSING
from skinmap.commands.options import Number
from skinmap.errors import InvalidArrayError
from skinmap.flat.flat_map import ISOMETRY
from skinmap.profile import KNOBS
from skinmap.recognition.training import MAX_WORDS
from skinmap.touch.simulation.variety import Sensing
from tests.cli.test_options import commands

WORDS = ("-1", "0", "nan", "inf", "-inf", "1e9", "1000000000", "1e300", "many", "")
# Options of one name that are of another kind in some command, and why.
OTHERWISE = {
    "--anchors", "--taxels",  # files of other columns, in the words of the command
    "--classifier", "--part",  # one, where a command is about one
    "--format",  # of what is written
    "--web",  # of a report, or of the scene
    "--out",  # a file, or a folder
    "--places",  # where simulated people touch, and the file of the places that were asked for
    "--publish",  # several, where names are published
    "--speed",  # not without end, where people look on
}  # fmt: skip


def numeric() -> list[tuple[str, click.Option]]:
    """Every option that takes a number, with the words of its command."""
    kinds = (click.types.FloatParamType, click.types.IntParamType)
    return [
        (words, one)
        for words, command in commands(cli).items()
        for one in command.params
        if isinstance(one, click.Option) and isinstance(one.type, kinds) and not one.count
    ]


NUMERIC = numeric()


def test_every_number_has_limits():
    assert len(NUMERIC) > 25  # of about 230 options: all commands were looked through
    for words, one in NUMERIC:
        assert isinstance(one.type, Number | click.IntRange), (words, one.opts)
        assert one.type.min is not None, (words, one.opts)
        assert one.type.max is not None, (words, one.opts)


def sensible(kind: Number | click.IntRange, word: str) -> bool:
    """Whether a text is a number within the limits, said without the code under test."""
    try:
        number = float(word) if isinstance(kind, Number) else int(word)
    except ValueError:
        return False
    if math.isinf(number):
        return number > 0 and getattr(kind, "endless", False)
    low = number > kind.min if kind.min_open else number >= kind.min
    high = number < kind.max if kind.max_open else number <= kind.max
    return low and high


@pytest.mark.parametrize("word", WORDS)
def test_a_number_that_makes_no_sense_is_refused_by_name(word):
    for words, one in NUMERIC:
        command = click.Context(cli, info_name="skinmap")
        if sensible(one.type, word):
            assert one.type.convert(word, one, command) == float(word), (words, one.opts)
            continue
        with pytest.raises(click.BadParameter) as error:
            one.type.convert(word, one, command)
        message = error.value.format_message()
        assert one.opts[-1] in message, (words, one.opts)
        assert "\n" not in message


def test_only_what_is_meant_to_has_no_end():
    taken = {one.opts[-1] for _, one in NUMERIC if sensible(one.type, "inf")}
    assert taken == {"--speed"}
    billion = {one.opts[-1] for _, one in NUMERIC if sensible(one.type, "1000000000")}
    assert billion == {"--seed"}


def test_limits_are_those_of_the_library():
    limits = {(words, one.opts[-1]): one.type for words, one in NUMERIC}
    assert limits["flatten", "--max-distortion"].min == ISOMETRY
    assert KNOBS["classify"]["words"].most == MAX_WORDS
    assert KNOBS["classify"]["rotations"].only == (1, 4, 6)
    sensed = {"noise": 0.0, "rate": 10_000.0, "saturation": 255.0, "bits": 8, "gaps": 0.5}
    for name, value in sensed.items():
        kind = SENSING[name]
        assert kind.convert(str(value), None, None) == value
        assert getattr(replace(Sensing(), **{name: value}), name) == value
        if value:
            with pytest.raises(InvalidArrayError):
                replace(Sensing(), **{name: kind.max + 1})


def shape(one: click.Option) -> tuple[object, ...]:
    """What must be alike in options of one name."""
    kind = one.type
    limits = [getattr(kind, name, None) for name in ("min", "max", "min_open", "max_open")]
    choices = tuple(getattr(kind, "choices", ()))
    return (type(kind), *limits, choices, one.metavar, one.is_flag, one.multiple)


def test_options_of_one_name_are_of_one_kind():
    found: dict[str, dict[tuple[object, ...], list[str]]] = defaultdict(lambda: defaultdict(list))
    for words, command in commands(cli).items():
        for one in command.params:
            for name in one.opts:
                if isinstance(one, click.Option) and name.startswith("--"):
                    found[name][shape(one)].append(words)
    assert len(found) > 60  # names of about 240 options
    for name, kinds in found.items():
        if name not in OTHERWISE:
            assert len(kinds) == 1, (name, dict(kinds))


def test_every_option_says_what_it_takes():
    for words, command in commands(cli).items():
        for one in command.params:
            if isinstance(one, click.Option) and not one.hidden:
                said = (one.help or "").split("  [default")[0]
                assert said.endswith("."), (words, one.opts)
                if isinstance(one.type, click.types.StringParamType):
                    assert one.metavar, (words, one.opts)


@pytest.mark.parametrize(
    ("option", "begins", "fewest"),
    [
        ("--seconds", "Stop after this time [s]", 5),
        ("--speed", "Speed as a multiple of the recorded", 3),
        ("--publish", "Publish ", 3),
        ("--jobs", "Processes (1 to 256)", 3),
    ],
)
def test_wording_is_the_same_in_all_commands(option, begins, fewest):
    found = [
        one for command in commands(cli).values() for one in command.params if option in one.opts
    ]
    assert len(found) >= fewest
    assert all((one.help or "").startswith(begins) for one in found)
