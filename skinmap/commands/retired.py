"""Commands and options that do not exist: a line with those that do, or what to write instead."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

import click

from skinmap.errors import unknown_name

ANSWERS = Path(__file__).with_suffix(".toml")


class NamedGroup(click.Group):
    """A group whose answer to an unknown command is one line with all there are.

    An option that a command no longer has is answered by the line of `retired.toml`.

    Attributes
    ----------
    removed
        Commands that it no longer has, each with one line: how to get the same now.
    """

    removed: ClassVar[Mapping[str, str]] = {}

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that the first word names."""
        name = args[0]
        if name.startswith("-"):
            return super().resolve_command(ctx, args)
        command = self.get_command(ctx, name)
        if command is None and name in self.removed:
            raise click.UsageError(f"{name} was removed: {self.removed[name]}", ctx)
        if command is None:  # only now are all listed: that asks every installed package
            raise click.UsageError(unknown_name("command", name, self.list_commands(ctx)), ctx)
        return name, command, args[1:]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the group's own options."""
        with _answered():
            return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command."""
        with _answered():
            return super().invoke(ctx)


@contextmanager
def _answered() -> Iterator[None]:
    """Answer an option that was removed by what to write instead."""
    try:
        yield
    except click.NoSuchOption as error:
        answers = tomllib.loads(ANSWERS.read_text(encoding="utf-8"))
        command = None if error.ctx is None else error.ctx.command
        option = error.option_name.removeprefix("--")
        name = "" if command is None else command.name or ""
        every = {} if isinstance(command, click.Group) else answers["any"]
        line = (every | answers.get(name, {})).get(option)
        if line is None:
            raise
        raise click.UsageError(f"--{option} was removed: {line}", error.ctx) from None
