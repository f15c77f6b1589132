"""`wisco2mqtt completion`: prints a script with which a shell completes command lines.

The script is made from the declarations of the commands, so nothing is written twice: the metavar
of an argument says what it takes (`FILE`, `PORT`, `[STATION] [TARGET]`).
"""

import argparse
import os
from typing import Any

from bridge.cli.frame.usage import OneLineParser, actions_of
from bridge.cli.main import COMMANDS, PROG, add_command, add_common, load_command
from bridge.config.load import find_config, load_config
from bridge.errors import BridgeError, ConfigError
from bridge.installed import how_to_add

NAME = "completion"
EXAMPLES = (
    "completion bash > ~/.local/share/bash-completion/completions/wisco2mqtt",
    "completion zsh > ~/.zfunc/_wisco2mqtt",
    "completion fish > ~/.config/fish/completions/wisco2mqtt.fish",
    "completion stations -c config.yaml",
)

SHELLS = ("bash", "zsh", "fish")

# Functions of the scripts. A bash function with `_file` in its name completes file names.
_BASH = r"""
_wisco2mqtt_stations() {
  local given=() i
  for ((i = 1; i < COMP_CWORD; i++)); do
    [[ ${COMP_WORDS[i]} == -c || ${COMP_WORDS[i]} == --config ]] &&
      given=(-c "${COMP_WORDS[i + 1]/#\~/$HOME}")
  done
  compgen -W "$(wisco2mqtt completion stations "${given[@]}" 2>/dev/null)" -- "$1"
}
_wisco2mqtt_targets() { compgen -W "$(echo di do {di,do}/{1..16} do/{1..16}/{mode,hold})" -- "$1"; }
_wisco2mqtt_values() { compgen -W "ON OFF TOGGLE PRESS latch pulse" -- "$1"; }
_wisco2mqtt_words() { _wisco2mqtt_stations "$1"; _wisco2mqtt_targets "$1"; }
_wisco2mqtt_words_values() { _wisco2mqtt_words "$1"; _wisco2mqtt_values "$1"; }
_wisco2mqtt_station_or_file() { _wisco2mqtt_stations "$1"; compgen -f -- "$1"; }
_wisco2mqtt_port_file() {
  local by_id='/dev/serial/by-id/'
  compgen -W "$(compgen -G "$by_id*"; compgen -G '/dev/tty[UA][SCM]*')" -- "$1"
  [[ $1 == "$by_id"* ]] || compgen -f -- "$1"
}
"""
_ZSH = r"""
_wisco2mqtt_stations() {
  local -a ids given
  [[ -n ${opt_args[-c]-} ]] && given=(-c ${~opt_args[-c]})
  [[ -n ${opt_args[--config]-} ]] && given=(-c ${~opt_args[--config]})
  ids=(${(f)"$(wisco2mqtt completion stations $given 2>/dev/null)"})
  compadd -a ids
}
_wisco2mqtt_targets() { compadd di do {di,do}/{1..16} do/{1..16}/{mode,hold} }
_wisco2mqtt_values() { compadd ON OFF TOGGLE PRESS latch pulse }
_wisco2mqtt_words() { _wisco2mqtt_stations; _wisco2mqtt_targets }
_wisco2mqtt_words_values() { _wisco2mqtt_words; _wisco2mqtt_values }
_wisco2mqtt_station_or_file() { _wisco2mqtt_stations; _files }
_wisco2mqtt_port_file() {
  local -a ports=(/dev/serial/by-id/*(N) /dev/tty(USB|ACM|AMA)*(N))
  compadd -a ports
  _files
}
"""
_FISH = r"""
function _wisco2mqtt_stations
  set -l words (commandline -opc)
  set -l given
  for i in (seq (count $words))
    if contains -- $words[$i] -c --config; and test $i -lt (count $words)
      set given -c $words[(math $i + 1)]
    end
  end
  wisco2mqtt completion stations $given 2>/dev/null
end
function _wisco2mqtt_targets
  printf '%s\n' di do di/(seq 16) do/(seq 16) do/(seq 16)/mode do/(seq 16)/hold
end
function _wisco2mqtt_values; printf '%s\n' ON OFF TOGGLE PRESS latch pulse; end
function _wisco2mqtt_words; _wisco2mqtt_stations; _wisco2mqtt_targets; end
function _wisco2mqtt_words_values; _wisco2mqtt_words; _wisco2mqtt_values; end
function _wisco2mqtt_station_or_file
  _wisco2mqtt_stations
  __fish_complete_path (commandline -ct)
end
function _wisco2mqtt_port_file
  set -l ports /dev/serial/by-id/* /dev/ttyUSB* /dev/ttyACM* /dev/ttyAMA*
  printf '%s\n' $ports
  __fish_complete_path (commandline -ct)
end
"""
_PREAMBLE = {"bash": _BASH, "zsh": _ZSH, "fish": _FISH}
_FILE = {
    "bash": "_shtab_compgen_files",
    "zsh": "_files",
    "fish": "(__fish_complete_path (commandline -ct))",
}
_DIRECTORY = {
    "bash": "_shtab_compgen_dirs",
    "zsh": "_files -/",
    "fish": "(__fish_complete_directories)",
}
_FUNCTIONS = {
    "PORT": "_wisco2mqtt_port_file",
    "STATION": "_wisco2mqtt_stations",
    "TARGET": "_wisco2mqtt_targets",
    "VALUE": "_wisco2mqtt_values",
    # The position of a word does not tell which of these it is.
    "[STATION] [TARGET]": "_wisco2mqtt_words",
    "[STATION] TARGET VALUE": "_wisco2mqtt_words_values",
    "[STATION] FILE": "_wisco2mqtt_station_or_file",
    "[STATION] [FILE]": "_wisco2mqtt_station_or_file",
}
_BY_METAVAR = {
    "FILE": _FILE,
    "PATH": _FILE,
    "DIR": _DIRECTORY,
    **{
        metavar: {"bash": name, "zsh": name, "fish": f"({name})"}
        for metavar, name in _FUNCTIONS.items()
    },
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the shell."""
    parser.description = (
        "Prints a script with which bash, zsh or fish completes commands, options, their values, "
        "files, ports, and the station ids of the configuration. `stations` prints those ids: the "
        "scripts ask for them. The scripts need the extra `cli` to be made, not to be used."
    )
    parser.add_argument("what", choices=(*SHELLS, "stations"), help="the shell, or the ids")


def run(args: argparse.Namespace) -> int:
    """Print the script, or the ids."""
    if args.what == "stations":
        _print_stations(args)
        return 0
    try:
        import shtab  # noqa: PLC0415  # an extra, and only here
    except ImportError as error:
        raise BridgeError(
            f"completion's library shtab is missing (extra `cli`): {how_to_add('shtab')}"
        ) from error
    print(shtab.complete(whole_parser(), args.what, preamble=_PREAMBLE[args.what]))
    return 0


def whole_parser() -> argparse.ArgumentParser:
    """Return all commands as sub-parsers of one parser, as libraries expect them.

    Each argument is marked with what completes it.
    """
    parser = OneLineParser(prog=PROG)
    parser.add_argument("--version", action="version")
    add_common(parser)
    commands = parser.add_subparsers(metavar="COMMAND")
    for name, text in COMMANDS.items():
        command = commands.add_parser(name, help=text)
        add_command(load_command(name), command)
    for each in (parser, *commands.choices.values()):
        for action in actions_of(each):
            _mark(action)
    return parser


def _mark(action: Any) -> None:
    """Mark what completes an argument, in the attribute that shtab reads."""
    if action.metavar in _BY_METAVAR:
        action.complete = _BY_METAVAR[action.metavar]


def _print_stations(args: argparse.Namespace) -> None:
    try:
        config = load_config(find_config(args.config), os.environ, secrets=False)
    except ConfigError:
        return  # no message during completion: the command itself will show it
    for _, station_config in config.all_stations:
        print(station_config.id)
