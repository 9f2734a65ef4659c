# Bash completion of selenograph. Commands and options are those that --help lists.

_selenograph() {
  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} commands=() help choices i
  COMPREPLY=()
  # The command is what stands before the first option: "verify roundtrip" has two words.
  for ((i = 1; i < COMP_CWORD; ++i)); do
    [[ ${COMP_WORDS[i]} == -* ]] && break
    help=$(selenograph "${commands[@]}" --help 2>/dev/null | sed -n '/^Subcommands:/,$s/^  \([a-z][a-z-]*\) .*/\1/p')
    grep -qxF -- "${COMP_WORDS[i]}" <<<"$help" || break
    commands+=("${COMP_WORDS[i]}")
  done
  help=$(selenograph "${commands[@]}" --help 2>/dev/null)
  if [[ $before == -* ]]; then
    # "  -o,--output DIR", "  --page ENUM:{off,local,on}=local": one of these. Another value: a file.
    choices=$(sed -n "s/^ *\(-[a-zA-Z],\)\?$before [^{]*{\([^}]*\)}.*/\2/p" <<<"$help")
    if [[ $choices ]]; then
      mapfile -t COMPREPLY < <(compgen -W "${choices//,/ }" -- "$word")
      return
    fi
    if [[ $word != -* ]] && grep -qE "^ *(-[a-zA-Z],)?$before(,--[a-z0-9-]+)? [A-Z]" <<<"$help"; then
      mapfile -t COMPREPLY < <(compgen -f -- "$word")
      compopt -o filenames 2>/dev/null
      return
    fi
  fi
  if [[ $word == -* ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$(grep -oE -- '^ *(-[a-zA-Z],)?--[a-z0-9-]+' <<<"$help" |
      grep -oE -- '--[a-z0-9-]+')" -- "$word")
    return
  fi
  choices=$(sed -n '/^Subcommands:/,$s/^  \([a-z][a-z-]*\) .*/\1/p' <<<"$help")
  # Before the first option a command's own commands, as "batch verify"; and the files that it takes.
  if ((${#commands[@]} + 1 == COMP_CWORD)); then
    mapfile -t COMPREPLY < <(compgen -W "$choices" -- "$word")
  fi
  if [[ ! $choices ]] || grep -q '^Positionals:' <<<"$help"; then
    mapfile -t -O "${#COMPREPLY[@]}" COMPREPLY < <(compgen -f -- "$word")
    compopt -o filenames 2>/dev/null
  fi
}
complete -F _selenograph selenograph
