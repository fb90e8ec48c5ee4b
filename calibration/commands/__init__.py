"""`skinmap calibrate`: one command for each kind of evidence, loaded when it is called."""

from __future__ import annotations

import importlib

import click

from skinmap.commands.retired import NamedGroup

# Name of a command, of the module beside this one, and of the command there: one line for the list.
COMMANDS = {
    "wrap": "A flat board on its link, by a few anchors or touches.",
    "batch": "Many boards, on several cores or machines.",
    "selftouch": "By skin that touches skin.",
    "plane": "By presses on a table.",
    "scan": "A 3D scan of the link to its mesh.",
    "wrench": "By the lines of forces that were felt.",
    "load": "Pressures in bar, with intervals.",
    "rest": "The zero of a load calibration anew.",
    "response": "Baselines, gains, health of taxels.",
}


class LazyCommands(NamedGroup):
    """Commands that are imported when they are called, not when they are listed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of a calibration's work."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Load one command; None if there is none of that name."""
        # `touch` is what `wrap --touches` was called; it answers for one release, unlisted.
        name = "wrap" if cmd_name == "touch" else cmd_name
        if name not in COMMANDS:
            return None
        command: click.Command = getattr(importlib.import_module(f"{__name__}.{name}"), name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([*COMMANDS.items()])


@click.group(
    cls=LazyCommands,
    name="calibrate",
    short_help="Positions of taxels, with their confidence, and their response.",
)
def calibrate() -> None:
    """Calibrate a skin: where each taxel is, with what confidence, and whether it works.

    \b
    Example:  skinmap calibrate wrap --layout board.csv --mesh link.stl --anchors anchors.csv -o out
    """
