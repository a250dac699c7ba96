# Completion of the lg-* programs in bash. Commands, options and files come from the program's own --help-all, the choices of an
# option from the sentence with which an empty value is refused; a new program or option needs nothing here.
_liegrad() {
    local program=${COMP_WORDS[0]/#\~/$HOME} word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]}
    local command='' option='' prefix='' help commands values i
    _liegrad_help() { ARGP_HELP_FMT=rmargin=9999 "$program" $command "$@" --help-all 2>&1 </dev/null; }
    COMPREPLY=()

    help=$(_liegrad_help)
    commands=$(sed -n '/^Commands:/,/^$/s/^  \([a-z][^ ]*\)  .*/\1/p' <<<"$help")
    for ((i = 1; i < COMP_CWORD; i++)); do
        if [[ -n ${COMP_WORDS[i]} && " ${commands//$'\n'/ } " == *" ${COMP_WORDS[i]} "* ]]; then
            command=${COMP_WORDS[i]}
            help=$(_liegrad_help)
            break
        fi
    done

    # --option=value is three words, unless COMP_WORDBREAKS says otherwise.
    if [[ $word == --*=* ]]; then
        option=${word%%=*} prefix=${word%%=*}= word=${word#*=}
    elif [[ $word == '=' ]]; then
        option=$before word=''
    elif [[ $before == '=' ]]; then
        option=${COMP_WORDS[COMP_CWORD - 2]}
    elif [[ $before == --* && $help == *" $before="* ]]; then
        option=$before
    fi

    local IFS=$'\n'
    if [[ -n $option ]]; then
        values=$(_liegrad_help "$option=" | sed -n "s/.*: '' is no\(t one of\|.*; there are\) //p" | sed 's/, /\n/g')
        if [[ -n $values ]]; then
            COMPREPLY=($(compgen -P "$prefix" -W "$values" -- "$word"))
        elif grep -qE -- "^ +$option=[^ ]*(FILE|DIR|MODEL|\.[a-z])" <<<"$help"; then
            compopt -o filenames 2>/dev/null
            COMPREPLY=($(compgen -P "$prefix" -f -- "$word"))
        fi
    elif [[ $word == -* ]]; then
        values=$(sed -n 's/^ *\(-., \)\?\(--[a-z0-9-]*=\?\).*/\2/p' <<<"$help")
        COMPREPLY=($(compgen -W "$values" -- "$word"))
        [[ ${COMPREPLY[0]-} != *= ]] || compopt -o nospace 2>/dev/null
    elif [[ -n $commands && -z $command ]]; then
        COMPREPLY=($(compgen -W "$commands" -- "$word"))
    else # files of the kinds that the first line of --help names, and folders
        compopt -o filenames 2>/dev/null
        values=$(head -n 1 <<<"$help" | grep -oE '\.[a-z0-9]+' | grep -v '^\.\.')
        for i in $values; do COMPREPLY+=($(compgen -f -X "!*$i" -- "$word")); done
        [[ -n $values ]] || COMPREPLY=($(compgen -f -- "$word"))
        COMPREPLY+=($(compgen -d -- "$word"))
    fi
}
complete -F _liegrad "${BASH_SOURCE[0]##*/}"
