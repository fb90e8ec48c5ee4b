"""The commands with their options, out of their own definitions."""

from __future__ import annotations

import re

import click

from skinmap.cli.main import cli


def commands_text() -> str:
    """All commands in the order of `skinmap --help`."""
    context = click.Context(cli, info_name="skinmap")
    return "\n".join(_command(cli, name, context) for name in cli.list_commands(context))


def _command(group: click.Group, name: str, above: click.Context, level: int = 2) -> str:
    command = group.get_command(above, name)
    assert command is not None, name
    context = click.Context(command, info_name=name, parent=above)
    usage = " ".join(command.collect_usage_pieces(context))
    lines = [f"{'#' * level} {context.command_path}", "", *_help(command.help or ""), ""]
    lines += ["```text", f"{context.command_path} {usage}", "```", ""]
    rows = [_row(option, context) for option in command.params]
    rows = [row for row in rows if row]
    if rows and not isinstance(command, click.Group):
        lines += ["| option | | default |", "|---|---|---|", *rows, ""]
    if isinstance(command, click.Group):
        inner = [
            _command(command, sub, context, level + 1) for sub in command.list_commands(context)
        ]
        lines += inner
    return "\n".join(lines)


def _help(text: str) -> list[str]:
    """Paragraphs as they are; what click must not rewrap is an example."""
    lines = []
    for paragraph in re.split(r"\n\s*\n", re.sub(r"\n +", "\n", text.strip())):
        if paragraph.startswith("\b"):
            example = re.sub(r"^Examples?:\s*", "", paragraph.removeprefix("\b").strip())
            lines += ["```shell", example, "```", ""]
        else:
            lines += [_plain(paragraph), ""]
    return lines


def _row(parameter: click.Parameter, context: click.Context) -> str:
    record = parameter.get_help_record(context)
    if record is None or not isinstance(parameter, click.Option):
        return ""
    default = parameter.default
    shown = "" if default is None or callable(default) or parameter.is_flag else str(default)
    if parameter.multiple or shown in {"()", "Sentinel.UNSET", "None"}:
        shown = ""
    names = record[0].replace("|", "\\|")
    text = _plain(parameter.help or "").replace("|", "\\|")
    return f"| `{names}` | {text} | {shown and f'`{shown}`'} |"


def _plain(text: str) -> str:
    """Text without what Markdown would take for markup."""
    return re.sub(r"([\[\]<>*_$])", r"\\\1", text)
