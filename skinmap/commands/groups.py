"""Groups of commands that answer a misspelt name with those that exist."""

from __future__ import annotations

import click

from skinmap.errors import unknown_name


class NamedGroup(click.Group):
    """A group whose answer to an unknown command is one line with all there are."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that the first word names."""
        name = args[0]
        if name.startswith("-"):
            return super().resolve_command(ctx, args)
        command = self.get_command(ctx, name)
        if command is None:  # only now are all listed: that asks every installed package
            raise click.UsageError(unknown_name("command", name, self.list_commands(ctx)), ctx)
        return name, command, args[1:]
