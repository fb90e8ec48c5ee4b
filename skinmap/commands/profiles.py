"""`--profile`: the option that sets defaults of others, and what was taken from it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click
from click.core import ParameterSource
from msgspec import UNSET, UnsetType

from skinmap.profile import read_profile

if TYPE_CHECKING:
    from skinmap.profile import Profile

F = TypeVar("F", bound=Callable[..., Any])
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
