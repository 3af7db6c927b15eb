"""``completion``: shell scripts that complete commands, options and choices."""

from __future__ import annotations

import argparse
import shlex
import sys
from typing import Any

from imapper_prob.cli.parser import commands_of, examples

__all__ = ["add_completion_command"]

_SHELLS = ("bash", "zsh", "fish")
_BASH = """\
_imapper_prob() {{
  local word="${{COMP_WORDS[COMP_CWORD]}}" last="${{COMP_WORDS[COMP_CWORD-1]}}" command options
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W "{commands}" -- "$word"))
    return
  fi
  command="${{COMP_WORDS[1]}}"
  case "$command" in
    {groups}) [ "$COMP_CWORD" -gt 2 ] && command="$command ${{COMP_WORDS[2]}}" ;;
  esac
  case "$command $last" in
{choices}
  esac
  case "$command" in
{options}
  esac
  if [ "${{word#-}}" != "$word" ] || [ -n "${{options##*-*}}" ]; then
    COMPREPLY=($(compgen -W "$options" -- "$word"))
  else
    COMPREPLY=($(compgen -f -- "$word"))
  fi
}}
complete -o filenames -F _imapper_prob imapper-prob
"""
_ZSH = "autoload -U +X bashcompinit && bashcompinit\n"


def add_completion_command(
    commands: argparse._SubParsersAction[Any],
    shared: argparse.ArgumentParser,
    root: argparse.ArgumentParser,
) -> None:
    """Add the command to a parser.

    Parameters
    ----------
    commands : argparse._SubParsersAction
        The program's subparsers.
    shared : argparse.ArgumentParser
        Options that all commands have.
    root : argparse.ArgumentParser
        Parser whose words are completed.
    """
    command = commands.add_parser(
        "completion",
        parents=[shared],
        help="print what a shell needs to complete commands and options",
        epilog=examples(
            "completion bash > ~/.local/share/bash-completion/completions/imapper-prob"
        ),
    )
    command.add_argument("shell", choices=_SHELLS, help="bash, zsh or fish")
    command.set_defaults(execute=lambda options: sys.stdout.write(_script(root, options.shell)))


def _script(root: argparse.ArgumentParser, shell: str) -> str:
    if shell == "fish":
        return _fish(root)
    return (_ZSH if shell == "zsh" else "") + _bash(root)


def _bash(root: argparse.ArgumentParser) -> str:
    found = list(commands_of(root))
    words = [" ".join(name) for name, _ in found if len(name) == 1]
    groups = sorted({name[0] for name, _ in found if len(name) > 1})
    options, choices = [], []
    for name, parser in found:
        below = [other[-1] for other, _ in found if other[:-1] == name]
        said = below or [o for a in parser._actions for o in a.option_strings]
        key = shlex.quote(" ".join(name))
        options.append(f"    {key}) options={shlex.quote(' '.join(said))} ;;")
        for action in parser._actions:
            if action.choices is not None and action.option_strings:
                keys = "|".join(shlex.quote(f"{' '.join(name)} {o}") for o in action.option_strings)
                values = shlex.quote(" ".join(map(str, action.choices)))
                reply = f'COMPREPLY=($(compgen -W {values} -- "$word")); return ;;'
                choices.append(f"    {keys}) {reply}")
    return _BASH.format(
        commands=" ".join(words),
        groups="|".join(groups),
        options="\n".join(options),
        choices="\n".join(choices),
    )


def _fish(root: argparse.ArgumentParser) -> str:
    lines = []
    for name, parser in commands_of(root):
        *above, word = name
        seen = "; and ".join(f"__fish_seen_subcommand_from {w}" for w in above)
        lines.append(_fish_line(seen or "__fish_use_subcommand", "-f", "-a", word))
        seen = "; and ".join(f"__fish_seen_subcommand_from {w}" for w in name)
        for action in parser._actions:
            for option in action.option_strings:
                flag = ("-l", option[2:]) if option.startswith("--") else ("-s", option[1:])
                values = [] if action.nargs == 0 else ["-r"]
                if action.choices is not None:
                    values += ["-f", "-a", " ".join(map(str, action.choices))]
                lines.append(_fish_line(seen, *flag, *values))
    return "\n".join(lines) + "\n"


def _fish_line(condition: str, *words: str) -> str:
    return shlex.join(["complete", "-c", "imapper-prob", "-n", condition, *words])
