"""Commands and options that do not exist: a line with those that do, or what to write instead."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import product
from typing import Any, ClassVar, TypeVar

import click

from skinmap.errors import unknown_name


class NamedGroup(click.Group):
    """A group whose answer to an unknown command is one line with all there are.

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

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; an option that is misspelt is answered without those that are hidden."""
        words = [*ctx.args]
        try:
            return super().invoke(ctx)
        except click.NoSuchOption as error:
            if error.ctx is None:
                raise
            params = error.ctx.command.params
            for one, word in product(params, words):  # a value such as -1 behind a removed option
                if isinstance(one, RetiredOption) and word in one.opts and one.callback:
                    one.callback(error.ctx, one, (word,))
            own = [opt for one in params if not getattr(one, "hidden", False)
                   for opt in (*one.opts, *one.secondary_opts)]  # fmt: skip
            raise click.NoSuchOption(error.option_name, None, own, error.ctx) from None


F = TypeVar("F", bound=Callable[..., Any])
NO_PROFILE = "a profile holds no setting of this command"


class RetiredOption(click.Option):
    """A hidden option that takes anything and only answers; it does not count as an option."""


def retired(**instead: str) -> Callable[[F], F]:
    """Options that a command no longer has.

    Parameters
    ----------
    instead : str
        For each name (`points_hz` for `--points-hz`) one line: how to get the same now, or why
        nothing takes its place.

    Returns
    -------
    callable
        A decorator for a command.

    Examples
    --------
    >>> import click
    >>> from click.testing import CliRunner
    >>> @click.command()
    ... @retired(backend="write --jobs tcp://HOST:PORT")
    ... def sweep() -> None:
    ...     pass
    >>> CliRunner().invoke(sweep, ["--backend", "dask"]).output.splitlines()[-1]
    'Error: --backend was removed: write --jobs tcp://HOST:PORT'
    """

    def answer(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> None:
        if value:
            raise click.UsageError(f"{param.opts[0]} was removed: {instead[str(param.name)]}", ctx)

    def add(command: F) -> F:
        for name in instead:
            command = click.option(
                f"--{name.replace('_', '-')}",
                name,
                cls=RetiredOption,
                hidden=True,
                expose_value=False,
                is_flag=False,
                flag_value="given",  # so that a word behind it is optional
                callback=answer,
            )(command)
        return command

    return add
