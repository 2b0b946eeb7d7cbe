# SPDX-License-Identifier: Apache-2.0
# Completion for bash (and zsh after `autoload -U bashcompinit && bashcompinit`): source this file, or let
# `make install` put it where bash-completion looks. Commands and options come from the programs' own --help, so there
# is no list here that could be out of date.

# Sources have colons in them, at which bash would cut the word.
COMP_WORDBREAKS=${COMP_WORDBREAKS//:/}

# Lines that begin with two spaces, up to the examples: the commands, or with a command the options.
_subview_words() {
  "$@" --help 2>/dev/null | sed -nE '/^[Ee]xample/q; s/^  (--)?([a-z][a-z0-9-]*)( .*|$)/\1\2/p'
}

_subview() {
  local program=$1 word=$2 before=$3 command=
  ((COMP_CWORD > 1)) && command=${COMP_WORDS[1]}
  case $before in
  --out | --data | --rig | --model | --capture | --images | --transforms)
    COMPREPLY=($(compgen -f -- "$word"))
    return
    ;;
  --source) # what can be captured from here, and recordings
    COMPREPLY=($(compgen -W "$("$program" cameras 2>/dev/null | awk '{ print $1 }') replay:" -- "$word"))
    return
    ;;
  --*) # "a|b|c" behind an option: its words
    local words=$("$program" $command --help 2>/dev/null | sed -nE "s/^  $before ([^ |]+\|[^ ]*).*/\1/p")
    if [[ $words ]]; then
      COMPREPLY=($(compgen -W "${words//|/ }" -- "$word"))
      return
    fi
    ;;
  esac
  if [[ -z $command || $COMP_CWORD -eq 1 ]]; then
    COMPREPLY=($(compgen -W "$(_subview_words "$program" | grep -v '^--') --help --version" -- "$word"))
  elif [[ $word == -* ]]; then
    COMPREPLY=($(compgen -W "$(_subview_words "$program" "$command" | grep '^--')" -- "$word"))
  else
    COMPREPLY=($(compgen -f -- "$word"))
  fi
}
complete -o filenames -F _subview subview subview-lab subview-calibrate
