"""Options that mean and look the same in all commands, and the robot that they name.

Some belong to commands that spread their work (workers, resumed runs), and `--profile` sets
defaults of others.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click
from click.core import ParameterSource
from msgspec import UNSET, UnsetType

from skinmap.commands.overwriting import force_option, guard
from skinmap.errors import MissingFileError, SkinMismatchError, UnknownNameError, unknown_name
from skinmap.io.output import check_folder
from skinmap.io.text import UNITS
from skinmap.profile import read_profile

if TYPE_CHECKING:
    from skinmap.live.sources.source import Source
    from skinmap.parallel.workers import Workers
    from skinmap.profile import Profile
    from skinmap.skin.robot import Robot


class Number(click.FloatRange):
    """A number within limits, as `click.FloatRange`, which takes NaN for any number.

    Parameters
    ----------
    low, high : float
        The least and the most.
    endless : bool
        Whether inf is taken too, beyond the most.
    **open_ends : bool
        `min_open` and `max_open`: whether a limit itself is left out.
    """

    name = "number"  # as help shows it

    def __init__(
        self, low: float, high: float, *, endless: bool = False, **open_ends: bool
    ) -> None:
        super().__init__(low, high, **open_ends)
        self.endless = endless

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number of a text."""
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if math.isnan(number):
            self.fail(f"{value!r} is not a number", param, ctx)
        if self.endless and number == math.inf:
            return number
        return float(super().convert(number, param, ctx))

    def _describe_range(self) -> str:
        """As click's, with 1e+06 for 1000000.0."""
        low = f"{self.min:g}<{'' if self.min_open else '='}x"
        high = f"<{'' if self.max_open else '='}{self.max:g}"
        return low + high + (" or inf" if self.endless else "")


class Whole(click.IntRange):
    """A whole number within limits, under a name of plain words."""

    name = "whole number"


class Written(click.Path):
    """A file to write whose suffix says its format: refused before any work is done."""

    def __init__(self, *suffixes: str) -> None:
        super().__init__(path_type=Path, dir_okay=False)
        self.suffixes = suffixes

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path of a text."""
        suffix = Path(value).suffix.lower()
        if suffix not in self.suffixes:
            self.fail(unknown_name("format for files ending in", suffix, self.suffixes), param, ctx)
        return super().convert(value, param, ctx)


PATH = click.Path(path_type=Path)
PICTURE = Written(".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff")
PAGE = Written(".html", ".htm")
F = TypeVar("F", bound=Callable[..., Any])
MAX_SECONDS = 1e7  # four months: no command is left to run longer
MAX_SPEED = 1e6
PUBLISH_WAYS = "lsl:NAME, zmq:PORT, zmq:HOST:PORT, zenoh[:PORT] or foxglove[:PORT]"
MAX_TOUCHES = 100_000  # that are simulated of a kind on a part: days of work
STREAMS = ("lsl", "zenoh", "zmq")  # sources that may say their robot
RECORDED = (".npz", ".mcap", ".csv", ".tsv", ".txt")  # recordings that may say their robot
OUTSIDE = "SKINMAP_ALLOW_OUTSIDE"  # environment variable
RESULTS = "__results__"


def word(
    name: str, metavar: str, text: str, *, shown: str | None = None, **more: Any
) -> Callable[[F], F]:
    """An option that takes a word; help shows `shown`, its default."""
    return click.option(name, metavar=metavar, help=text, **_default(shown), **more)


def words(
    name: str, into: str, metavar: str, text: str, *, shown: Any = None, **more: Any
) -> Callable[[F], F]:
    """An option that takes a word and may be repeated, and the parameter that they come in."""
    more |= {"metavar": metavar, "multiple": True, "help": text}
    return click.option(name, into, **_default(shown), **more)


def choice(
    name: str, known: Iterable[str], text: str, *, shown: str | None = None, **more: Any
) -> Callable[[F], F]:
    """An option that takes one of some words."""
    return click.option(name, type=click.Choice(tuple(known)), help=text, **_default(shown), **more)


def whole(
    name: str, low: int, high: int, text: str, *, shown: int | None = None, **more: Any
) -> Callable[[F], F]:
    """An option that takes a whole number between limits, or one of them."""
    return click.option(name, type=Whole(low, high), help=text, **_default(shown), **more)


def number(name: str, low: float, high: float, text: str, **more: Any) -> Callable[[F], F]:
    """An option that takes a number above one limit, up to another."""
    return click.option(name, type=Number(low, high, min_open=True), help=text, **more)


def _default(shown: Any) -> dict[str, Any]:
    """Of an option; a default of None would count as given and end `required`."""
    return {} if shown is None else {"default": shown, "show_default": True}


robot_argument = click.argument("robot", default="icub", metavar="[ROBOT]")
# For commands that may be given a recording, which knows its own.
shown_argument = click.argument("robot", required=False, metavar="[ROBOT|RECORDING|FOLDER]")
# For commands whose argument is a recording.
robot_option = word(
    "--robot", "ROBOT", "Robot that was recorded.  [default: the recording's, else icub]"
)
played_robot_option = word(
    "--robot", "ROBOT", "Robot whose skin it must be; it also names a dumper's folders."
)
part_option = words("--part", "parts", "PART", "Only this part of the robot; may be repeated.")


def units_option(of: str) -> Callable[[F], F]:
    """`--units`, with the files that it holds for."""
    return choice("--units", UNITS, f"Unit of lengths in {of}.", shown="m")


json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
Kinds = tuple[type, ...]


def prints(*types: type, **others: type | Kinds) -> Callable[[F], F]:
    """`--json`, with the types of result that it prints.

    Parameters
    ----------
    types : type
        Frozen dataclasses; several where what is printed depends on the options.
    others : type or tuple of type
        What is printed in another mode of the command, by that mode's name: its schema is a file
        of its own, `COMMAND-MODE.json`.

    Returns
    -------
    callable
        A decorator for a command.

    Examples
    --------
    >>> import click
    >>> from skinmap.commands import prints
    >>> from skinmap.commands.options import results_of
    >>> @click.command()
    ... @prints(dict)
    ... def shown(as_json: bool) -> None:
    ...     pass
    >>> results_of(shown)
    {'': (<class 'dict'>,)}
    """

    def add(command: F) -> F:
        modes = {name: one if isinstance(one, tuple) else (one,) for name, one in others.items()}
        command.__dict__[RESULTS] = {"": types, **modes}
        return json_option(command)

    return add


def results_of(command: click.Command) -> dict[str, Kinds]:
    """The types of result that a command prints, by mode; nothing where it does not say."""
    found: dict[str, Kinds] = getattr(command.callback, RESULTS, {})
    return found


MAX_SEED = 4_000_000_000  # scikit-learn's seeds have 32 bits, and repetitions count on from it
seed_option = whole("--seed", 0, MAX_SEED, "Seed of all randomness.", shown=0)


def per_gesture_option(help: str) -> Callable[[F], F]:
    """`--per-gesture`: how many touches of each kind are simulated."""
    return whole("--per-gesture", 1, MAX_TOUCHES, help, shown=20)


def seconds_option(help: str) -> Callable[[F], F]:
    """`--seconds`: how long a command goes on with what would not end, or not so soon."""
    return number("--seconds", 0.0, MAX_SECONDS, help)


def speed_option(of: str, *, endless: bool = True) -> Callable[[F], F]:
    """`--speed` of a source; `endless` where it may run as fast as it goes."""
    return click.option(
        "--speed",
        type=Number(0.0, MAX_SPEED, min_open=True, endless=endless),
        help=f"Speed as a multiple of the {of} one{'; inf for no waiting' if endless else ''}.",
        **_default(1.0),
    )


def publish_option(what: str, *, multiple: bool = False) -> Callable[[F], F]:
    """`--publish`: what other programs can follow, and how."""
    more = "; may be repeated" if multiple else ""
    text = f"Publish {what}: {PUBLISH_WAYS}{more}."
    return word("--publish", "SPEC", text, multiple=multiple)


response_option = words(
    "--response",
    "responses",
    "[PART=]FILE",
    "Response calibration of a part that sends raw values; may be repeated.",
)


calibration_option = words(
    "--calibration",
    "calibrations",
    "[PART=]FILE",
    "Load calibration of a part, from `calibrate load -o`: forces in newtons; may be repeated.",
)


def read_radius(text: str) -> float | None:
    """The radius asked for [m], None for auto."""
    from skinmap.neighbours.offsets import NARROWEST, WIDEST

    if text == "auto":
        return None
    try:
        radius = float(text)
    except ValueError:
        radius = math.nan
    if not NARROWEST <= radius * 1e-3 <= WIDEST:
        raise click.UsageError(
            f"--radius-mm must lie in {NARROWEST * 1e3:g}..{WIDEST * 1e3:g}, or auto, got {text!r}"
        )
    return radius * 1e-3


def try_folder(ctx: click.Context, param: click.Parameter, out: Path | None) -> Path | None:
    """Refuse a folder that cannot be written to, or holds a user's files, before any work."""
    if out is not None:
        guard(ctx, param, out)
        check_folder(out)
    return out


def out_file(
    what: str,
    *,
    default: str | None = None,
    required: bool = False,
    folder: bool = False,
    guarded: bool = True,
) -> Callable[[F], F]:
    """`--out`, with the file that is written, and `--force`.

    Parameters
    ----------
    what : str
        What is written.
    default : str, optional
        Its name where none is given.
    required : bool
        Whether a name must be given.
    folder : bool
        Whether it may be a folder in some format.
    guarded : bool
        False where the command itself protects what is there.
    """
    option = click.option(
        "-o",
        "--out",
        "output",
        type=click.Path(path_type=Path, dir_okay=folder),
        metavar="FILE|FOLDER" if folder else "FILE",
        callback=guard if guarded else None,
        help=what,
        required=required,
        **_default(default),
    )
    return lambda command: option(force_option(command))


def file_option(name: str, kind: Written, help: str) -> Callable[[F], F]:
    """An option with a file that is written, by its name (`--screenshot`), and `--force`."""
    option = click.option(name, type=kind, callback=guard, help=help)
    return lambda command: option(force_option(command))


def out_folder(of: str, *, required: bool = False, default: str | None = None) -> Callable[[F], F]:
    """`--out`, with what the folder is for, and `--force`; tried before any work is done."""
    option = click.option(
        "-o",
        "--out",
        type=click.Path(path_type=Path, file_okay=False),
        metavar="FOLDER",
        callback=try_folder,
        help=f"Folder for {of}.",
        required=required,
        **_default(default),
    )
    return lambda command: option(force_option(command))


out_option = out_folder("pictures")


def open_robot(robot: str | None, parts: tuple[str, ...]) -> tuple[Robot, tuple[str, ...]]:
    """A robot and the parts asked for (all of them by default), names checked.

    Parameters
    ----------
    robot : str or None
        Without a name it is the robot that the command's recording was made on, else the iCub.
    parts : tuple of str

    Returns
    -------
    robot : Robot
    parts : tuple of str
        Each once.

    Raises
    ------
    UnknownNameError
        A robot or a part that does not exist.
    MissingFileError
        A manifest that does not exist; the recording may name it.

    Examples
    --------
    >>> from skinmap.commands import open_robot
    >>> open_robot("kaspar", ("torso", "torso"))[1]
    ('torso',)
    """
    ctx = click.get_current_context(silent=True)
    said = _recorded_robot(ctx) if robot is None else robot
    loaded = named_robot(said or "icub")
    for part in parts:
        if not said and part not in loaded.parts:
            default = f" of {loaded.origin}, the default robot (--robot names another)"
            raise UnknownNameError("part", part, loaded.parts, default)
        loaded.part(part)
    return loaded, tuple(dict.fromkeys(parts)) or loaded.parts


def open_stream(
    spec: str, robot: str | None, parts: tuple[str, ...], **how: Any
) -> tuple[Robot, Source]:
    """A robot and a source of its samples; without a name the robot that the stream names.

    Raises
    ------
    SkinMismatchError
        A stream of a robot that is not built in (named).
    UnknownNameError, MissingFileError, UnreachableError
        As for `open_robot` and `skinmap.open_source`.
    """
    from skinmap.io.robots.manifest import builtin_named
    from skinmap.live.sources.open_source import open_source

    if robot is None and spec.partition(":")[0] in STREAMS:
        source = open_source(spec, **how)
        said = source.info.robot
        source.close()
        robot = builtin_named(said)
        if said and robot is None:
            raise SkinMismatchError(f"{spec} is of {said!r}: give its manifest as --robot")
    loaded, _ = open_robot(robot, parts)
    return loaded, open_source(spec, robot=loaded, parts=parts or None, **how)


def named_robot(name: str) -> Robot:
    """A robot by its name; `SKINMAP_ALLOW_OUTSIDE=1` lets a manifest look outside its folder.

    Raises
    ------
    UnknownNameError, MissingFileError
        No such robot.
    """
    from skinmap.io.robots.manifest import load_robot

    return load_robot(name, allow_outside=os.environ.get(OUTSIDE, "0") not in ("", "0"))


def _recorded_robot(ctx: click.Context | None) -> str:
    """The robot of the recording that a command was given; empty where nothing names one."""
    if ctx is None:
        return ""
    given = [ctx.params.get("recording"), ctx.params.get("source"), ctx.params.get("protocol")]
    for several in ("recordings", "files"):
        given += list(ctx.params.get(several) or ())
    from skinmap.io.ros2.bag import is_mapped

    for path in (Path(one) for one in given if one):
        if is_mapped(path) or (path.suffix.lower() in RECORDED and path.is_file()):
            from skinmap.io.recordings.touch_files import recorded_robot

            said = recorded_robot(path)
            if said.endswith(".toml") and not Path(said).is_file():
                raise MissingFileError(said, f"the robot of {path}; name it with --robot")
            if said:  # a model may have the suffix of a text
                return said
    return ""


MAX_JOBS = 256  # processes


class Jobs(click.ParamType["int | str"]):
    """A number of processes, or the address of a Dask scheduler."""

    name = "jobs"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> int | str:
        """The number, or the address as it is."""
        if "://" in str(value):
            return str(value)
        return click.IntRange(1, MAX_JOBS).convert(value, param, ctx)


_jobs_option = word(
    "--jobs",
    "N|URL",
    f"Processes (1 to {MAX_JOBS}), or a Dask scheduler: tcp://HOST:PORT.",
    shown="1",
    type=Jobs(),
)
_resume_option = word(
    "--resume",
    "FOLDER",
    "Of finished results: run the same again after an interruption to go on.",
    type=PATH,
)


@dataclass(frozen=True, slots=True)
class WorkerOptions:
    """Processes or a scheduler's address, and a folder for results, as on the command line."""

    jobs: int | str = 1
    resume: Path | None = None

    @contextmanager
    def open(self, sweep: str) -> Iterator[Workers]:
        """The workers, reached before minutes are spent on what comes first.

        Parameters
        ----------
        sweep : str
            What is computed: results of another one are refused.
        """
        from skinmap.parallel.workers import Workers, open_workers

        with open_workers(Workers(self.jobs), resume=self.resume, sweep=sweep) as opened:
            yield opened
            if opened.kept is not None and opened.kept.recalled:
                click.echo(f"{opened.kept.recalled} results were on file", err=True)


ALONE = WorkerOptions()


def workers_options(*, resume: bool) -> Callable[[F], F]:
    """`--jobs`, and `--resume` of long runs; the command gets them as one, `spread`."""

    def add(command: F) -> F:
        @functools.wraps(command)
        def run(*args: Any, jobs: int | str, resume: Path | None = None, **options: Any) -> Any:
            return command(*args, spread=WorkerOptions(jobs, resume), **options)

        return cast("F", _jobs_option(_resume_option(run) if resume else run))

    return add


PROFILE, BESIDE = "skinmap.profile", "skinmap.profile.beside"  # what was taken from it


def profile_option(*tables: str, beside: Sequence[str] = ()) -> Callable[[F], F]:
    """`--profile`: a profile's knobs become the defaults of the command's options of that name.

    Parameters
    ----------
    tables : str
        Tables of the profile that the command takes; none where no knob concerns it.
    beside : sequence of str
        Knobs that only a profile sets: the command gets each as a keyword, None without one.
    """

    def add(command: F) -> F:
        @functools.wraps(command)
        def say_and_run(*args: Any, **options: Any) -> Any:
            ctx = click.get_current_context()
            _say_profile(ctx)
            return command(*args, **dict.fromkeys(beside) | ctx.meta.get(BESIDE, {}) | options)

        option = click.option(
            "--profile",
            type=click.Path(path_type=Path),
            metavar="FILE",
            is_eager=True,  # before the options whose defaults it sets
            expose_value=False,
            callback=functools.partial(_take_profile, tables, beside),
            help="Settings from `skinmap trade`; options given here win.",
        )
        return cast("F", option(say_and_run))

    return add


def _take_profile(
    tables: tuple[str, ...],
    beside: Sequence[str],
    ctx: click.Context,
    _: click.Parameter,
    path: Path | None,
) -> None:
    if path is None or ctx.resilient_parsing:
        return
    profile = read_profile(path)
    options = {name: option for option in ctx.command.params for name in option.opts}
    knobs: dict[str, str] = {}  # by the parameter that each sets
    defaults = dict(ctx.default_map or {})
    ctx.meta[BESIDE] = {}
    for table in tables:
        for knob, value in profile.settings.get(table, {}).items():
            option = options.get(f"--{knob.replace('_', '-')}")
            if option is not None and option.name is not None:
                knobs[option.name] = knob
                defaults[option.name] = (value,) if option.multiple else value
            elif knob in beside:
                ctx.meta[BESIDE][knob] = value
    ctx.default_map = defaults
    ctx.meta[PROFILE] = (profile, knobs)


def from_profile(name: str) -> bool:
    """Whether the value of a parameter came from the profile, not from the command line."""
    ctx = click.get_current_context(silent=True)
    return ctx is not None and ctx.get_parameter_source(name) is ParameterSource.DEFAULT_MAP


@dataclass(frozen=True, kw_only=True, slots=True)
class ProfileUsed:
    """Settings that a command took from a profile.

    Attributes
    ----------
    file
        File of the profile.
    took
        Knobs by name, without those that the command line gave itself.
    """

    file: Path
    took: dict[str, Any]


@dataclass(frozen=True, kw_only=True, slots=True)
class Profiled:
    """What every object has besides where a profile was given.

    Attributes
    ----------
    profile
        With `--profile`: what was taken from it.
    """

    profile: ProfileUsed | UnsetType = UNSET


def profile_used() -> ProfileUsed | None:
    """What was taken from the profile that was given; None without one."""
    found = _taken()
    return None if found is None else ProfileUsed(file=found[0].path, took=found[1])


def _taken() -> tuple[Profile, dict[str, Any]] | None:
    """The profile that was given, and the knobs taken from it."""
    ctx = click.get_current_context(silent=True)
    if ctx is None or PROFILE not in ctx.meta:
        return None
    profile, knobs = ctx.meta[PROFILE]
    took = {
        knob: (ctx.default_map or {})[name] for name, knob in knobs.items() if from_profile(name)
    }
    took = {knob: v[0] if isinstance(v, tuple) else v for knob, v in took.items()}
    return profile, took | ctx.meta[BESIDE]


def _say_profile(ctx: click.Context) -> None:
    taken = _taken()
    if taken is None:
        return
    profile, took = taken
    measured = " ".join(word for word in (profile.robot, profile.part) if word)
    name = f"profile {profile.path}" + (f" ({measured})" if measured else "")
    said = ", ".join(f"{knob} {value}" for knob, value in took.items())
    won = [knob for knob in ctx.meta[PROFILE][1].values() if knob not in took]
    over = f"; given here: {', '.join(won)}" if won else ""
    nothing = "nothing in it" if won else "the profile has no setting for this command"
    click.echo(f"{name}: {said or nothing}{over}", err=True)
    robots = ctx.params.get("robots") or (ctx.params.get("robot"),)
    measured_on = Path(profile.robot).resolve()
    others = [one for one in robots if one and profile.robot and Path(one).resolve() != measured_on]
    if others:
        click.echo(
            f"Warning: the profile was measured on {profile.robot}, this is {', '.join(others)}: "
            "times and errors may differ from those predicted",
            err=True,
        )
