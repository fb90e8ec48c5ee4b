"""`skinmap`: the group of commands, each loaded only when it is called or listed."""

from __future__ import annotations

import importlib
import logging
import os
import signal
import sys
import traceback
import warnings
from functools import cache
from importlib.metadata import entry_points
from types import MappingProxyType

import click

from skinmap import __version__
from skinmap.commands.progress import QUIET
from skinmap.commands.retired import NamedGroup
from skinmap.errors import SkinError
from skinmap.interrupts import TerminatedError, interruptible
from skinmap.report.table import visible

# name: (module beside this one, one line for the list); it holds a click command called `command`.
COMMANDS = {
    "new": ("new", "A manifest for your own robot, from its URDF and taxel tables."),
    "inspect": ("inspect.command", "Check the taxels, modules and fit of a robot's skin."),
    "examine": ("examine", "Faults of anyone's recording."),
    "export": ("export", "Taxels or recordings in the formats of others."),
    "flatten": ("flatten", "Flat maps of the skin and what they distort."),
    "structures": ("structures", "Periodic neighbourhood structures of the layout."),
    "simulate": ("simulate", "Simulated touches on the skin, as a recording."),
    "train": ("train", "Train a touch classifier on recordings."),
    "evaluate": ("evaluate.command", "How well classifiers do, by the papers' protocols."),
    "trade": ("trade", "Speed against accuracy on your own skin, and a profile."),
    "record": ("record", "Record a live source; a killed process loses 0.2 s."),
    "label": ("label", "Name, split, join and delete the touches of a recording."),
    "merge": ("merge", "Several recordings as one."),
    "replay": ("replay", "Play a recording, and publish it to other programs."),
    "info": ("info", "Describe a recording, or the installation."),
    "classify": ("classify.command", "Name the touches of a recording, or live."),
    "list": ("listing", "Names of robots, parts, classifiers and layers."),
}
GROUP = "skinmap.commands"
OLD_NAMES = {"wiring": "checkup"}  # that answer for one release, and are not listed
# What is said of each, and the exit code.
SAID: dict[int, tuple[str, int]] = {
    signal.SIGINT: ("interrupted", 130),
    signal.SIGTERM: ("terminated", 143),
}


class LazyGroup(NamedGroup):
    """Built-in commands by module, those of other packages by entry point."""

    removed = MappingProxyType(
        {"cache": "skinmap info shows its folder; nothing is lost where that is deleted"}
    )

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All names, the demo first: it is where people start."""
        names = [*COMMANDS, *(point.name for point in entry_points(group=GROUP))]
        return sorted(dict.fromkeys(names), key=lambda name: (name != "demo", names.index(name)))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Load one command; None if there is none of that name."""
        cmd_name = OLD_NAMES.get(cmd_name, cmd_name)
        if cmd_name in COMMANDS:
            command: click.Command = importlib.import_module(
                f"skinmap.cli.{COMMANDS[cmd_name][0]}"
            ).command
            return command
        for point in entry_points(group=GROUP, name=cmd_name):
            loaded: click.Command = point.load()
            return loaded
        return None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing the built-in ones."""
        rows = []
        for name in self.list_commands(ctx):
            if name in COMMANDS:
                rows.append((name, COMMANDS[name][1]))
            elif (command := self.get_command(ctx, name)) is not None and not command.hidden:
                rows.append((name, command.get_short_help_str(80)))
        with formatter.section("Commands"):
            formatter.write_dl(rows)


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="skinmap")
@click.option(
    "--debug", is_flag=True, help="Report progress on standard error, and show tracebacks."
)
@click.option("--quiet", is_flag=True, help="No warnings and no progress.")
@click.pass_context
def cli(ctx: click.Context, debug: bool, quiet: bool) -> None:
    """From a robot's meshes and taxel positions to named touches on its skin.

    Start with:  skinmap demo
    """
    ctx.obj = {"debug": debug, QUIET: quiet}
    if quiet:
        warnings.showwarning = lambda *_, **__: None
    logging.basicConfig(
        level=logging.ERROR if quiet else logging.WARNING,
        format="%(levelname)s %(name)s: %(message)s",
    )
    if debug:  # of ours alone: libraries tell too much
        logging.getLogger().setLevel(logging.WARNING)
        for package in ("skinmap", "calibration", "viewer"):
            logging.getLogger(package).setLevel(logging.DEBUG)


def main() -> None:
    """Run a command: exit 0 done, 2 bad input with one line, 1 internal error."""
    debug = "--debug" in sys.argv[1:]
    warnings.showwarning = _warn
    with interruptible() as raised:  # it ends before threads are joined
        try:
            cli.main(standalone_mode=False)
        except click.exceptions.Exit as stop:
            sys.exit(stop.exit_code)
        except click.exceptions.NoArgsIsHelpError as error:
            error.show()
            sys.exit(2)
        except click.ClickException as error:
            _fail(_one_line(error), 2, debug)
        except SkinError as error:
            _fail(str(error), 2, debug)
        except (KeyboardInterrupt, click.Abort) as error:  # click makes an Abort of the former
            polite = isinstance(error.__cause__ or error, TerminatedError)
            _fail(*SAID[signal.SIGTERM if polite else signal.SIGINT], debug=False)
        except BrokenPipeError:  # the reader of our output went away: nothing is wrong
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            sys.exit(0)
        except Exception as error:  # noqa: BLE001 - the last resort: an internal error
            if raised:  # compiled code made an error of its own of it (matplotlib: "bounding box")
                _fail(*SAID[raised[-1]], debug)
            _fail(f"internal error: {type(error).__name__}: {error} (see --debug)", 1, debug)


def _one_line(error: click.ClickException) -> str:
    """The message of a wrong option or argument, and where to read more."""
    ctx = error.ctx if isinstance(error, click.UsageError) else None
    more = f" (see {ctx.command_path} --help)" if ctx is not None else ""
    return error.format_message().rstrip(".") + more


def _warn(message: Warning | str, *_: object, **__: object) -> None:
    """One line on standard error, once, without the place in our code that warned."""
    _say_once(visible(f"Warning: {message}"))


@cache
def _say_once(line: str) -> None:
    click.echo(line, err=True)


def _fail(message: str, code: int, debug: bool) -> None:
    if debug:
        traceback.print_exc()
    click.echo(visible(f"Error: {' '.join(message.split())}"), err=True)
    sys.exit(code)
