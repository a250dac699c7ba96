#!/bin/bash
# The log of `lg-anomaly watch --log` while other programs rotate it: no verdict is lost, doubled or incomplete.
set -u
export PATH=$LG_BIN_DIR:$PATH LC_ALL=C
folder=$(mktemp -d "${TMPDIR:-/tmp}/lg-rotation-XXXXXX")
trap 'rm -rf "$folder"' EXIT
cd "$folder" || exit 2
failures=0
fail() {
    echo "test_rotation.sh: line ${BASH_LINENO[0]}: $*"
    failures=$((failures + 1))
}
# verdicts FILE...: prints the verdicts without the lines of names.
verdicts() { cat "$@" | grep -av '^# time'; }
# until_holds FILE: waits up to half a minute until FILE is not empty.
until_holds() {
    for _ in $(seq 600); do [ ! -s "$1" ] || return 0; sleep 0.05; done
    fail "nothing in $1"
}

# until_there FILE: waits up to half a minute until FILE exists.
until_there() {
    for _ in $(seq 600); do [ ! -e "$1" ] || return 0; sleep 0.05; done
    fail "no $1"
}

lg-anomaly generate --noise 10 --runs 9 --out well.h5 >/dev/null || exit 2
lg-anomaly train well.h5 --method logistic --out alarm.h5 >/dev/null 2>&1 || exit 2
lg-anomaly feed --hours 4 --noise 10 --crack-at 2 --gaps 2 --seed 5 --out feed.csv >/dev/null || exit 2
lines=$(wc -l <feed.csv)
for kind in "" --json; do
    lg-anomaly watch alarm.h5 $kind <feed.csv >whole.txt || exit 2
    [ -n "$kind" ] || grep -avE '^# [a-z_]+ {2,}' whole.txt >whole
    [ -z "$kind" ] || grep -av '"summary"' whole.txt >whole

    # Without rotation; the summary is separate.
    rm -f log*
    lg-anomaly watch alarm.h5 $kind --log log <feed.csv >summary || fail "the watch ended with $?"
    cmp -s log whole || fail "$kind: the log is not what is printed without it"
    [ "$(cat whole summary | sed '/^# [a-z_]*\(second\|bytes\|kb\)/d; s/"seconds".*//')" = \
        "$(sed '/^# [a-z_]*\(second\|bytes\|kb\)/d; s/"seconds".*//' whole.txt)" ] || fail "$kind: the summary is another one"

    # Renamed, then SIGHUP, 20 times; half of them while samples arrive.
    rm -f log*
    mkfifo pipe
    lg-anomaly watch alarm.h5 $kind --log log <pipe >summary &
    watch=$!
    exec 3>pipe
    for i in $(seq 20); do
        sed -n "$(((i - 1) * lines / 20 + 1)),$((i * lines / 20))p" feed.csv >&3 &
        until_holds log
        [ $((i % 2)) = 0 ] || wait $!
        mv log "log.$(printf %02d "$i")"
        kill -HUP $watch
        until_there log # also without a verdict
        wait $!
    done
    exec 3>&-
    wait $watch || fail "$kind: the watch ended with $?"
    verdicts log.* log | cmp -s - <(verdicts whole) || fail "$kind: renamed: verdicts were lost or doubled"
    [ "$(find . -name 'log.*' -size +0 | wc -l)" = 20 ] || fail "$kind: not 20 pieces"
    [ -n "$kind" ] || [ "$(head -qn 1 log.* | sort -u)" = "$(head -n 1 whole)" ] || fail "a log without names"

    # Copied and truncated, while no verdict is written.
    rm -f log*
    lg-anomaly watch alarm.h5 $kind --log log <pipe >summary &
    watch=$!
    exec 3>pipe
    for i in $(seq 5); do
        sed -n "$(((i - 1) * lines / 5 + 1)),$((i * lines / 5))p" feed.csv >&3
        until_holds log
        size=-1
        until [ "$size" = "$(stat -c %s log)" ]; do
            size=$(stat -c %s log)
            sleep 0.5
        done
        cp log "log.$i"
        : >log
    done
    exec 3>&-
    wait $watch || fail "$kind: the watch ended with $?"
    verdicts log.* log | cmp -s - <(verdicts whole) || fail "$kind: cut: verdicts were lost or doubled"
    [ "$(cat log.* log | tr -d '\0' | wc -c)" = "$(cat log.* log | wc -c)" ] || fail "$kind: a hole in the log"
    rm pipe
done

# An incomplete line left by a killed watch is removed; a file that is not a log is not touched.
head -n 3 whole >log
printf '{"time": 12' >>log
lg-anomaly watch alarm.h5 --json --log log <feed.csv >/dev/null || fail "the watch ended with $?"
cmp -s log <(head -n 3 whole; cat whole) || fail "after an unfinished line"
head -c 100000 /dev/zero >zeros
cp zeros copy
lg-anomaly watch alarm.h5 --log zeros <feed.csv >/dev/null 2>err.txt
[ $? = 3 ] || fail "a file without lines was taken"
grep -q "zeros: exists and is not a log" err.txt || fail "$(cat err.txt)"
cmp -s zeros copy || fail "a file without lines was changed"
lg-anomaly watch alarm.h5 --input feed.csv --log feed.csv >/dev/null 2>&1
[ $? = 2 ] || fail "the feed was taken for the log"

# logrotate itself, if it is installed.
if [ -x /usr/sbin/logrotate ]; then
    rm -f log*
    mkfifo pipe
    lg-anomaly watch alarm.h5 --log log <pipe >summary &
    watch=$!
    exec 3>pipe
    printf '%s {\nrotate 9\nnocreate\nmissingok\nsu %s %s\npostrotate\nkill -HUP %s\nendscript\n}\n' "$folder/log" "$(id -un)" \
        "$(id -gn)" $watch >rotate.conf
    chmod 755 .
    chmod 644 rotate.conf
    for i in 1 2 3; do
        sed -n "$(((i - 1) * lines / 3 + 1)),$((i * lines / 3))p" feed.csv >&3 &
        until_holds log
        /usr/sbin/logrotate -f -s state rotate.conf || fail "logrotate"
        wait $!
    done
    exec 3>&-
    wait $watch
    lg-anomaly watch alarm.h5 <feed.csv | grep -avE '^# [a-z_]+ {2,}' >whole
    verdicts log.3 log.2 log.1 log | cmp -s - <(verdicts whole) || fail "logrotate: verdicts were lost or doubled"
else
    echo "logrotate: skipped, it is not installed"
fi
[ $failures = 0 ]
