/* The tools that read exports, in child processes (peers.py). */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "apps/random/exports.h"

typedef struct child {
    FILE *to, *from;
    bool ready;
} child;

static bool read_line(const child *c, char *line, size_t size) {
    if (fgets(line, (int)size, c->from) == NULL) return false;
    line[strcspn(line, "\n")] = '\0';
    return true;
}

static void start(child *c, const char *what) {
    int to[2], from[2];
    char line[256] = "no answer";
    const char *named = getenv("LG_PYTHON"), *python = named != NULL ? named : "python3";
    if (pipe(to) != 0 || pipe(from) != 0) stop("no pipe");
    const pid_t id = fork();
    if (id < 0) stop("no child");
    if (id == 0) {
        (void)dup2(to[0], 0);
        (void)dup2(from[1], 1);
        (void)close(to[1]);
        (void)close(from[0]);
        (void)execlp(python, python, LG_TEST_DIR "/apps/random/peers.py", what, (char *)NULL);
        _exit(77);
    }
    (void)close(to[0]);
    (void)close(from[1]);
    c->to = fdopen(to[1], "w");
    c->from = fdopen(from[0], "r");
    if (c->to == NULL || c->from == NULL) stop("no pipe");
    c->ready = read_line(c, line, sizeof line) && strcmp(line, "ready") == 0;
    if (!c->ready) printf("%s: left out: %s\n", what, line);
}

bool ask_peer(peer which, const model *m, size_t rows, char *answer, size_t size) {
    static const char *const what[PEERS] = {[PEER_ONNX] = "onnx", [PEER_FMU] = "fmu"};
    static child children[PEERS];
    child *c = &children[which];
    if (c->to == NULL) start(c, what[which]);
    if (!c->ready) return false;
    (void)fprintf(c->to, "%s %s %zu\n", m->folder, m->name, rows);
    (void)fflush(c->to);
    if (!read_line(c, answer, size)) {
        c->to = NULL; /* the next question starts another one */
        (void)snprintf(answer, size, "the tool has ended");
    }
    tallied.peers++;
    return true;
}
