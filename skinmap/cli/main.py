"""`skinmap`: the group of commands, each loaded only when it is called or listed.

Ctrl-C and a polite kill always end a command, and its workers with it. Some packages try an import
and catch whatever is raised in it, `KeyboardInterrupt` too, to go on without the package (trimesh
does): an interruption in that moment would be lost, or come back much later as some other error.
So nothing is raised inside an import: a moment later is soon enough.
"""

from __future__ import annotations

import importlib
import logging
import os
import signal
import sys
import traceback
import warnings
from importlib.metadata import entry_points
from types import FrameType

import click

from skinmap import __version__
from skinmap.commands.groups import NamedGroup
from skinmap.commands.progress import QUIET
from skinmap.errors import SkinError
from skinmap.imports import run_late
from skinmap.report.table import visible

# name: (module, one line for the list); the module holds a click command called `command`.
COMMANDS = {
    "inspect": (
        "skinmap.cli.inspect.command",
        "What a robot's skin is made of, and whether it fits.",
    ),
    "export": ("skinmap.cli.export", "Taxels or recordings in the formats of others."),
    "flatten": ("skinmap.cli.flatten.command", "Flat maps of the skin and what they distort."),
    "structures": (
        "skinmap.cli.structures",
        "Periodic neighbourhood structures of the layout.",
    ),
    "simulate": ("skinmap.cli.simulate", "Simulated touches on the skin, as a recording."),
    "train": ("skinmap.cli.train", "Train a touch classifier on recordings."),
    "evaluate": (
        "skinmap.cli.evaluate.command",
        "How well classifiers do, by the papers' protocols.",
    ),
    "trade": (
        "skinmap.cli.trade.command",
        "Speed against accuracy on your own skin, and a profile.",
    ),
    "record": ("skinmap.cli.record", "Record a live source; a killed process loses 0.2 s."),
    "label": (
        "skinmap.cli.label",
        "Name, split, join and delete the touches of a recording.",
    ),
    "merge": ("skinmap.cli.merge", "Several recordings as one."),
    "replay": ("skinmap.cli.replay", "Play a recording, and publish it to other programs."),
    "info": ("skinmap.cli.info", "What a recording holds, and what it lacks."),
    "classify": ("skinmap.cli.classify.command", "Name the touches of a recording, or live."),
    "list": ("skinmap.cli.listing", "Names of robots, parts, classifiers and layers."),
    "cache": ("skinmap.cli.cache", "What is kept between runs, and dropping it."),
}
GROUP = "skinmap.commands"
AGAIN = 0.1  # seconds until the next look
IMPORTING = "<frozen importlib._bootstrap>"
# What is said of each, and the exit code.
SAID: dict[int, tuple[str, int]] = {
    signal.SIGINT: ("interrupted", 130),
    signal.SIGTERM: ("terminated", 143),
}


class LazyGroup(NamedGroup):
    """Built-in commands by module, those of other packages by entry point."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All names, the demo first: it is where people start."""
        names = [*COMMANDS, *(point.name for point in entry_points(group=GROUP))]
        return sorted(dict.fromkeys(names), key=lambda name: (name != "demo", names.index(name)))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Load one command; None if there is none of that name."""
        if cmd_name in COMMANDS:
            command: click.Command = importlib.import_module(COMMANDS[cmd_name][0]).command
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
            elif (command := self.get_command(ctx, name)) is not None:
                rows.append((name, command.get_short_help_str(80)))
        with formatter.section("Commands"):
            formatter.write_dl(rows)


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="skinmap")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.option("--quiet", is_flag=True, help="No warnings and no progress.")
@click.option("--verbose", is_flag=True, help="Say what is done, on standard error.")
@click.pass_context
def cli(ctx: click.Context, debug: bool, quiet: bool, verbose: bool) -> None:
    """From a robot's meshes and taxel positions to named touches on its skin.

    Start with:  skinmap demo
    """
    if quiet and verbose:
        raise click.UsageError("--quiet and --verbose contradict each other; give one")
    ctx.obj = {"debug": debug, QUIET: quiet}
    if quiet:
        warnings.showwarning = lambda *_, **__: None
    logging.basicConfig(
        level=logging.DEBUG if verbose else logging.ERROR if quiet else logging.WARNING,
        format="%(levelname)s %(name)s: %(message)s",
    )
    if verbose:  # of ours alone: libraries tell too much
        logging.getLogger().setLevel(logging.WARNING)
        for package in ("skinmap", "calibration", "viewer"):
            logging.getLogger(package).setLevel(logging.DEBUG)


def main() -> None:
    """Run a command: exit 0 done, 2 bad input with one line, 1 internal error."""
    debug = "--debug" in sys.argv[1:]
    warnings.showwarning = _warn
    end_on_interrupt()
    run_late()
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
    except Exception as error:  # noqa: BLE001 - the last resort: an internal error, said plainly
        if _raised:  # compiled code made an error of its own of it (matplotlib: "bounding box")
            _fail(*SAID[_raised[-1]], debug)
        _fail(f"internal error: {type(error).__name__}: {error} (see --debug)", 1, debug)
    finally:
        forget_interrupts()  # before threads are joined, and all that others do at the end


def _one_line(error: click.ClickException) -> str:
    """The message of a wrong option or argument, and where to read more."""
    ctx = error.ctx if isinstance(error, click.UsageError) else None
    more = f" (see {ctx.command_path} --help)" if ctx is not None else ""
    return error.format_message().rstrip(".") + more


def _warn(message: Warning | str, *_: object, **__: object) -> None:
    """One line on standard error, without the place in our code that warned."""
    click.echo(visible(f"Warning: {message}"), err=True)


def _fail(message: str, code: int, debug: bool) -> None:
    if debug:
        traceback.print_exc()
    click.echo(visible(f"Error: {' '.join(message.split())}"), err=True)
    sys.exit(code)


class TerminatedError(KeyboardInterrupt):
    """A polite kill (SIGTERM): undone like Ctrl-C, with another exit code."""


def end_on_interrupt() -> None:
    """Raise `KeyboardInterrupt` on Ctrl-C and a polite kill, once no import is going on.

    A shell's background job is started with Ctrl-C ignored, and goes on ignoring it.
    """
    _raised.clear()
    for kind in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(kind) is not signal.SIG_IGN:
            signal.signal(kind, _interrupted)
    signal.signal(signal.SIGALRM, _again)


def forget_interrupts() -> None:
    """End at once from here on: the work is done, and nothing is left to be undone."""
    for kind in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(kind) is _interrupted:
            signal.signal(kind, signal.SIG_DFL)
    # What came inside the last import comes too late; Python is about to forget its handlers, and
    # an alarm without one kills.
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    _due.clear()


_due: list[int] = []  # what came inside an import, to be raised behind it
_raised: list[int] = []  # what was raised


def _interrupted(kind: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename == IMPORTING:
            _due[:] = [kind]
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
            return
        frame = frame.f_back
    _due.clear()
    _raised.append(kind)
    raise TerminatedError if kind == signal.SIGTERM else KeyboardInterrupt


def _again(_: int, frame: FrameType | None) -> None:
    if _due:
        _interrupted(_due[0], frame)
